"""Pauses of a run: the servos were gone and came back, and the controller did not drive meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.log.reader import Run

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # s: what sums of times are off by


@dataclass(frozen=True)
class Pause:
    """A stretch in which a run's controller did not drive, though it drove before and afterwards.

    Attributes:
        last: Its last tick before.
        next: Its first tick afterwards.
        begin: When its time stood still, on the run's own clock [s].
        end: When it went on [s].
    """

    last: int
    next: int
    begin: float
    end: float

    @property
    def length(self) -> float:
        """How long the controller's time stood still [s]."""
        return self.end - self.begin


def origin(run: Run) -> float:
    """Return the moment that a run's times are counted from, on its own clock [s]."""
    running = np.flatnonzero(run.phase == "run")
    return float(run.scheduled[running[0] if running.size else 0])


def pauses(run: Run) -> tuple[Pause, ...]:
    """Return the pauses of a run, in order of time.

    How long the controller's time stood is what its terminal t went on by, less than the schedule; where the log has
    no t, all but a control period.

    Args:
        run: The log.
    """
    rows = np.flatnonzero(run.phase == "run")
    found = []
    for cut in np.flatnonzero(np.diff(rows) > 1).tolist():
        last, after = int(rows[cut]), int(rows[cut + 1])
        gap = float(run.scheduled[after] - run.scheduled[last])
        told = driven_time(run, after) - driven_time(run, asked(run, last))
        told += float(run.scheduled[asked(run, last)] - run.scheduled[last])
        went = told if 0.0 <= told <= gap else run.control_period
        begin = float(run.scheduled[last]) + min(went, gap)
        found.append(Pause(last, after, begin, float(run.scheduled[after])))
    return tuple(found)


def driven_time(run: Run, row: int) -> float:
    """Return the controller's time t in each tick [s]; NaN where the log does not say.

    Args:
        run: The log.
        row: The tick.
    """
    terminals = run.terminals
    return float(run.inputs[row, terminals.index("t")]) if "t" in terminals[: run.inputs.shape[1]] else float("nan")


def asked(run: Run, row: int) -> int:
    """Return the last tick, up to one, in which the controller ran: readings may have been lost since."""
    known = np.flatnonzero((run.phase[: row + 1] == "run") & np.isfinite(run.angle[: row + 1]).all(axis=1))
    return int(known[-1]) if known.size else row


def silent(run: Run) -> NDArray[np.bool_]:
    """Return which ticks belong to pauses though they are of phase "run", shape (N,): no servo answered any more.

    Args:
        run: The log.
    """
    found = np.zeros(run.index.size, np.bool_)
    heard = np.flatnonzero(np.isfinite(run.angle).any(axis=1))
    for pause in pauses(run):
        before = heard[heard <= pause.last]
        found[(int(before[-1]) + 1 if before.size else 0) : pause.last + 1] = True
    return found


def paused_before(run: Run, time: Array) -> Array:
    """Return for how long the controller's time had stood still before moments on the run's own clock [s].

    Args:
        run: The log.
        time: Any shape [s].

    Returns:
        Shape of `time` [s]; NaN inside a pause.
    """
    total = np.zeros(np.shape(time))
    for pause in pauses(run):
        over, stands = time >= pause.end - _ROUNDING, time > pause.begin + _ROUNDING
        total = np.where(over, total + pause.length, np.where(stands, np.nan, total))
    return total


def on_clock_of(run: Run, other: Run, time: Array) -> Array:
    """Return when a run's controller was as far as another's was, both from their first tick of phase "run" [s].

    Args:
        run: The run on whose clock it is.
        other: The run whose times they are.
        time: Times on the other's clock, from its first tick of phase "run", any shape [s].

    Returns:
        Times on the run's clock, from its first tick of phase "run" [s]; NaN inside the other's pauses.
    """
    driven = time - paused_before(other, time + origin(other))
    for pause in pauses(run):
        at = pause.begin - origin(run)
        driven = np.where(driven >= at - _ROUNDING, driven + pause.length, driven)
    return driven
