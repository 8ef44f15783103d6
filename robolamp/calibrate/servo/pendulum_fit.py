"""One fit of a servo: robust least squares over recordings of its bench, and what it leaves uncertain.

Residuals of neighbouring samples say the same, so that a recording counts as its duration by their correlation time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.least_squares import Robust, correlation_length, posterior, search
from robolamp.calibrate.servo.fast_pendulum import Pendulum, parameter_set
from robolamp.calibrate.servo.ladder import Chart
from robolamp.dynamixel.registers import RAD_PER_COUNT, VOLTAGE_UNIT

Array = NDArray[np.float64]

SCALE = 0.015
"""What a residual is measured in at first [rad]: what a good model leaves."""

CORRELATION_TIME = 0.25
"""For how long residuals of a servo resemble each other, at first [s]."""

# delta, in scales: where an arm came to rest elsewhere, the residual stays for seconds. On twelve recordings of
# a real servo, dealt into three parts in three ways: recordings left out are predicted 5 % better than with 2
# (by fits begun near one to all: too kind a measure).
_ROBUST = 0.7
_FINE = 0.5  # a fit that leaves less than this share of SCALE is done again in what it leaves
# No servo is known better than to a count, and for neighbouring samples the rounding is alike: without these two, exact
# recordings tell apart by the fifth digit what no recording of a real servo does.
_ALIKE = 0.02  # [s]
# A supply that stands still is read with one and the same rounding, evenly spread over a step: its standard deviation.
_SUPPLY = VOLTAGE_UNIT / np.sqrt(12.0)  # [V]
_DRAWN, _FARTHEST = 256, 2.5  # starts looked at, and how far from a prior's centre in its standard deviations
# Of finite differences, in standard deviations of the prior. Friction makes the valley's floor rough, and what fine
# steps find down there predicts recordings left out worse: each of twelve of a real servo, predicted by a fit from
# draws to the others, is missed by 24.9 mrad with 1 (six seeds), 27.5 with 0.5 (three). Fine steps are for where the
# model explains nearly everything: 0.5 finds out whether it can.
_WIDE, _NARROW, _STEPS = (1.0,), (0.5,), (0.02, 0.1, 0.02, 0.005)
_ENOUGH = 0.99  # of the objective: what is left after another round that is not worth the next


@dataclass(frozen=True)
class Solution:
    """What a fit found.

    Attributes:
        chart: The coordinates.
        z: Parameters, shape (n,).
        objective: What is minimised, with residuals in SCALE and CORRELATION_TIME.
        covariance: Of z, prior included, shape (n, n).
    """

    chart: Chart
    z: Array
    objective: float
    covariance: Array

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name."""
        return self.chart.complete(self.z)


