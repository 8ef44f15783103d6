"""Robust least squares with priors: the norm, the search, and what recordings leave uncertain.

    sum over residuals of w delta^2 (sqrt(1 + (r / delta)^2) - 1)  +  1/2 sum z^2

with residuals r, and parameters z in standard deviations of their priors: what the recordings do not tell stays where
it was. `mujoco.minimize.least_squares` does it: bounded, and its Jacobian may be computed for all columns at once.
scipy would be one more dependency.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import mujoco.minimize
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Robust(mujoco.minimize.Norm):
    """Pseudo-Huber loss over the recordings' residuals, beyond delta linear; quadratic over the priors behind them.

    Args:
        priors: How many residuals at the end are priors.
        delta: Where it becomes linear.
        weights: Of the recordings' residuals, shape (r, 1); or one for all.
    """

    def __init__(self, priors: int, delta: float, weights: Array | float = 1.0) -> None:
        self._priors = priors
        self._delta = delta
        self._weights = weights

    def value(self, r: Array) -> np.float64:
        """Return the cost of residuals, shape (r, 1), or (r,) with one weight for all."""
        data, prior = r[: -self._priors], r[-self._priors :]
        cost = self._delta**2 * (np.sqrt(1.0 + (data / self._delta) ** 2) - 1.0)
        return np.float64((self._weights * cost).sum() + 0.5 * (prior * prior).sum())

    def grad_hess(self, r: Array, proj: Array) -> tuple[Array, Array]:  # pyright: ignore (the base returns nothing)
        """Return gradient and Gauss-Newton Hessian of the cost, by what residuals, shape (r, 1), change with."""
        weights = np.ones_like(r)
        weights[: -self._priors] = self.slack(r[: -self._priors])
        return proj.T @ (weights * r), proj.T @ (weights * proj)

    def slack(self, data: Array) -> Array:
        """Return the weight of each of the recordings' residuals: near 0 where it is far beyond delta."""
        return self._weights / np.sqrt(1.0 + (data / self._delta) ** 2)


def search(
    start: Array,
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array, Array], Array],
    norm: Robust,
    bounds: tuple[Array, Array],
    iterations: int,
    **options: Any,
) -> Array:
    """Return where a search from one start ends, shape (n,).

    Args:
        start: Where to begin, shape (n,).
        residual: From points, a column each, to their residuals, priors last, a column each.
        jacobian: From a point, shape (n, 1), and its residuals to their derivatives, shape (r, n).
        norm: What is minimised.
        bounds: Least and greatest values, shape (n,) each.
        iterations: Steps at most.
        **options: Further ones of `mujoco.minimize.least_squares`.
    """
    found, _ = mujoco.minimize.least_squares(
        start, residual, bounds=list(bounds), jacobian=jacobian, norm=norm, max_iter=iterations,
        verbose=mujoco.minimize.Verbosity.SILENT, output=io.StringIO(), **options,
    )  # fmt: skip
    return np.asarray(found, np.float64).reshape(-1)


def posterior(slopes: Array, weights: Array) -> Array:
    """Return the covariance of parameters in standard deviations of their priors, prior included, shape (n, n).

    Args:
        slopes: Of the errors, shape (samples, n).
        weights: Of each sample: the inverse of its variance, by how many samples say as much as one independent one.
    """
    information = slopes.T @ (weights[:, None] * slopes)
    return np.asarray(np.linalg.inv(information + np.eye(slopes.shape[1])), np.float64)


def correlation_length(errors: Array) -> float:
    """Return how many samples say as much as one independent one: neighbours resemble each other.

    It is 1 + 2 times the sum of the autocorrelations up to the first below 0.05 (Bayley and Hammersley 1946).

    Args:
        errors: One after the other in time, shape (N,).
    """
    centred = errors - errors.mean()
    power = np.fft.rfft(centred, 2 * len(centred))
    correlation = np.fft.irfft(power * np.conj(power))[: len(centred)]
    if correlation[0] <= 0:
        return 1.0
    correlation /= correlation[0]
    below = np.flatnonzero(correlation < 0.05)
    return float(1.0 + 2.0 * correlation[1 : below[0] if len(below) else len(correlation)].sum())
