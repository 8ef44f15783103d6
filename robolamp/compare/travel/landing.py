"""Where a lamp came to rest, and which of its hops flew: by the truth log or a ruler, never by its sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robolamp.compare.pauses import origin
from robolamp.compare.replays.trajectory import covers
from robolamp.lamp import Lamp
from robolamp.log.reader import Run, Truth
from robolamp.twin.judges.lamp_judge import REST_WINDOW
from robolamp.twin.judges.true_flights import flown


@dataclass(frozen=True)
class Landing:
    """What is known of a run's end. NaN and None: nobody knows.

    Attributes:
        travel: How far the base came, from the controller's first tick to the end of the log [m].
        motion: How far it still moved in the last half second that the controller drove [m].
        tilt: Lean of the foot at the end [rad].
        fell: Whether it fell.
        flown: Hops that flew: off the floor, 2 mm clear of it, landed within 15 degrees of flat.
    """

    travel: float = math.nan
    motion: float = math.nan
    tilt: float = math.nan
    fell: bool | None = None
    flown: int | None = None


def landing_of(run: Run, truth: Truth | None, lamp: Lamp) -> Landing:
    """Return a run's end by its truth log; nothing if there is no truth log or it does not cover the run.

    Args:
        run: The log.
        truth: What the emulated lamp truly did.
        lamp: Tells from which time on a flight is one.
    """
    if truth is None:
        return Landing()
    at, zero = run.at(truth.log_time), origin(run)
    rows = np.flatnonzero(run.phase == "run")
    begin, end = float(run.began[0]), float(run.write_done[-1])
    stop = float(run.scheduled[rows[-1]]) + run.control_period if rows.size else end
    fell = bool(truth.fallen[(at >= begin) & (at <= end)].any())
    if not covers(run, truth):
        return Landing(fell=fell or None)
    start, last = np.interp([zero, end], at, truth.base_x)
    resting = truth.base_x[(at >= stop - REST_WINDOW) & (at <= stop)]
    return Landing(
        travel=float(last - start),
        motion=float(np.abs(resting - resting[0]).max()) if resting.size else math.nan,
        tilt=float(abs(np.interp(end, at, truth.pitch))),
        fell=fell,
        flown=flown(run, truth, lamp).hops,
    )
