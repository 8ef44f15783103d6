"""Selection against theory, slow references, and DEAP; hopeless and equal individuals are survived."""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable

import moocore
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robolamp.evolve.selection import crowding, draw_tournament, lexicase, pareto, proportionate, winner
from robolamp.evolve.tasks.fitness import HOPELESS

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of DEAP, a guest here
    from deap import base, tools

DRAWS = 4000
MARGIN = 4 * np.sqrt(0.25 / DRAWS)  # four standard deviations of a share, at most
SELECTIONS: dict[str, Callable[[np.random.Generator, np.ndarray, int], np.ndarray]] = {
    "proportionate": lambda rng, values, count: proportionate(rng, values[:, 0], count),
    "lexicase": lexicase,
    "pareto": pareto,
}


class Minimum(base.Fitness):
    """DEAP's fitness of as many minimized values as it is given."""

    def __init__(self, values: np.ndarray) -> None:
        self.weights = (-1.0,) * len(values)
        super().__init__(tuple(values.tolist()))


class Individual:
    """What DEAP selects from."""

    def __init__(self, index: int, values: np.ndarray) -> None:
        self.index, self.fitness = index, Minimum(values)


def individuals(values: np.ndarray) -> list[Individual]:
    return [Individual(index, row) for index, row in enumerate(values)]


def shares(chosen: np.ndarray | list[int], population: int) -> np.ndarray:
    return np.bincount(chosen, minlength=population) / len(chosen)


def test_a_tournament_is_won_by_the_lowest_and_by_the_first_of_equals() -> None:
    fitness = np.array([3.0, 1.0, 1.0, np.nan, np.inf])
    assert winner(fitness, np.array([0, 2, 1])) == 2
    assert winner(fitness, np.array([3, 0])) == 0
    assert winner(fitness, np.array([4, 3])) == 4
    drawn = draw_tournament(np.random.default_rng(1), 5, 1000)
    assert set(drawn.tolist()) == set(range(5))


def test_tournaments_choose_as_deaps_do() -> None:
    rng, population = np.random.default_rng(2), 12
    fitness = rng.permutation(population).astype(float)
    ours = shares([winner(fitness, draw_tournament(rng, population, 4)) for _ in range(DRAWS)], population)
    random.seed(2)
    theirs = [chosen.index for chosen in tools.selTournament(individuals(fitness[:, None]), DRAWS, 4)]
    np.testing.assert_allclose(ours, shares(theirs, population), atol=2 * MARGIN)


def test_proportions_are_those_of_normalized_adjusted_fitness() -> None:
    """Koza 1992, section 6.3: 1 / (1 + standardized fitness), over their sum."""
    fitness = np.array([0.0, 1.0, 3.0, HOPELESS, np.inf, np.nan])
    found = shares(proportionate(np.random.default_rng(3), fitness, DRAWS), len(fitness))
    np.testing.assert_allclose(found, np.array([1, 1 / 2, 1 / 4, 0, 0, 0]) / 1.75, atol=MARGIN)


@pytest.mark.parametrize("name", SELECTIONS)
@pytest.mark.parametrize("value", [0.0, 1.0, HOPELESS, np.inf, np.nan])
def test_where_all_are_alike_each_is_chosen_as_often(name: str, value: float) -> None:
    found = SELECTIONS[name](np.random.default_rng(4), np.full((5, 2), value), DRAWS)
    if name == "pareto":  # two of equal points are the ends of their front, which win over those between them
        assert {0, 4} <= set(found.tolist())
    else:
        np.testing.assert_allclose(shares(found, 5), 0.2, atol=MARGIN)


@pytest.mark.parametrize("name", SELECTIONS)
@given(arrays(np.float64, st.tuples(st.integers(1, 12), st.just(2)), elements=st.floats(0.0)), st.integers(0, 2**32))
def test_any_values_are_survived_and_a_seed_chooses_alike(name: str, values: np.ndarray, seed: int) -> None:
    found = SELECTIONS[name](np.random.default_rng(seed), values, 20)
    assert found.shape == (20,)
    assert ((found >= 0) & (found < len(values))).all()
    assert (SELECTIONS[name](np.random.default_rng(seed), values, 20) == found).all()


