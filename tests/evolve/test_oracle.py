"""Interpreters and crossover against DEAP's trees (De Rainville et al. 2012), which share no code with ours."""

from __future__ import annotations

import functools
import math
import warnings

import numpy as np
import pytest

from robolamp.controller.expression import Expression, depth, subtree_end
from robolamp.controller.primitives import PRIMITIVES
from robolamp.controller.program import ProgramSet, compile_program
from robolamp.controller.terminals import all_terminals
from robolamp.evolve.representations.tree import Breeder, Genome
from robolamp.evolve.tasks.task import load_task

from .parts import ASSETS

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of DEAP, a guest here
    from deap import gp

TERMINALS = all_terminals(3)
BREEDER = Breeder(load_task(ASSETS, "travel"), TERMINALS, 3)
NAMES = {"+": "add", "-": "sub", "*": "mul", "%": "div", "ifltz": "ifltz"}


def _divide(a: float, b: float) -> float:
    try:
        return a / b
    except ZeroDivisionError:
        return 1.0


@functools.cache
def primitive_set() -> gp.PrimitiveSet:
    """The 1997 paper's functions, as one would give them to DEAP."""
    primitives = gp.PrimitiveSet("MAIN", len(TERMINALS))
    primitives.renameArguments(**{f"ARG{index}": name for index, name in enumerate(TERMINALS)})
    primitives.addPrimitive(float.__add__, 2, "add")
    primitives.addPrimitive(float.__sub__, 2, "sub")
    primitives.addPrimitive(float.__mul__, 2, "mul")
    primitives.addPrimitive(_divide, 2, "div")
    primitives.addPrimitive(lambda a, b, c: b if a < 0.0 else c, 3, "ifltz")
    return primitives


def to_deap(expression: Expression) -> gp.PrimitiveTree:
    """The same tree, node by node."""
    primitives = primitive_set()
    arguments = {terminal.value: terminal for terminal in primitives.terminals[primitives.ret]}
    nodes = []
    for token in expression.tokens:
        if not isinstance(token, str):
            nodes.append(gp.Terminal(token, False, object))
        elif token in NAMES:
            nodes.append(primitives.mapping[NAMES[token]])
        else:
            nodes.append(arguments[token])
    return gp.PrimitiveTree(nodes)


def inputs(rng: np.random.Generator, lanes: int) -> np.ndarray:
    """Signals of every size and sign, zeros among them."""
    shape = (lanes, len(TERMINALS))
    values = rng.normal(size=shape) * 10.0 ** rng.integers(-3, 3, shape)
    values = np.where(rng.random(shape) < 0.05, values * 1e300, values)
    return np.where(rng.random(shape) < 0.2, rng.choice([0.0, -0.0, 1.0, -1.0, 5e-324], shape), values)


def test_the_interpreters_give_what_deap_gives() -> None:
    rng = np.random.default_rng(1)
    genomes = BREEDER.population(rng, 60)
    rows = inputs(rng, 40)
    strange = 0
    for genome in genomes:
        program = compile_program(genome, TERMINALS)
        lanes = ProgramSet([program]).run(np.zeros(len(rows), np.int64), rows, np.empty((len(rows), 3)))
        compiled = [gp.compile(to_deap(part), primitive_set()) for part in genome]
        for row, many in zip(rows.tolist(), lanes.tolist(), strict=True):
            theirs = [function(*row) for function in compiled]
            for ours in (program.run(row), many):
                assert [repr(value) for value in ours] == [repr(value) for value in theirs]
            strange += sum(not math.isfinite(value) for value in theirs)
    assert strange  # infinities and NaN were met


def test_depth_and_size_are_deaps() -> None:
    for genome in BREEDER.population(np.random.default_rng(2), 50):
        for part in genome:
            tree = to_deap(part)
            assert (len(part.tokens), depth(part.tokens)) == (len(tree), tree.height)
            for index in range(len(part.tokens)):
                assert tree.searchSubtree(index) == slice(index, subtree_end(part.tokens, index))


def swapped(mother: Genome, father: Genome, son: Genome, daughter: Genome) -> bool:
    """Whether DEAP's exchange of slices (deap.gp.cxOnePoint) makes these children, for some pair of points."""
    changed = [[a != b for a, b in zip(*pair, strict=True)] for pair in ((mother, son), (father, daughter))]
    firsts = [joint for joint in range(3) if changed[0] == [joint == other for other in range(3)]] or range(3)
    seconds = [joint for joint in range(3) if changed[1] == [joint == other for other in range(3)]] or range(3)
    for a in firsts:
        for b in seconds:
            one, two = list(mother[a].tokens), list(father[b].tokens)
            trees = to_deap(mother[a]), to_deap(father[b])
            for i in range(len(one)):
                own = trees[0].searchSubtree(i)
                for j in range(len(two)):
                    other = trees[1].searchSubtree(j)
                    if one[: own.start] + two[other] + one[own.stop :] == list(son[a].tokens) and two[
                        : other.start
                    ] + one[own] + two[other.stop :] == list(daughter[b].tokens):
                        return True
    return False


@pytest.mark.parametrize("seed", range(30))
def test_crossover_is_deaps_exchange_of_slices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mother, father = (tuple(genome) for genome in BREEDER.population(rng, 2))
    son, daughter = BREEDER.crossover(rng, mother, father)
    assert swapped(mother, father, son, daughter)
    assert set(PRIMITIVES) == set(NAMES)
