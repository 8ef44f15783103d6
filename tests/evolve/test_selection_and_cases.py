from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.errors import RobolampError
from robolamp.evolve.selection import draw_tournament, winner
from robolamp.evolve.tasks.fitness_cases import poisson_disk
from robolamp.evolve.tasks.task import load_task
from robolamp.evolve.trial import draw_cases

from .parts import ASSETS


@pytest.mark.parametrize("size", [1, 2, 6])
def test_a_tournament_is_won_as_often_as_theory_says(size: int) -> None:
    """The i-th best of n wins with ((n - i + 1)^k - (n - i)^k) / n^k (drawn with replacement)."""
    rng, n, draws = np.random.default_rng(5), 10, 20_000
    fitness = np.random.default_rng(6).permutation(n).astype(float)
    winners = [winner(fitness, draw_tournament(rng, n, size)) for _ in range(draws)]
    wins = np.bincount(fitness[winners].astype(int), minlength=n) / draws
    rank = np.arange(n)
    expected = ((n - rank) ** size - (n - rank - 1) ** size) / n**size
    np.testing.assert_allclose(wins, expected, atol=4 * np.sqrt(0.25 / draws))


@given(st.integers(0, 2**32), st.integers(1, 8))
def test_goals_keep_their_distance(seed: int, count: int) -> None:
    goals = poisson_disk(np.random.default_rng(seed), count, 0.05, 0.60, 0.03)
    assert goals.shape == (count,)
    assert ((goals >= 0.05) & (goals <= 0.60)).all()
    assert (np.diff(goals) >= 0.03).all()


def test_goals_are_spread_over_the_whole_range() -> None:
    rng = np.random.default_rng(7)
    goals = np.concatenate([poisson_disk(rng, 6, 0.05, 0.60, 0.05) for _ in range(300)])
    share, _ = np.histogram(goals, bins=5, range=(0.05, 0.60))
    assert share.min() / share.max() > 0.8


def test_goals_that_do_not_fit_are_refused() -> None:
    with pytest.raises(RobolampError, match=r"12 goals 0\.05 m apart do not fit between 0\.05 and 0\.6 m"):
        poisson_disk(np.random.default_rng(8), 13 - 1, 0.05, 0.60, 0.0501 - 0.0001)


def test_every_goal_is_tried_on_the_calibrated_lamp_and_on_others() -> None:
    task = load_task(ASSETS, "hop")
    cases = draw_cases(np.random.default_rng(9), task, 25)
    assert len(cases) == task.cases.count * task.cases.lamps
    for start in range(0, len(cases), task.cases.lamps):
        group = cases[start : start + task.cases.lamps]
        assert len({case.goal for case in group}) == 1
        assert group[0].lamp == 0
        assert len({case.lamp for case in group}) == task.cases.lamps
    assert {case.lamp for case in draw_cases(np.random.default_rng(9), task, 1)} == {0}
