"""Least squares over recordings: where it ends, and what it leaves known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.lamp.open_loop_fit import NOISE, conditioned, covariance, minimise

Array = NDArray[np.float64]
TRUTH = np.array([1.5, -0.8])
TIME = np.linspace(0.0, 6.0, 400)


def errors(z: Array) -> list[Array]:
    """Return one recording's errors of lamps whose joint moves with two unknowns, one of them bent, shape (k, N, 1)."""

    def angle(a: Array, b: Array) -> Array:
        return 0.1 * (a + 0.1 * a**2)[:, None] * np.sin(TIME) + 0.1 * b[:, None] * np.cos(3.0 * TIME)

    return [(angle(z[0], z[1]) - angle(TRUTH[:1], TRUTH[1:]))[:, :, None]]


def test_it_finds_the_truth_and_ends_when_a_step_saves_little() -> None:
    costs: list[float] = []
    found = minimise(errors, np.zeros(2), 20, costs.append)
    assert np.abs(found.z - TRUTH).max() < 0.02  # the priors pull a little
    assert len(costs) < 8
    assert costs == sorted(costs, reverse=True)
    assert found.cost <= costs[-1]


def test_it_ends_after_the_most_steps_with_differences_around_the_end() -> None:
    found = minimise(errors, np.zeros(2), 1, lambda cost: None)
    assert found.shots[0].shape == (3, len(TIME), 1)
    assert np.array_equal(found.shots[0][0], errors(found.z[:, None])[0][0])


def test_bounds_hold() -> None:
    found = minimise(
        lambda z: [20.0 * NOISE * (z[0] - 9.0)[:, None, None] * np.ones((1, 50, 1))], np.zeros(1), 9, print
    )
    assert found.z == 4.0


def test_what_is_not_told_goes_back_and_the_others_follow() -> None:
    spread = covariance(errors(np.column_stack([TRUTH, TRUTH[:, None] + 0.05 * np.eye(2)])))
    assert (np.sqrt(np.diag(spread)) < 0.1).all()
    tied = np.array([[1.0, 0.9], [0.9, 1.0]])
    assert np.allclose(conditioned(np.array([1.0, 1.0]), tied, np.array([True, False])), [0.1, 0.0])
