"""One fit of a lamp: robust least squares over its recordings, open loop, and what it leaves uncertain.

Finite differences run as lanes of one batch (`robolamp.calibrate.lamp.simulation`); those around the last step serve
for the standard errors, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco.minimize
import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.lamp.unknowns import MOST
from robolamp.calibrate.least_squares import Robust, correlation_length, posterior, search

Array = NDArray[np.float64]
Errors = Callable[[Array], list[Array]]
"""From a lamp a column, shape (m, k), to each recording's errors, shape (k, N, n) [rad]; NaN where nothing was read."""

NOISE = 0.010
"""What a residual of the first fit is measured in [rad]: ten times the encoder's noise, for errors of a model last long
(some ten samples at 100 Hz)."""

STEP = 0.05
"""Of finite differences, in standard deviations of the prior: well above what friction makes rough."""

OUTLIER = 5.0
"""A residual of so many NOISE counts as an outlier: beyond it the cost grows but linearly."""

_EVERY = 2  # every second sample counts: neighbours say the same
_WORTH = 0.01  # share of the cost that a step must save for another to follow
_DAMPING = (1.0, 1e6)  # least and most of Levenberg and Marquardt's parameter: from as strong as the priors on
_DAMPING_FACTOR = 4.0


@dataclass(frozen=True)
class Solution:
    """Where a search ended.

    Attributes:
        z: The unknowns there, shape (m,).
        cost: What was minimised, there.
        shots: Errors of each recording, the first lane at the end or one small step before it, and one lane for each
            unknown moved by STEP from there, shape (m + 1, N, n) [rad].
    """

    z: Array
    cost: float
    shots: list[Array]


class _SettledError(Exception):
    """Raised to leave the search: its last step saved too little to go on."""


def minimise(errors: Errors, start: Array, iterations: int, told: Callable[[float], None]) -> Solution:
    """Find the unknowns that explain recordings best.

    It ends where a step saves less than a hundredth of the cost: what follows takes as long as what came before, and
    moves no prediction.

    Args:
        errors: Simulates lamps.
        start: Where to begin, shape (m,).
        iterations: The most steps.
        told: Called with the cost before each step.
    """
    m = len(start)
    norm = Robust(m, OUTLIER)
    best = math.inf, start
    around: list[Array] = []
    fresh = False

    def residual(z: Array) -> Array:
        nonlocal best
        found = residuals(errors(z), z)
        cost = float(norm.value(found))
        if cost < best[0]:
            best = cost, z[:, 0].copy()
        return found

    def jacobian(z: Array, _: Array) -> Array:
        nonlocal around, fresh
        around, fresh = stepped(errors, z[:, 0]), True
        return slopes(around)

    def watch(trace: list[mujoco.minimize.IterLog]) -> None:
        nonlocal fresh
        if not fresh:  # the last call comes after the last step
            return
        fresh = False
        told(float(trace[-1].objective))
        if trace[-1].reduction < _WORTH * trace[-1].objective:
            raise _SettledError

    bound = np.full(m, MOST)
    try:
        search(
            start, residual, jacobian, norm, (-bound, bound), iterations, iter_callback=watch,
            mu_min=np.float64(_DAMPING[0]), mu_max=np.float64(_DAMPING[1]), mu_factor=np.float64(_DAMPING_FACTOR),
        )  # fmt: skip
        around = stepped(errors, best[1])
    except _SettledError:  # the differences are around where the last step began
        pass
    return Solution(best[1], best[0], around)


def stepped(errors: Errors, z: Array) -> list[Array]:
    """Return each recording's errors at a point and with each of its m unknowns moved by STEP, shape (m + 1, N, n)."""
    return errors(np.column_stack([z, z[:, None] + STEP * np.eye(len(z))]))


def residuals(found: Sequence[Array], z: Array) -> Array:
    """Return what is minimised: errors in NOISE, and the priors' own, a column a lane; what is missing pulls nowhere.

    Args:
        found: Each recording's errors, shape (k, N, n) [rad].
        z: The lanes' unknowns, shape (m, k).
    """
    parts = [np.nan_to_num(error[:, ::_EVERY]).reshape(len(error), -1) / NOISE for error in found]
    return np.concatenate([np.concatenate(parts, axis=1).T, z])


def slopes(around: Sequence[Array]) -> Array:
    """Return the residuals' derivatives, from what `stepped` gave: a row a residual, a column an unknown."""
    m = len(around[0]) - 1
    lanes = residuals(around, np.zeros((m, m + 1)))
    moved = (lanes[:, 1:] - lanes[:, :1]) / STEP
    moved[-m:] = np.eye(m)
    return moved


def covariance(shots: Sequence[Array]) -> Array:
    """Return the covariance of the unknowns, prior included, shape (m, m).

    What residuals are worth is found recording by recording and joint by joint: from their size, and from how long they
    resemble each other.

    Args:
        shots: What `stepped` gave at the optimum.
    """
    m = len(shots[0]) - 1
    found, weights = [np.empty((0, m))], [np.empty(0)]
    for error in shots:
        jacobian = (error[1:] - error[0]) / STEP
        for joint in range(error.shape[2]):
            known = np.isfinite(error[0, :, joint])
            if not known.any():
                continue
            left = error[0, known, joint]
            variance = float(np.mean(left * left)) + 1e-8  # and never below the encoder's own 0.1 mrad
            found.append(jacobian[:, known, joint].T)
            weights.append(np.full(len(left), 1.0 / (variance * correlation_length(left))))
    return posterior(np.concatenate(found), np.concatenate(weights))


def conditioned(z: Array, spread: Array, known: NDArray[np.bool_]) -> Array:
    """Return the unknowns where those that are not known are set back to their priors, and the others move with them.

    Args:
        z: All of them at the optimum, shape (m,).
        spread: Covariance of their errors, shape (m, m).
        known: Which of them the recordings told, shape (m,).
    """
    back = np.zeros_like(z)
    pull = np.linalg.solve(spread[np.ix_(~known, ~known)], z[~known]) if (~known).any() else np.empty(0)
    back[known] = z[known] - spread[np.ix_(known, ~known)] @ pull
    return np.clip(back, -MOST, MOST)
