"""The difference over time and frequency: when the two diverge for good, and what happened then.

Also the mean differences of everything measured besides angles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.compare.align import JointError, enough
from robolamp.compare.pauses import origin, paused_before
from robolamp.compare.replays.trajectory import Side
from robolamp.compare.travel.sensed_flights import Hop
from robolamp.log.reader import Run

Array = NDArray[np.float64]

WINDOW = 0.2
"""Length over which the error is averaged (RMS) to say whether the two are apart [s]."""
NEAR = 0.06
"""What happened this long before and after is "just then" [s]."""
SAG = 0.2
"""Fall of the supply that is worth a word [V]; servos report steps of 0.1 V."""
SATURATED = 0.98
"""Duty from which on a servo gives all it has."""
BANDS = (0.0, 1.0, 3.0, 6.0, 12.0)
"""Lower ends of the bands of frequency [Hz]; the last reaches up to half the rate of the readings."""


@dataclass(frozen=True)
class Parting:
    """When the two part.

    Attributes:
        time: From when on they are apart for good, since the controller's first tick [s]; NaN: not for good.
        joint: What leaves first, a joint or "base"; empty where they are never apart.
        just_then: What happened within NEAR seconds of it, in words.
        first: When they are apart for the first time [s]; NaN: never.
        last: From when on they are together again [s]; NaN: never apart, or for good.
    """

    time: float
    joint: str
    just_then: tuple[str, ...]
    first: float = math.nan
    last: float = math.nan


@dataclass(frozen=True)
class Spectrum:
    """Where in frequency one joint's error lies.

    Attributes:
        name: The joint.
        bands: RMS of the error in each of BANDS, shape (5,) [rad]; NaN where the recording is too short.
    """

    name: str
    bands: Array


@dataclass(frozen=True)
class Plain:
    """Mean absolute differences of what is measured besides angles.

    Attributes:
        velocity: Of each joint's velocity, shape (n,) [rad/s].
        current: Of each servo's current, shape (n,) [A].
        force: Of the foot's force [N].
    """

    velocity: Array
    current: Array
    force: float


def residuals(run: Run, lamp: Side, twin: Side, joints: Sequence[JointError]) -> list[tuple[Array, Array]]:
    """Return times and errors of each joint with its lag removed, lamp less twin [rad]; only where both are known.

    Args:
        run: The lamp's log: what was read in its pauses is left out.
        lamp: The lamp.
        twin: Its reference.
        joints: Gives the lags.
    """
    found = []
    for index, joint in enumerate(joints):
        trace, reference = lamp.trace(index), twin.trace(index)
        lag = joint.lag if math.isfinite(joint.lag) else 0.0
        error = trace.value - reference.at(trace.time - lag)
        there = np.isfinite(error) & np.isfinite(paused_before(run, trace.time + origin(run)))
        found.append((trace.time[there], error[there]))
    return found


def parting(
    run: Run,
    lamp: Side,
    twin: Side,
    joints: Sequence[JointError],
    hops: Sequence[Hop],
    allowed: float,
    travel: float,
) -> Parting:
    """Return when an error (RMS over WINDOW) exceeds its tolerance, and whether it comes back within it during the run.

    Args:
        run: The lamp's log.
        lamp: The lamp.
        twin: Its reference.
        joints: The differences.
        hops: The hops of both.
        allowed: Error of a joint from which on they are apart [rad].
        travel: The same of the base's travel, where both are known [m].
    """
    ends = run.scheduled[run.phase == "run"]
    end = float(ends[-1]) - origin(run) if ends.size else math.inf
    pairs = zip(joints, residuals(run, lamp, twin, joints), strict=True)
    errors = [(joint.name, *pair, allowed) for joint, pair in pairs]
    if lamp.base is not None and twin.base is not None:
        way = lamp.base.x - np.interp(lamp.base.time, twin.base.time, twin.base.x)
        errors.append(("base", lamp.base.time, way, travel))
    for_good: list[tuple[float, str]] = []
    at_all: list[tuple[float, str]] = []
    back = -math.inf
    for name, whole, apart, most in errors:
        during = (whole >= 0.0) & (whole <= end) & np.isfinite(paused_before(run, whole + origin(run)))
        time, error = whole[during], apart[during]
        if time.size < 2:
            continue
        width = min(max(1, round(WINDOW / float(np.median(np.diff(time))))), time.size)
        near = np.ones(width)
        counted = np.convolve(np.ones(time.size), near, mode="same")  # fewer at the ends
        level = np.sqrt(np.convolve(error**2, near, mode="same") / counted)
        outside = np.flatnonzero(level > most)
        if not outside.size:
            continue
        at_all.append((float(time[outside[0]]), name))
        if outside[-1] < time.size - 1:
            back = max(back, float(time[outside[-1] + 1]))  # together at the end
            continue
        inside = np.flatnonzero(level <= most)
        for_good.append((float(time[inside[-1] + 1]) if inside.size else float(time[0]), name))
    if not at_all:
        return Parting(math.nan, "", ())
    first = min(at_all)[0]
    time, name = min(for_good or at_all)
    just_then = tuple(_around(run, time, hops, (lamp.name, twin.name)))
    return Parting(time, name, just_then, first) if for_good else Parting(math.nan, name, just_then, first, back)


def _around(run: Run, time: float, hops: Sequence[Hop], names: tuple[str, str]) -> Iterator[str]:
    """Yield what happened within NEAR seconds of a moment."""
    near = np.abs(run.began - origin(run) - time) <= NEAR
    for number, hop in enumerate(hops, start=1):
        for word, lamp, twin in (
            ("take-off", hop.lamp and hop.lamp.off, hop.twin and hop.twin.off),
            ("landing", hop.lamp and hop.lamp.on, hop.twin and hop.twin.on),
        ):
            if any(moment is not None and abs(moment - time) <= NEAR for moment in (lamp, twin)):
                who = (
                    ""
                    if lamp is not None and twin is not None
                    else f" of the {names[0] if lamp is not None else names[1]} alone"
                )
                yield f"{word} {number}{who}"
    for index, joint in enumerate(run.joints):
        if (np.abs(run.pwm[near, index]) >= SATURATED).any():
            yield f"the {joint}'s servo gave all it had"
    known = run.voltage[np.isfinite(run.voltage)]
    if known.size and np.isfinite(run.voltage[near]).any():
        low = float(np.nanmin(run.voltage[near]))
        if np.median(known) - low >= SAG:
            yield f"the supply sagged to {low:.1f} V"
    for fault in dict.fromkeys(text for row in np.flatnonzero(near) for text in run.faults[row]):
        yield f"fault: {fault}"
    rows = np.flatnonzero(near)
    if rows.size > 1:
        slots = np.diff(run.scheduled[rows]) / run.control_period
        if slots.max() > 1.5:
            yield f"{round(slots.max()) - 1} ticks were missed"


def spectrum(name: str, time: Array, error: Array) -> Spectrum:
    """Return the RMS of an error band by band.

    A Hann window of the whole stretch, its errors read on an even grid; the bands' squares add up to the RMS squared.

    Args:
        name: The joint.
        time: Shape (m,) [s].
        error: Shape (m,) [rad].
    """
    if time.size < 32:
        return Spectrum(name, np.full(len(BANDS), np.nan))
    period = float(np.median(np.diff(time)))
    grid = np.arange(time[0], time[-1], period)
    even = np.interp(grid, time, error)
    window = np.hanning(even.size)
    power = np.abs(np.fft.rfft(even * window)) ** 2
    power[1:] *= 2  # both signs of a frequency
    power /= even.size * (window**2).sum()
    frequency = np.fft.rfftfreq(even.size, period)
    edges = (*BANDS[1:], math.inf)
    bands = [power[(frequency >= low) & (frequency < high)].sum() for low, high in zip(BANDS, edges, strict=True)]
    return Spectrum(name, np.sqrt(np.array(bands)))


def plain(lamp: Side, twin: Side, rows: NDArray[np.bool_]) -> Plain:
    """Return the mean absolute differences of velocities, currents and force, NaN where nothing is known.

    Args:
        lamp: The lamp.
        twin: Its reference.
        rows: The lamp's ticks that count, shape (k,).
    """
    tick = lamp.tick[rows]

    def off(ours: Array, theirs: Array) -> float:
        there = np.isfinite(twin.tick) & np.isfinite(theirs)
        if there.sum() < 2:
            return math.nan
        error = np.abs(ours - np.interp(tick, twin.tick[there], theirs[there], math.nan, math.nan))
        known = error[np.isfinite(error)]
        return float(known.mean()) if enough(known.size, error.size) else math.nan

    n = lamp.angle.shape[1]
    return Plain(
        velocity=np.array([off(lamp.velocity[rows, j], twin.velocity[:, j]) for j in range(n)]),
        current=np.array([off(lamp.current[rows, j], twin.current[:, j]) for j in range(n)]),
        force=off(lamp.force[rows], twin.force),
    )