class Problem:
    """Recordings to explain, of which a fit may see a part.

    Args:
        pendulum: The recordings.
        which: Those that are fitted; None: all.
    """

    def __init__(self, pendulum: Pendulum, which: Sequence[int] | None = None) -> None:
        self._pendulum = pendulum
        self._which = list(range(len(pendulum.recordings)) if which is None else which)
        chosen = [pendulum.recordings[index] for index in self._which]
        self._measured = np.concatenate([recording.angle for recording in chosen])
        self._length = [len(recording.angle) for recording in chosen]
        self._duration = [recording.duration for recording in chosen]
        self._step = _WIDE[0]

    def starts(self, chart: Chart, rng: np.random.Generator, count: int) -> list[Array]:
        """Return starts that are worth a fit: the best of many drawn from the priors, the best one first.

        Where an arm comes to rest is a matter of friction, and a fit that begins with far too little or too much of it
        ends in a valley of its own.

        Args:
            chart: What is free.
            rng: Where they are drawn from.
            count: How many.
        """
        drawn = np.clip(rng.standard_normal((_DRAWN, len(chart.names))), -_FARTHEST, _FARTHEST)
        drawn = np.clip(drawn, chart.low, chart.high)
        norm = self._norm(chart, np.full(len(self._length), CORRELATION_TIME))
        found = []
        for part in np.array_split(drawn, _DRAWN // 16):  # no more errors in memory at once than a fit's
            for errors, z in zip(self._errors(chart, part), part, strict=True):
                found.append(float(norm.value(np.concatenate([errors / SCALE, z])[:, None])))
        return [drawn[index] for index in np.argsort(found)[:count]]

    def fit(self, chart: Chart, start: Array, iterations: int = 30) -> Solution:
        """Fit the chart's parameters from one start.

        Args:
            chart: What is free.
            start: Where to begin, shape (n,).
            iterations: Steps at most.
        """
        correlation = np.full(len(self._length), CORRELATION_TIME)
        begin = np.clip(start, chart.low, chart.high)
        solution = self._minimum(chart, begin, SCALE, correlation, iterations, _NARROW)
        size, left = self._left(chart, solution.z)
        if size < _FINE * SCALE:  # what the recordings tell outweighs the priors by more than was assumed
            fine = self._minimum(chart, solution.z, size, left, iterations, _STEPS)
            residuals = np.concatenate([self._errors(chart, fine.z[None])[0] / SCALE, fine.z])
            # Solutions of several starts are compared: all by the same measure.
            return replace(fine, objective=float(self._norm(chart, correlation).value(residuals[:, None])))
        return self._minimum(chart, begin, SCALE, correlation, iterations, _WIDE)

    def _minimum(
        self, chart: Chart, start: Array, scale: float, correlation: Array, iterations: int, steps: Sequence[float]
    ) -> Solution:
        """Minimise the objective with residuals measured in `scale` [rad], slopes with each of `steps` in turn."""
        norm = self._norm(chart, correlation)

        def residual(z: Array) -> Array:
            return np.vstack([self._errors(chart, z[:, 0][None]).T / scale, z])

        def jacobian(z: Array, r: Array) -> Array:
            return np.vstack([self._slopes(chart, z[:, 0]) / scale, np.eye(len(z))])

        z, objective = start, np.inf
        for step in steps:  # over the same valley with another slope
            self._step = step
            z = search(z, residual, jacobian, norm, (chart.low, chart.high), iterations, xtol=1e-4)
            before, objective = objective, float(norm.value(residual(z[:, None])))
            if objective > _ENOUGH * before:
                break
        return Solution(chart, z, objective, self._covariance(chart, z))

    def best(
        self,
        chart: Chart,
        starts: Sequence[Array],
        iterations: int = 30,
        told: Callable[[int, float], None] = lambda _start, _objective: None,
    ) -> Solution:
        """Fit from several starts and return what explains the recordings best.

        Args:
            chart: What is free.
            starts: Where to begin, one or more.
            iterations: Steps at most, each.
            told: Called after each with its number and objective.
        """
        found = []
        for number, start in enumerate(starts):
            found.append(self.fit(chart, start, iterations))
            told(number, found[-1].objective)
        return min(found, key=lambda solution: solution.objective)

    def _errors(self, chart: Chart, z: Array, volts: float = 0.0) -> Array:
        sets = np.stack([parameter_set(chart.complete(row)) for row in z])
        return np.concatenate(self._pendulum.simulate(sets, self._which, volts), axis=1) - self._measured

    def _slopes(self, chart: Chart, z: Array) -> Array:
        """Return central differences of the errors, shape (samples, n): friction makes one-sided ones rough."""
        steps = np.eye(len(z)) * self._step
        up, down = np.minimum(z + steps, chart.high), np.maximum(z - steps, chart.low)
        errors = self._errors(chart, np.vstack([up, down]))
        return ((errors[: len(z)] - errors[len(z) :]) / np.diag(up - down)[:, None]).T

    def _norm(self, chart: Chart, correlation: Array) -> Robust:
        """Return what is minimised, by each recording's correlation time, shape (k,) [s]."""
        parts = [
            np.full(length, max(duration / time, 1.0) / length)
            for length, duration, time in zip(self._length, self._duration, correlation, strict=True)
        ]
        return Robust(len(chart.names), _ROBUST, np.concatenate(parts)[:, None])

    def _covariance(self, chart: Chart, z: Array) -> Array:
        """Return the covariance at a solution, from the residuals' own size and correlation.

        The supply counts as one more unknown that all recordings share: it is read in steps.
        """
        size, correlation = self._left(chart, z)
        norm = self._norm(chart, correlation)
        low, high = (self._errors(chart, z[None], sign * _SUPPLY)[0] for sign in (-1.0, 1.0))
        slopes = np.column_stack([self._slopes(chart, z), (high - low) / 2]) / size
        return posterior(slopes, norm.slack(self._errors(chart, z[None]).T / size)[:, 0])[:-1, :-1]

    def _left(self, chart: Chart, z: Array) -> tuple[float, Array]:
        """Return the residuals' root mean square [rad], and each recording's correlation time, shape (k,) [s]."""
        errors = self._errors(chart, z[None])[0]
        times = [
            max(correlation_length(part) * duration / len(part), _ALIKE)
            for part, duration in zip(np.split(errors, np.cumsum(self._length)[:-1]), self._duration, strict=True)
        ]
        return max(float(np.sqrt(np.mean(errors**2))), RAD_PER_COUNT), np.array(times)
