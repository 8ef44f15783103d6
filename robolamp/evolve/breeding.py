"""How one generation follows from another: representation, choice of parents, making of children."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.expression import parse
from robolamp.evolve.race import fitness
from robolamp.evolve.representations.gep import Genes
from robolamp.evolve.representations.representation import Plan, Representation
from robolamp.evolve.representations.tree import Breeder, Genome
from robolamp.evolve.selection import draw_tournament, lexicase, pareto, proportionate, winner
from robolamp.evolve.tasks.task import Settings, Task
from robolamp.evolve.trial import MAIN, STYLE

_PARENTS = {"crossover": 2, "subtree_mutation": 1, "point_mutation": 1, "constant_mutation": 1, "reproduction": 1}


def represent(task: Task, terminals: Sequence[str], joints: Sequence[str]) -> Representation[Any]:
    """Return the representation that a task asks for.

    Args:
        task: Names it, and gives its parameters.
        terminals: What expressions may read.
        joints: The joints' names.
    """
    return Genes(task, terminals, joints) if task.gp.representation == "gep" else Trees(task, terminals, len(joints))


def choose(
    rng: np.random.Generator, gp: Settings, plan: Plan, values: NDArray[np.float64], phase: float
) -> NDArray[np.int64]:
    """Choose the parents, but for the elites.

    Args:
        rng: Where randomness comes from.
        gp: How.
        plan: How many, or by which tournaments.
        values: `MEASURES`, shape (individuals, cases, 7).
        phase: What style counts.

    Returns:
        Individuals, shape (parents,).
    """
    if plan.tournaments is not None:
        whole = fitness(values, phase)
        return np.array([winner(whole, drawn) for drawn in plan.tournaments], np.int64)
    if gp.selection == "proportionate":
        return proportionate(rng, fitness(values, phase), plan.parents)
    if gp.selection == "lexicase":
        return lexicase(rng, np.concatenate([values[:, :, MAIN], values[:, :, STYLE]], axis=1), plan.parents)
    return pareto(rng, values[:, :, [MAIN, STYLE]].mean(axis=1), plan.parents)


class Trees:
    """Trees as a representation: genotype and phenotype are the same; see `robolamp.evolve.representations.tree`.

    Args:
        task: Shares, limits, and the range of constants.
        terminals: What leaves may read.
        joints: Expressions of a genome.
    """

    def __init__(self, task: Task, terminals: Sequence[str], joints: int) -> None:
        self._gp, self._terminals = task.gp, tuple(terminals)
        self._breeder = Breeder(task, terminals, joints)

    def population(self, rng: np.random.Generator, count: int) -> list[Genome]:
        """Return a first generation by ramped half-and-half."""
        return self._breeder.population(rng, count)

    def seeded(self, rng: np.random.Generator, phenotype: Genome, where: str) -> Genome:
        """Return the controller itself."""
        return phenotype

    def plan(self, rng: np.random.Generator) -> Plan:
        """Draw the operators that make the next generation, and the tournaments for their parents."""
        gp = self._gp
        names = list(_PARENTS)
        bounds = np.cumsum([gp.crossover, gp.subtree_mutation, gp.point_mutation, gp.constant_mutation])
        operators: list[str] = []
        children = 0
        while children < gp.population:
            operator = names[int(np.searchsorted(bounds, rng.random(), side="right"))]
            operators.append(operator)
            children += _PARENTS[operator]  # crossover makes two children of two parents
        tournaments = None
        count = sum(_PARENTS[operator] for operator in operators)
        if gp.selection == "tournament":
            tournaments = np.stack([draw_tournament(rng, gp.population, gp.tournament) for _ in range(count)])
        return Plan(count, tournaments, tuple(operators))

    def breed(
        self, rng: np.random.Generator, plan: Plan, parents: Sequence[Genome], count: int
    ) -> tuple[list[Genome], list[int]]:
        """Make the next generation, an operator at a time."""
        children: list[Genome] = []
        mothers: list[int] = []
        single = {
            "subtree_mutation": self._breeder.subtree_mutation,
            "point_mutation": self._breeder.point_mutation,
            "constant_mutation": self._breeder.mutate_constants,
        }
        at = 0
        for operator in plan.operators:
            if operator == "crossover":
                children += self._breeder.crossover(rng, parents[at], parents[at + 1])
                mothers += [at, at + 1]
            else:
                make = single.get(operator)
                children.append(make(rng, parents[at]) if make else parents[at])
                mothers.append(at)
            at += _PARENTS[operator]
        return children[:count], mothers[:count]

    def decode(self, genotype: Genome) -> Genome:
        """Return the genotype itself."""
        return genotype

    def carrying(self, genotype: Genome, phenotype: Genome) -> Genome:
        """Return the phenotype itself."""
        return phenotype

    def dump(self, genotype: Genome) -> list[str]:
        """Return the S-expressions."""
        return [str(part) for part in genotype]

    def load(self, texts: Sequence[str], where: str) -> Genome:
        """Return the trees that S-expressions hold.

        Raises:
            ExpressionError: One does not parse.
        """
        return tuple(parse(text, self._terminals, where) for text in texts)

    def genes(self, genotype: Genome) -> Mapping[str, str]:
        """Return nothing: a tree has nothing beside its expressions."""
        return {}
