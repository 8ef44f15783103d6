from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.expression import Expression, depth, parse, subtree_end
from robolamp.controller.primitives import PRIMITIVES
from robolamp.controller.terminals import on_board_terminals
from robolamp.evolve.representations.tree import Breeder, Genome, constants, with_constants
from robolamp.evolve.tasks.task import load_task

from .parts import ASSETS, task

TERMINALS = on_board_terminals(3)
BREEDER = Breeder(load_task(ASSETS, "hop"), TERMINALS, 3)
LIMIT = BREEDER.task.gp.depth
seeds = st.integers(0, 2**32)


def valid(genome: Genome) -> None:
    assert len(genome) == 3
    for part in genome:
        assert parse(str(part), TERMINALS) == part
        assert depth(part.tokens) <= LIMIT


def size(genome: Genome) -> int:
    return sum(len(part.tokens) for part in genome)


def counted(*genomes: Genome) -> Counter:
    return Counter(token for genome in genomes for part in genome for token in part.tokens)


def test_ramped_half_and_half() -> None:
    born = BREEDER.population(np.random.default_rng(1), 100)
    assert len(set(born)) == 100
    shortest, tallest = BREEDER.task.gp.depth_at_birth
    full: Counter = Counter()
    for index, genome in enumerate(born):
        valid(genome)
        limit = shortest + index % (tallest - shortest + 1)
        depths = [depth(part.tokens) for part in genome]
        if index % 2:
            assert depths == [limit] * 3
            full[limit] += 1
        else:
            assert all(1 <= value <= limit for value in depths)
    assert full == dict.fromkeys(range(shortest, tallest + 1), 10)
    values = np.array([value for genome in born for value in constants(genome)])
    low, high = BREEDER.task.constants
    assert low <= values.min() < 0.9 * low
    assert 0.9 * high < values.max() <= high
    assert counted(*born).keys() >= set(TERMINALS) | {"+", "-", "*", "%", "ifltz"}


def test_no_more_twins_than_there_must_be(tmp_path: Path) -> None:
    few = Breeder(task(tmp_path, ("depth_at_birth = [2, 4]", "depth_at_birth = [1, 2]")), ("t",), 1)
    born = few.population(np.random.default_rng(2), 200)
    assert len(born) == 200
    assert len(set(born)) > 150


@given(seeds)
def test_crossover_exchanges_one_subtree_and_loses_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mother, father = BREEDER.population(rng, 2)
    son, daughter = BREEDER.crossover(rng, mother, father)
    for child in (son, daughter):
        valid(child)
    assert counted(son, daughter) == counted(mother, father)  # at birth no tree is so deep that a child is refused
    assert sum(a != b for a, b in zip(son, mother, strict=True)) <= 1
    assert sum(a != b for a, b in zip(daughter, father, strict=True)) <= 1


