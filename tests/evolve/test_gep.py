"""Chromosomes and their operators: always valid, and Ferreira's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robolamp.controller.expression import parse
from robolamp.controller.gene import expressed, parse_gene
from robolamp.controller.primitives import PRIMITIVES
from robolamp.controller.terminals import on_board_terminals
from robolamp.errors import ExpressionError, FileError
from robolamp.evolve.representations.gep import Chromosome, Genes
from robolamp.evolve.representations.gep_operators import brought_first, first_function, reading_frame
from robolamp.evolve.tasks.gep_settings import GepSettings
from robolamp.evolve.tasks.task import load_task

from .parts import ASSETS, LAMP, task

TERMINALS = on_board_terminals(3)
RATES = [name for name in vars(GepSettings()) if name not in ("head", "constants")]
LOW, HIGH = -6.0, 6.0


def genes(*overrides: str) -> Genes:
    words = ["gp.representation=gep", f"constants=[{LOW}, {HIGH}]", *overrides]
    return Genes(load_task(ASSETS, "travel", overrides=words), TERMINALS, LAMP.names)


def arrays(population: list[Chromosome]) -> tuple[np.ndarray, np.ndarray]:
    return np.stack([each.symbols for each in population]), np.stack([each.constants for each in population])


def only(rate: str, value: float = 1.0) -> list[str]:
    """Overrides by which one operator alone is at work."""
    return [f"gp.gep.{name}={value if name == rate else 0.0}" for name in RATES]


def test_the_defaults_are_the_papers() -> None:
    """EMOT, Table 2."""
    assert vars(GepSettings()) == {
        "head": 10, "constants": 10, "mutation": 0.01, "is_transposition": 0.1, "ris_transposition": 0.1,
        "gene_transposition": 0.05, "one_point": 0.2, "two_point": 0.5, "gene_crossover": 0.1,
        "constant_mutation": 0.05, "constant_tuning": 0.9,
    }  # fmt: skip


def test_a_first_generation_uses_every_symbol_where_it_may_stand() -> None:
    own = genes()
    symbols, constants = arrays(own.population(np.random.default_rng(1), 300))
    functions, last = len(PRIMITIVES), len(PRIMITIVES) + len(TERMINALS)
    head, tail, domain = symbols[:, :, :10], symbols[:, :, 10:31], symbols[:, :, 31:]
    assert set(np.unique(head)) == set(range(last + 1))
    assert set(np.unique(tail)) == set(range(functions, last + 1))
    assert set(np.unique(domain)) == set(range(10))
    assert symbols.shape == (300, 3, 10 + 21 + 21)
    assert constants.shape == (300, 3, 10)
    assert -6.0 <= constants.min() < -5.9 < 5.9 < constants.max() <= 6.0
    assert (head < functions).mean() == pytest.approx(0.5, abs=0.02)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1), st.sampled_from([*RATES, "all"]), st.integers(2, 14), st.integers(1, 12),
    st.integers(1, 5),
)  # fmt: skip
def test_every_operator_keeps_genes_valid(seed: int, rate: str, head: int, constants: int, generations: int) -> None:
    rates = [f"gp.gep.{name}=0.7" for name in RATES] if rate == "all" else only(rate)
    own = genes(*rates, f"gp.gep.head={head}", f"gp.gep.constants={constants}", "gp.population=9")
    rng = np.random.default_rng(seed)
    population = own.population(rng, 9)
    for _ in range(generations):
        plan = own.plan(rng)
        parents = [population[index] for index in rng.integers(9, size=plan.elites + plan.parents)]
        population, mothers = own.breed(rng, plan, parents, 9)
        assert population[0] == parents[0]  # the elite
        assert mothers == list(range(9))
    for child in population:
        texts = own.dump(child)
        assert own.load(texts, "here") == child  # a parser that refuses what is no gene
        assert ((child.constants >= LOW) & (child.constants <= HIGH)).all()
        for text, expression in zip(texts, own.decode(child), strict=True):
            assert parse_gene(text, TERMINALS).expression == expression
            assert parse(str(expression), TERMINALS) == expression


@pytest.mark.parametrize("rate", RATES)
def test_each_operator_changes_what_it_should_and_nothing_else(rate: str) -> None:
    own = genes(*only(rate))
    rng = np.random.default_rng(5)
    symbols, constants = arrays(own.population(rng, 40))
    before, values = symbols.copy(), constants.copy()
    own.vary(rng, symbols, constants)
    if rate.startswith("constant"):
        assert (symbols == before).all()
        moved = (constants != values).sum(axis=(1, 2))
        assert moved.max() == (1 if rate == "constant_tuning" else 30)
        step = np.abs(constants - values)[constants != values]
        assert rate != "constant_tuning" or step.mean() == pytest.approx(1.2 * np.sqrt(2 / np.pi), rel=0.35)
        return
    heads, rest = symbols[:, :, :10] != before[:, :, :10], symbols[:, :, 10:] != before[:, :, 10:]
    assert heads.any()
    assert rest.any() == (rate not in ("is_transposition", "ris_transposition"))
    if rate in ("is_transposition", "ris_transposition"):
        assert (heads.any(axis=2).sum(axis=1) <= 1).all()  # one gene
        assert heads[:, :, 0].any() == (rate == "ris_transposition")  # IS leaves the root alone
        roots = symbols[:, :, 0][heads[:, :, 0]]
        assert (roots < len(PRIMITIVES)).all()
    if rate in ("one_point", "two_point", "gene_crossover"):
        # Nothing is made and nothing lost: each place has the same symbols, in another order of individuals.
        assert (np.sort(symbols, axis=0) == np.sort(before, axis=0)).all()
        assert (np.sort(constants, axis=0) == np.sort(values, axis=0)).all()
        changed = (symbols != before).any(axis=2)
        assert rate != "gene_crossover" or (changed.sum(axis=1) <= 1).all()
    if rate == "gene_transposition":
        for old, new in zip(before, symbols, strict=True):
            orders = [[1, 0, 2], [2, 0, 1]]
            assert any((old[order] == new).all() for order in orders)


def test_rates_are_kept() -> None:
    rng = np.random.default_rng(3)
    for rate, value in (("mutation", 0.01), ("constant_mutation", 0.05)):
        own = genes(*only(rate, value))
        symbols, constants = arrays(own.population(rng, 400))
        before, values = symbols.copy(), constants.copy()
        own.vary(rng, symbols, constants)
        changed = (constants != values) if rate.startswith("constant") else (symbols != before)
        # A symbol may be drawn that stood there already.
        assert 0.8 * value < changed.mean() <= 1.1 * value
    own = genes(*only("constant_tuning", 0.5))
    symbols, constants = arrays(own.population(rng, 400))
    values = constants.copy()
    own.vary(rng, symbols, constants)
    expressing = np.array(
        [any(isinstance(token, float) for part in own.decode(Chromosome(*each)) for token in part.tokens)
         for each in zip(symbols, values, strict=True)]
    )  # fmt: skip
    moved = (constants != values).any(axis=(1, 2))
    assert not moved[~expressing].any()
    assert moved[expressing].mean() == pytest.approx(0.5, abs=0.1)


def test_tuning_moves_a_constant_that_is_expressed() -> None:
    own = genes(*only("constant_tuning"))
    rng = np.random.default_rng(2)
    population = own.population(rng, 60)
    symbols, constants = arrays(population)
    own.vary(rng, symbols, constants)
    for parent, child in zip(population, map(Chromosome, symbols, constants), strict=True):
        assert (own.decode(parent) == own.decode(child)) == (parent == child)


def test_array_helpers() -> None:
    heads = np.array([[False, True, False, True], [False, False, False, False], [True, False, False, False]])
    assert first_function(heads, np.array([2, 0, 1])).tolist() == [3, -1, -1]
    assert brought_first(np.array([2, 1, 3]), 4).tolist() == [[2, 0, 1, 3], [1, 0, 2, 3], [3, 0, 1, 2]]
    own = genes()
    population = own.population(np.random.default_rng(4), 50)
    arity = np.array([*(each.arity for each in PRIMITIVES.values()), *([0] * (len(TERMINALS) + 1))])
    for child in population:
        ends = reading_frame(arity[child.symbols[:, :31]])
        assert ends.tolist() == [expressed(text.replace("|", " ").split()[:31]) for text in own.dump(child)]


def test_a_controller_goes_into_genes_where_it_fits() -> None:
    own, rng = genes("gp.gep.constants=2"), np.random.default_rng(6)
    fits = tuple(parse(text, TERMINALS) for text in ("(+ 7 (* a0 7))", "t", "(ifltz s0 0.5 (- a1 a2))"))
    seeded = own.seeded(rng, fits, "seed s")
    assert own.decode(seeded) == fits
    assert own.seeded(rng, fits, "seed s") != seeded  # what is not expressed is drawn
    tuned = tuple(parse(text, TERMINALS) for text in ("(+ 7.5 (* a0 7.5))", "t", "(ifltz s0 0.4 (- a1 a2))"))
    assert own.decode(own.carrying(seeded, tuned)) == tuned
    tall = parse("(+ " * 10 + "t" + " (* a0 a1))" * 10, TERMINALS)
    with pytest.raises(ExpressionError, match=r"seed s: joints\.knee: needs a head of \d+ symbols; a gene has"):
        own.seeded(rng, (fits[0], tall, fits[2]), "seed s")
    rich = parse("(+ 1 (+ 2 3))", TERMINALS)
    with pytest.raises(ExpressionError, match=r"seed s: joints\.neck: needs 3 constants; a gene has 2; set gp\.gep"):
        own.seeded(rng, (fits[0], fits[1], rich), "seed s")


def test_genes_of_other_lengths_are_refused() -> None:
    texts = genes("gp.gep.head=5").dump(genes("gp.gep.head=5").population(np.random.default_rng(1), 1)[0])
    with pytest.raises(ExpressionError, match="here: genes are not those of the task: 3 with a head of 10 and"):
        genes().load(texts, "here")
    with pytest.raises(ExpressionError, match="genes are not those of the task: 3 with a head of 5"):
        genes("gp.gep.head=5").load(texts[:2], "here")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("head = 1", "gp.gep.head: 1 is not a whole number from 2 to 150"),
        ("head = 10.5", "gp.gep.head: 10.5 is not a whole number from 2 to 150"),
        ("constants = 0", "gp.gep.constants: 0 is not a whole number from 1 to 1000"),
        ("mutation = 1.5", "gp.gep.mutation: 1.5 is not a number from 0 to 1"),
        ("inversion = 0.1", "gp.gep.inversion: unknown; expected one of constant_mutation, constant_tuning"),
    ],
)
def test_bad_parameters_are_one_line(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(FileError) as caught:
        task(tmp_path, ("depth = 6", f"depth = 6\n[gp.gep]\n{line}"))
    assert words in str(caught.value)
