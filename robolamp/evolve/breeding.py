"""From one generation to the next: which operators, which parents, which children."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.evolve.race import fitness
from robolamp.evolve.selection import draw_tournament, lexicase, pareto, proportionate, winner
from robolamp.evolve.task import Settings
from robolamp.evolve.tree import Breeder, Genome
from robolamp.evolve.trial import MAIN, STYLE

_PARENTS = {"crossover": 2, "subtree_mutation": 1, "point_mutation": 1, "constant_mutation": 1, "reproduction": 1}


@dataclass(frozen=True)
class Plan:
    """What will be bred, drawn before anybody is evaluated.

    Attributes:
        operators: One after the other.
        tournaments: Individuals of the tournament for each parent, shape (parents, size); None where parents are
            chosen in another way.
    """

    operators: tuple[str, ...]
    tournaments: NDArray[np.int64] | None

    @property
    def parents(self) -> int:
        """How many parents are needed."""
        return sum(_PARENTS[operator] for operator in self.operators)


def draw_plan(rng: np.random.Generator, gp: Settings) -> Plan:
    """Draw the operators that make the next generation, and the tournaments for their parents.

    Args:
        rng: Where randomness comes from.
        gp: Shares, selection and population.
    """
    names = list(_PARENTS)
    bounds = np.cumsum([gp.crossover, gp.subtree_mutation, gp.point_mutation, gp.constant_mutation])
    operators: list[str] = []
    children = 0
    while children < gp.population:
        operator = names[int(np.searchsorted(bounds, rng.random(), side="right"))]
        operators.append(operator)
        children += _PARENTS[operator]  # crossover makes two children of two parents
    tournaments = None
    if gp.selection == "tournament":
        count = sum(_PARENTS[operator] for operator in operators)
        tournaments = np.stack([draw_tournament(rng, gp.population, gp.tournament) for _ in range(count)])
    return Plan(tuple(operators), tournaments)


def choose(
    rng: np.random.Generator, gp: Settings, plan: Plan, values: NDArray[np.float64], phase: float
) -> NDArray[np.int64]:
    """Choose the parents.

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


def breed(
    rng: np.random.Generator, breeder: Breeder, plan: Plan, parents: Sequence[Genome], count: int
) -> tuple[list[Genome], list[int]]:
    """Make the next generation.

    Args:
        rng: Where randomness comes from.
        breeder: The operators.
        plan: Which of them.
        parents: As many as the plan needs.
        count: How many children.

    Returns:
        The children, and which of the parents each has most from.
    """
    children: list[Genome] = []
    mothers: list[int] = []
    single = {
        "subtree_mutation": breeder.subtree_mutation,
        "point_mutation": breeder.point_mutation,
        "constant_mutation": breeder.mutate_constants,
    }
    at = 0
    for operator in plan.operators:
        if operator == "crossover":
            children += breeder.crossover(rng, parents[at], parents[at + 1])
            mothers += [at, at + 1]
        else:
            make = single.get(operator)
            children.append(make(rng, parents[at]) if make else parents[at])
            mothers.append(at)
        at += _PARENTS[operator]
    return children[:count], mothers[:count]
