"""Aligns two recordings of a joint and measures what is left: the lag first, then the error without it.

Lag by cross-correlation with sub-sample precision. Dynamic time warping is not used: it hides latency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAG_STEP = 0.004
"""Step between the lags tried [s]; a parabola finds the peak between them."""
MIN_SAMPLES = 10
"""Fewer shared samples than this do not make a correlation."""
LEAST_SHARE = 0.5
"""Share of the readings below which a mean of them stands for nothing. Chosen: the half that is missing may be the half
that differs, and readings get lost where the lamp moves most."""
MAX_LAG = 0.2
"""Longest lag looked for [s]: ten control periods; a servo bus that is later than this is not a lag but a fault."""
MAX_GAP = 2.5
"""Samples further apart than this many typical periods have a gap between them: nothing is interpolated there."""
STILL = 0.01
"""A joint that varies less than this (standard deviation) in either recording has no lag to find [rad]: what sags and
sticks by a few encoder counts looks like motion, but not like the same motion."""
LIKENESS = 0.8
"""Correlation below which two recordings are not the same motion, and have no lag."""
WINDOW = 2.0
"""Length of the stretches whose lags are compared to find a drift [s]."""
MIN_WINDOWS = 4
"""Fewer stretches with a lag of their own than this tell no drift."""
_RESOLUTION = 1e-9  # samples closer than a log's time stamps can tell apart are one [s]


@dataclass(frozen=True)
class Error:
    """How far two recordings are apart.

    Attributes:
        mae: Mean absolute error [rad].
        rmse: Root of the mean squared error [rad].
        bias: Mean error, lamp minus twin [rad].
        worst: Largest error, lamp minus twin [rad].
        worst_at: When, on the run's clock [s].
    """

    mae: float
    rmse: float
    bias: float
    worst: float
    worst_at: float


@dataclass(frozen=True)
class JointError:
    """One joint's comparison.

    Attributes:
        name: The joint.
        lag: How much later the lamp is than the twin [s]; NaN where the two do not show one motion.
        before: Errors as recorded.
        after: Errors with the lag removed.
        swing: Size of the lamp's motion per size of the twin's (ratio of standard deviations, lag removed).
        drift: How fast the lag grows: seconds a second; NaN where the recording is too short to tell.
        drift_stderr: Its standard error.
        samples: Lamp samples compared, of `of` samples in the log; where they are too few, errors and lag are NaN.
        of: Samples in the log.
    """

    name: str
    lag: float
    before: Error
    after: Error
    swing: float
    drift: float
    drift_stderr: float
    samples: int
    of: int

    @property
    def known(self) -> bool:
        """Whether there are enough readings to say anything."""
        return enough(self.samples, self.of)


def enough(samples: int, of: int) -> bool:
    """Return whether there are enough readings to judge a joint by.

    Args:
        samples: Readings that are known.
        of: Readings that there should be.
    """
    return samples > 0 and samples >= LEAST_SHARE * of


@dataclass(frozen=True)
class Trace:
    """A signal sampled at uneven times, without its missing samples.

    Attributes:
        time: Strictly increasing, shape (m,) [s].
        value: Shape (m,).
        slope: Derivative at the samples, shape (m,): second-order differences.
        gap: Longest distance between neighbours that is interpolated over [s].
    """

    time: Array
    value: Array
    slope: Array
    gap: float

    @classmethod
    def of(cls, time: Array, value: Array) -> Trace:
        """Return a trace of the samples that are there.

        Args:
            time: Sample times, shape (m,) [s].
            value: Values, shape (m,); NaN where missing.
        """
        there = np.isfinite(time) & np.isfinite(value)
        time, value = time[there], value[there]
        rising = np.ones(time.size, bool)
        rising[1:] = time[1:] > np.maximum.accumulate(time)[:-1] + _RESOLUTION
        time, value = time[rising], value[rising]
        if time.size < 2:
            return cls(time, value, np.zeros(time.size), 0.0)
        return cls(time, value, np.gradient(value, time), MAX_GAP * float(np.median(np.diff(time))))

    def part(self, begin: float, end: float) -> Trace:
        """Return the samples from one time to another [s]."""
        first, last = np.searchsorted(self.time, [begin, end])
        return Trace(self.time[first:last], self.value[first:last], self.slope[first:last], self.gap)

    def at(self, time: Array) -> Array:
        """Return the signal at other times, NaN outside the trace and inside its gaps.

        Cubic Hermite interpolation: a line between samples would flatten a moving joint's peaks and pull the lag
        towards whole samples.

        Args:
            time: Any shape [s].
        """
        if self.time.size < 2:
            return np.full(np.shape(time), np.nan)
        left = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, self.time.size - 2)
        width = self.time[left + 1] - self.time[left]
        s = (time - self.time[left]) / width
        value = (
            (1 + 2 * s) * (1 - s) ** 2 * self.value[left]
            + s * (1 - s) ** 2 * width * self.slope[left]
            + s**2 * (3 - 2 * s) * self.value[left + 1]
            + s**2 * (s - 1) * width * self.slope[left + 1]
        )
        inside = (time >= self.time[0]) & (time <= self.time[-1]) & (width <= self.gap)
        return np.where(inside, value, np.nan)


def find_lag(twin: Trace, lamp: Trace) -> float:
    """Return how much later the lamp's trace is than the twin's [s]; NaN where the two moved too differently.

    The peak of the normalised cross-correlation over shifts of LAG_STEP, refined by a parabola through it and its
    neighbours. The twin is shifted and read at the lamp's own samples: nothing of the lamp is interpolated.

    Args:
        twin: The reference.
        lamp: What is compared with it.
    """
    reach = round(MAX_LAG / LAG_STEP)
    lags = np.arange(-reach, reach + 1) * LAG_STEP
    scores = np.array([_correlation(twin.at(lamp.time - lag), lamp.value) for lag in lags])
    if not np.max(scores, initial=0.0, where=np.isfinite(scores)) >= LIKENESS:
        return float("nan")
    peak = int(np.nanargmax(scores))
    if peak in (0, lags.size - 1) or not np.isfinite(scores[peak - 1 : peak + 2]).all():
        return float(lags[peak])
    below, top, above = scores[peak - 1 : peak + 2]
    curve = below - 2 * top + above
    return float(lags[peak] + (0.5 * (below - above) / curve * LAG_STEP if curve < 0 else 0.0))


def find_drift(twin: Trace, lamp: Trace) -> tuple[float, float]:
    """Return how fast the lamp's lag grows, and the standard error of that [s/s]; NaN where it cannot be found.

    A line through the lags of stretches of WINDOW seconds (Theil-Sen: the median of the slopes of all pairs, so that
    a stretch with a wrong peak does no harm).

    Args:
        twin: The reference.
        lamp: What is compared with it.
    """
    unknown = (math.nan, math.nan)
    if lamp.time.size < MIN_SAMPLES or lamp.time[-1] - lamp.time[0] < MIN_WINDOWS * WINDOW:
        return unknown
    starts = np.linspace(lamp.time[0], lamp.time[-1] - WINDOW, min(int((lamp.time[-1] - lamp.time[0]) / WINDOW), 60))
    middles, lags = [], []
    for start in starts:
        part = lamp.part(start, start + WINDOW)
        lag = find_lag(twin.part(start - MAX_LAG - WINDOW / 4, start + WINDOW * 1.25 + MAX_LAG), part)
        if math.isfinite(lag):
            middles.append(start + WINDOW / 2)
            lags.append(lag)
    if len(lags) < MIN_WINDOWS:
        return unknown
    time, lag = np.array(middles), np.array(lags)
    first, second = np.triu_indices(time.size, 1)
    slopes = (lag[second] - lag[first]) / (time[second] - time[first])
    slope = float(np.median(slopes))
    left = lag - slope * time
    spread = 1.4826 * float(np.median(np.abs(left - np.median(left))))
    return slope, spread / (float(time.std()) * math.sqrt(time.size))


def _correlation(a: Array, b: Array) -> float:
    both = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(both) < MIN_SAMPLES:
        return float("nan")
    a, b = a[both] - a[both].mean(), b[both] - b[both].mean()
    spread_a, spread_b = a.std(), b.std()
    if spread_a < STILL or spread_b < STILL:
        return float("nan")
    return float((a * b).mean() / (spread_a * spread_b))


def measure(twin: Trace, lamp: Trace, lag: float = 0.0) -> tuple[Error, Array]:
    """Return the errors with a lag removed, and the residual (lamp minus twin) at the lamp's samples [rad].

    Args:
        twin: The reference.
        lamp: What is compared with it.
        lag: How much later the lamp is [s].
    """
    residual = lamp.value - twin.at(lamp.time - lag)
    there = np.isfinite(residual)
    if not there.any():
        gap = float("nan")
        return Error(gap, gap, gap, gap, gap), residual
    error = residual[there]
    worst = int(np.argmax(np.abs(error)))
    return Error(
        mae=float(np.abs(error).mean()),
        rmse=float(np.sqrt((error**2).mean())),
        bias=float(error.mean()),
        worst=float(error[worst]),
        worst_at=float(lamp.time[there][worst]),
    ), residual


def compare_joint(name: str, twin: Trace, lamp: Trace, of: int) -> JointError:
    """Return one joint's comparison.

    Args:
        name: The joint.
        twin: Its angle in the twin [rad].
        lamp: Its angle as the lamp measured it [rad].
        of: Samples in the log, the missing ones included.
    """
    lag = find_lag(twin, lamp)
    shift = lag if np.isfinite(lag) else 0.0
    before, _ = measure(twin, lamp)
    after, residual = measure(twin, lamp, shift)
    there = np.isfinite(residual)
    reference = lamp.value[there] - residual[there]
    spread = float(reference.std()) if there.any() else 0.0
    swing = float(lamp.value[there].std()) / spread if spread > STILL else float("nan")
    samples = int(np.count_nonzero(there))
    if not enough(samples, of):
        unknown = Error(*(math.nan,) * 5)
        return JointError(name, math.nan, unknown, unknown, math.nan, math.nan, math.nan, samples, of)
    drift, stderr = find_drift(twin, lamp)
    return JointError(name, lag, before, after, swing, drift, stderr, samples, of)