def test_lexicase_chooses_as_deaps_does_where_epsilon_is_the_same_for_all_cases() -> None:
    rng = np.random.default_rng(5)
    errors = rng.gamma(2.0, size=(15, 6))
    spread = np.median(np.abs(errors - np.median(errors, axis=0)), axis=0)
    assert (spread > 0).all()
    ours = shares(lexicase(rng, errors, DRAWS), 15)
    random.seed(5)
    scaled = individuals(errors / spread)  # each case's epsilon is 1 now
    theirs = [chosen.index for chosen in tools.selEpsilonLexicase(scaled, DRAWS, 1.0)]
    np.testing.assert_allclose(ours, shares(theirs, 15), atol=2 * MARGIN)


@given(arrays(np.float64, st.tuples(st.integers(2, 15), st.integers(1, 5)), elements=st.floats(0, 10)))
def test_lexicase_never_chooses_who_is_beaten_by_more_than_epsilon_everywhere(errors: np.ndarray) -> None:
    epsilon = np.median(np.abs(errors - np.median(errors, axis=0)), axis=0)
    for loser in set(lexicase(np.random.default_rng(6), errors, 50).tolist()):
        assert not any((errors[loser] > other + epsilon).all() for other in errors)


def test_lexicase_tells_the_few_that_stand_from_the_many_that_fall() -> None:
    errors = np.full((20, 6), HOPELESS)
    errors[3] = [1.0, 5.0, 1.0, 5.0, 1.0, 5.0]
    errors[7] = [5.0, 1.0, 5.0, 1.0, 5.0, 1.0]
    errors[11] = [9.0] * 6
    assert set(lexicase(np.random.default_rng(7), errors, 200).tolist()) <= {3, 7}


def test_a_specialist_is_chosen_by_lexicase_though_its_sum_is_the_worst() -> None:
    errors = np.array([[0.0, 90.0, 90.0], [10.0, 10.0, 10.0], [11.0, 11.0, 10.0], [10.0, 11.0, 11.0]])
    assert errors[0].sum() == errors.sum(axis=1).max()
    assert shares(lexicase(np.random.default_rng(8), errors, DRAWS), 4)[0] == pytest.approx(1 / 3, abs=MARGIN)


points = arrays(np.float64, st.tuples(st.integers(1, 25), st.just(2)), elements=st.integers(0, 9).map(float))


@given(points)
def test_fronts_and_crowding_are_deaps(values: np.ndarray) -> None:
    fronts = tools.sortNondominated(individuals(values), len(values))
    expected = np.empty(len(values), int)
    for number, front in enumerate(fronts):
        expected[[member.index for member in front]] = number
    rank = moocore.pareto_rank(values)
    assert (rank == expected).all()
    distance = crowding(values, rank)
    for number in range(len(fronts)):
        members = [Individual(index, values[index]) for index in np.flatnonzero(expected == number)]
        tools.emo.assignCrowdingDist(members)
        theirs = [member.fitness.crowding_dist for member in members]
        np.testing.assert_allclose(distance[expected == number], theirs, rtol=1e-12)


def test_a_binary_tournament_goes_by_front_then_by_crowding() -> None:
    values = np.array([[0.0, 3.0], [1.0, 1.25], [1.25, 1.0], [3.0, 0.0], [4.0, 4.0], [np.inf, np.inf]])
    found = shares(pareto(np.random.default_rng(10), values, DRAWS), 6)
    # Fronts 0 0 0 0 1 2. Of 36 pairs an end of the first front wins those with the 4 below it (twice each), with
    # itself, and half of those with the other end; the two in between, as crowded as each other, likewise.
    np.testing.assert_allclose(found[[0, 3]], (2 * 4 + 1 + 1) / 36, atol=MARGIN)
    np.testing.assert_allclose(found[[1, 2]], (2 * 2 + 1 + 1) / 36, atol=MARGIN)
    np.testing.assert_allclose(found[[4, 5]], [3 / 36, 1 / 36], atol=MARGIN)