@given(seeds)
def test_no_tree_outgrows_the_limit_however_long_it_is_bred(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pair = tuple(BREEDER.population(rng, 2))
    for _ in range(25):
        before = pair
        pair = BREEDER.crossover(rng, *pair)
        for child in pair:
            valid(child)
        pair = (pair[0], BREEDER.mutate_constants(rng, pair[1])) if rng.random() < 0.3 else pair
        valid(pair[1])
        pair = pair if sum(len(part.tokens) for genome in pair for part in genome) < 2000 else before


def test_a_child_that_grew_too_deep_is_the_parent_it_came_from(tmp_path: Path) -> None:
    breeder = Breeder(task(tmp_path, ("depth = 6", "depth = 4")), TERMINALS, 1)
    rng = np.random.default_rng(3)
    deep: Genome = (parse("(+ t (+ t (+ t (+ t t))))", TERMINALS),)
    refused = 0
    for _ in range(200):
        children = breeder.crossover(rng, deep, deep)
        assert all(depth(part.tokens) <= 4 for child in children for part in child)
        refused += sum(child == deep for child in children)
    assert 0 < refused < 400


def test_crossover_points_are_mostly_functions() -> None:
    """Koza 1992, section 6.4.1: 90 % of the points are functions."""
    rng = np.random.default_rng(4)
    mother: Genome = (parse("(+ (+ 1 2) (+ 3 4))", TERMINALS),) * 3
    father: Genome = (parse("(* (* t t) (* t t))", TERMINALS),) * 3
    whole_leaf = 0
    for _ in range(2000):
        son, _ = BREEDER.crossover(rng, mother, father)
        taken = counted(son)["t"] - counted(mother)["t"]
        whole_leaf += taken == 1
    # A leaf is given where all nodes are drawn from (10 %) and it is one of 4 leaves in 7 nodes.
    assert whole_leaf / 2000 == pytest.approx(0.1 * 4 / 7, abs=0.02)


@given(seeds)
def test_mutation_moves_constants_and_keeps_the_tree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (genome,) = BREEDER.population(rng, 1)
    moved = BREEDER.mutate_constants(rng, genome)
    valid(moved)
    assert len(constants(moved)) == len(constants(genome))
    shape: Callable[[Genome], list] = lambda g: [  # noqa: E731
        [token if isinstance(token, str) else None for token in part.tokens] for part in g
    ]
    assert shape(moved) == shape(genome)
    if constants(genome):
        assert moved != genome
        steps = np.abs(np.array(constants(moved)) - constants(genome))
        assert (steps <= 6 * (0.1 * np.abs(constants(genome)) + 0.03) + 1e-4).all()


def test_constants_are_replaced_in_the_order_they_are_written() -> None:
    genome = tuple(Expression(parse(text, TERMINALS).tokens) for text in ("(+ 1 t)", "2", "(- (* 3 4) a0)"))
    assert constants(genome) == [1, 2, 3, 4]
    new = with_constants(genome, [0.123456789, -5e-7, 30.0, 1 / 3])
    assert [str(part) for part in new] == ["(+ 0.12346 t)", "-5e-07", "(- (* 30 0.33333) a0)"]


OPERATORS: dict[str, Callable[[Breeder, np.random.Generator, Genome, Genome], tuple[Genome, ...]]] = {
    "crossover": Breeder.crossover,
    "subtree": lambda breeder, rng, mother, _: (breeder.subtree_mutation(rng, mother),),
    "point": lambda breeder, rng, mother, _: (breeder.point_mutation(rng, mother),),
    "constants": lambda breeder, rng, mother, _: (breeder.mutate_constants(rng, mother),),
}


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> Breeder:
    """Limits that are met at once."""
    changes = (("depth_at_birth = [2, 4]", "depth_at_birth = [1, 4]"), ("depth = 6", "depth = 5\nnodes = 40"))
    return Breeder(task(tmp_path_factory.mktemp("narrow"), *changes), TERMINALS, 3)


@given(seeds, st.lists(st.sampled_from(list(OPERATORS)), min_size=1, max_size=12))
def test_whatever_is_done_to_genomes_they_stay_well_formed_and_within_limits(
    narrow: Breeder, seed: int, names: list[str]
) -> None:
    rng = np.random.default_rng(seed)
    mother, father = narrow.population(rng, 2)
    for name in names:
        for child in (father, *OPERATORS[name](narrow, rng, mother, father)):
            assert len(child) == 3
            assert size(child) <= 40
            for part in child:
                assert parse(str(part), TERMINALS) == part
                assert depth(part.tokens) <= 5
            mother, father = child, mother


def test_those_that_would_be_born_too_large_are_born_shallower(narrow: Breeder) -> None:
    born = narrow.population(np.random.default_rng(6), 200)
    sizes = [size(genome) for genome in born]
    assert max(sizes) <= 40
    assert len(set(born)) == 200
    assert np.mean(sizes) > 15


def test_a_child_that_grew_too_large_is_the_parent_it_came_from(narrow: Breeder) -> None:
    rng = np.random.default_rng(7)
    full = "(+ (+ (+ t t) (+ t t)) (+ (+ t t) t))"  # 13 nodes
    mother: Genome = (parse(full, TERMINALS),) * 3
    grown = [child for _ in range(300) for child in narrow.crossover(rng, mother, mother)]
    grown += [narrow.subtree_mutation(rng, mother) for _ in range(300)]
    assert max(size(child) for child in grown) <= 40
    assert 0 < sum(child == mother for child in grown) < len(grown)


@given(seeds)
def test_subtree_mutation_replaces_one_subtree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (genome,) = BREEDER.population(rng, 1)
    child = BREEDER.subtree_mutation(rng, genome)
    valid(child)
    changed = [(old.tokens, new.tokens) for old, new in zip(genome, child, strict=True) if old != new]
    assert len(changed) <= 1
    for old, new in changed:
        assert any(
            old[:start] == new[:start] and old[subtree_end(old, start) :] == new[subtree_end(new, start) :]
            for start in range(min(len(old), len(new)))
        )


def test_new_subtrees_are_leaves_and_trees_as_deep_as_at_birth() -> None:
    rng = np.random.default_rng(8)
    leaf: Genome = (parse("t", TERMINALS),) * 3
    depths = Counter(max(depth(part.tokens) for part in BREEDER.subtree_mutation(rng, leaf)) for _ in range(2000))
    assert set(depths) == set(range(BREEDER.task.gp.depth_at_birth[1] + 1))


@given(seeds)
def test_point_mutation_keeps_the_shape_and_changes_at_least_one_node(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (genome,) = BREEDER.population(rng, 1)
    child = BREEDER.point_mutation(rng, genome)
    valid(child)
    assert child != genome
    arity: Callable[[Genome], list[int]] = lambda g: [  # noqa: E731
        PRIMITIVES[token].arity if token in PRIMITIVES else 0 for part in g for token in part.tokens
    ]
    assert arity(child) == arity(genome)


def test_point_mutation_replaces_one_node_in_twenty() -> None:
    rng = np.random.default_rng(9)
    text = "(+ (* a0 a1) (- t 1))"  # every node has an alternative
    genome: Genome = (parse(f"(- {text} (% {text} {text}))", TERMINALS),) * 3
    changed = [
        sum(
            a != b
            for old, new in zip(genome, BREEDER.point_mutation(rng, genome), strict=True)
            for a, b in zip(old.tokens, new.tokens, strict=True)
        )
        for _ in range(1000)
    ]
    nodes = size(genome)
    assert min(changed) == 1
    assert np.mean(changed) == pytest.approx(0.05 * nodes + 0.95**nodes, rel=0.06)


def test_an_ifltz_without_peers_is_left_alone() -> None:
    rng = np.random.default_rng(10)
    genome: Genome = (parse("(ifltz t a0 a1)", TERMINALS),) * 3
    for _ in range(100):
        child = BREEDER.point_mutation(rng, genome)
        assert child != genome
        assert all(part.tokens[0] == "ifltz" and len(part.tokens) == 4 for part in child)
