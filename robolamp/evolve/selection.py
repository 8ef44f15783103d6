"""Selection: who becomes a parent. Lower is better everywhere; a value that is not finite is worse than any that is."""

from __future__ import annotations

import moocore
import numpy as np
from numpy.typing import NDArray

from robolamp.evolve.tasks.fitness import HOPELESS


def draw_tournament(rng: np.random.Generator, population: int, size: int) -> NDArray[np.int64]:
    """Draw the individuals of a tournament, with replacement; their fitness need not be known yet.

    Args:
        rng: Where randomness comes from.
        population: Individuals there are.
        size: Individuals to draw.

    Returns:
        Their indices, shape (size,).
    """
    return rng.integers(population, size=size)


def winner(fitness: NDArray[np.float64], drawn: NDArray[np.int64]) -> int:
    """Return the winner of a tournament: the lowest fitness; among equals the one drawn first.

    Args:
        fitness: Shape (population,).
        drawn: Indices of the individuals in it, shape (size,).
    """
    return int(drawn[np.argmin(_finite(fitness[drawn]))])


def proportionate(rng: np.random.Generator, fitness: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Choose in proportion to normalized adjusted fitness, with replacement (Koza 1992, sections 6.3 and 6.4.1).

    Adjusted fitness is 1 / (1 + standardized fitness). If no fitness is finite, all have the same chance.

    Args:
        rng: Where randomness comes from.
        fitness: Standardized fitness: 0 is perfect, lower is better, shape (population,).
        count: How many to choose.

    Returns:
        Their indices, shape (count,).
    """
    return rng.choice(len(fitness), size=count, p=normalized(fitness))


def adjusted(fitness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return adjusted fitness, 1 / (1 + standardized fitness): 1 is perfect (Koza 1992, section 6.3.3).

    Args:
        fitness: Standardized fitness: 0 is perfect, lower is better, shape (population,).
    """
    return 1.0 / (1.0 + _finite(fitness))


def normalized(fitness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return normalized fitness: adjusted fitness as a share of its sum (Koza 1992, section 6.3.4).

    Args:
        fitness: Standardized fitness, shape (population,).
    """
    shares = adjusted(fitness)
    return shares / shares.sum()


def lexicase(rng: np.random.Generator, errors: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Choose by semi-dynamic epsilon-lexicase selection (La Cava, Helmuth, Spector & Moore 2019, Algorithm 3).

    For each parent the cases come in an order of their own; each case keeps, of those that are left, who is within
    epsilon of their best, until one is left; of several that are left at the end, any. Epsilon is a case's median
    absolute deviation over the population: over those who are not hopeless at it, so that a generation that mostly
    falls can still tell its better ones apart.

    Args:
        rng: Where randomness comes from.
        errors: Of each individual at each case, shape (population, cases).
        count: How many to choose.

    Returns:
        Their indices, shape (count,).
    """
    population, cases = errors.shape
    columns = np.ascontiguousarray(_finite(errors).T)
    epsilon = np.array([_deviation(column) for column in columns])
    chosen = np.empty(count, np.int64)
    everyone = np.arange(population)
    for index in range(count):
        pool = everyone
        for case in rng.permutation(cases):
            if len(pool) == 1:
                break
            own = columns[case, pool]
            pool = pool[own <= own.min() + epsilon[case]]
        chosen[index] = pool[rng.integers(len(pool))]
    return chosen


def _deviation(column: NDArray[np.float64]) -> float:
    """Return the median absolute deviation of those that are not hopeless."""
    hopeful = column[column < HOPELESS]
    return float(np.median(np.abs(hopeful - np.median(hopeful)))) if len(hopeful) else 0.0


def pareto(rng: np.random.Generator, objectives: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Choose by binary tournaments on the rank of the front, then on crowding (Deb et al. 2002, section III).

    Args:
        rng: Where randomness comes from.
        objectives: Shape (population, 2).
        count: How many to choose.

    Returns:
        Their indices, shape (count,).
    """
    values = _finite(objectives)
    rank = moocore.pareto_rank(values)
    distance = crowding(values, rank)
    drawn = rng.integers(len(values), size=(count, 2))
    first, second = drawn.T
    later = (rank[second] < rank[first]) | ((rank[second] == rank[first]) & (distance[second] > distance[first]))
    return np.where(later, second, first)


def crowding(objectives: NDArray[np.float64], rank: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the crowding distance of each individual within its front (Deb et al. 2002, section III-B).

    Args:
        objectives: Finite, shape (population, k).
        rank: Front of each individual, shape (population,).

    Returns:
        The mean, over the objectives, of the gap between its two neighbours as a share of the front's extent; infinite
        at the ends. Shape (population,).
    """
    distance = np.zeros(len(objectives))
    for front in range(int(rank.max()) + 1):
        members = np.flatnonzero(rank == front)
        for column in objectives[members].T:
            order = np.argsort(column, kind="stable")
            extent = column[order[-1]] - column[order[0]]
            distance[members[order[[0, -1]]]] = np.inf
            if extent > 0.0:
                gaps = (column[order[2:]] - column[order[:-2]]) / extent
                distance[members[order[1:-1]]] += gaps / objectives.shape[1]
    return distance


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values, those that are not finite replaced by one so large that differences still do not overflow."""
    worst = np.finfo(np.float64).max / 4
    return np.where(np.isfinite(values), np.minimum(values, worst), worst)
