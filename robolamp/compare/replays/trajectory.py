"""One side of a comparison: what a lamp, or its twin, did, on a clock that begins with the controller's run."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robolamp.compare.align import MIN_SAMPLES, Trace
from robolamp.compare.pauses import on_clock_of, origin
from robolamp.compare.replays.goal_replay import Replay
from robolamp.errors import FileError
from robolamp.log.reader import Run, Truth

Array = NDArray[np.float64]

SLACK = 0.1
"""How much later than a run its truth may begin, and how much earlier end [s]: chosen; a lamp at rest stays there."""


@dataclass(frozen=True)
class Base:
    """How the lamp's base moved; every array has shape (m,).

    Attributes:
        time: [s].
        x: Its centre along the floor, from where it stood [m].
        z: Its height [m].
        pitch: Lean, positive forward [rad].
        angle: True joint angles, shape (m, n) [rad].
    """

    time: Array
    x: Array
    z: Array
    pitch: Array
    angle: Array


@dataclass(frozen=True)
class Side:
    """The motion of one of the two. Times are from the first tick of phase "run" (of the log, where it has none) [s].

    Attributes:
        name: What to call it: "lamp", "twin", or, of two lamps, "lamp" and the log's name.
        time: When each angle was sampled, shape (m, n) [s].
        angle: Joint angles, shape (m, n) [rad]; NaN where missing.
        velocity: Joint velocities, shape (k, n) [rad/s].
        current: Currents, shape (k, n) [A].
        force: Foot sensor, shape (k,) [N].
        tick: When velocities, currents and forces were read, shape (k,) [s].
        hops: Hops by the foot sensor.
        fell: Whether it fell; None where nobody knows.
        travel: How far the base came [m]; NaN where nobody knows.
        base: How the base moved; None where nobody knows.
    """

    name: str
    time: Array
    angle: Array
    velocity: Array
    current: Array
    force: Array
    tick: Array
    hops: int
    fell: bool | None
    travel: float
    base: Base | None

    def trace(self, joint: int) -> Trace:
        """Return a joint's angle."""
        return Trace.of(self.time[:, joint], self.angle[:, joint])

    def on_clock_of(self, run: Run, own: Run) -> Side:
        """Return the side with its times on the clock of another run: what is missing in the pauses of both is NaN.

        Args:
            run: The other run.
            own: The run that this side is of.
        """
        base = self.base
        if base is not None:
            time = on_clock_of(run, own, base.time)
            there = np.isfinite(time)
            base = Base(time[there], base.x[there], base.z[there], base.pitch[there], base.angle[there])
        return replace(self, time=on_clock_of(run, own, self.time), tick=on_clock_of(run, own, self.tick), base=base)


def compared(run: Run) -> NDArray[np.bool_]:
    """Return which ticks are compared, shape (N,): standing still at the start would dilute the errors.

    Args:
        run: The lamp's run.
    """
    running = run.phase == "run"
    return running if np.count_nonzero(running) >= MIN_SAMPLES else np.ones(run.index.size, bool)


def covers(run: Run, truth: Truth) -> bool:
    """Return whether a truth log begins and ends at most `SLACK` inside a run: else its end is not the landing.

    Args:
        run: The log.
        truth: What the emulated lamp truly did.
    """
    first, last = run.at(truth.log_time[[0, -1]])
    return bool(first <= run.began[0] + SLACK and last >= run.write_done[-1] - SLACK)


def of_run(run: Run, truth: Truth | None, name: str) -> Side:
    """Return a log as a side.

    Args:
        run: The log.
        truth: What the emulated lamp truly did, where it is known.
        name: What to call it.

    Raises:
        FileError: The truth is of another run.
    """
    zero = origin(run)
    base, fell, travel = None, None, math.nan
    if truth is not None:
        if sorted(truth.joints) != sorted(run.joints):
            raise FileError(
                f"is of joints {', '.join(truth.joints)}; {run.path} of {', '.join(run.joints)}", str(truth.path)
            )
        at = run.at(truth.log_time)
        begin, end = float(run.began[0]), float(run.write_done[-1])
        if at[-1] < begin or at[0] > end:
            raise FileError(f"has nothing of the time of {run.path}: it is of another run", str(truth.path))
        # After the last tick torque is off, and a lamp that then sinks to the floor has not fallen.
        during = (at >= begin - 0.01) & (at <= end + 0.01)
        start, stop = np.interp([begin, end], at, truth.base_x)
        whole = covers(run, truth)
        travel = float(stop - start) if whole else math.nan
        fell = bool(truth.fallen[during].any()) or (False if whole else None)
        base = Base(
            at[during] - zero, truth.base_x[during] - start, truth.base_z[during], truth.pitch[during],
            truth.angle[during][:, [truth.joints.index(joint) for joint in run.joints]],
        )  # fmt: skip
    return Side(
        name, run.sampled_at - zero, run.angle, run.velocity, run.current, run.foot_force, run.measured_at - zero,
        int(run.hops[-1]), fell, travel, base,
    )  # fmt: skip


def of_replay(run: Run, replay: Replay) -> Side:
    """Return the twin's replay of a log as a side.

    Args:
        run: The log.
        replay: The replay.
    """
    zero = origin(run)
    seen = [tick.observation for tick in replay.ticks]
    begin, end = np.interp([run.began[0], run.write_done[-1]], replay.time, replay.base_x)
    time = replay.time - zero
    return Side(
        name="twin",
        time=np.repeat(time[:, None], replay.angle.shape[1], axis=1),
        angle=replay.angle,
        velocity=np.array([each.velocity for each in seen]),
        current=np.array([each.current for each in seen]),
        force=np.array([each.foot_force for each in seen]),
        tick=np.array([each.time for each in seen]) - zero,
        hops=replay.ticks[-1].hops,
        fell=replay.fell,
        travel=float(end - begin),
        base=Base(time, replay.base_x - begin, replay.base_z, replay.pitch, replay.angle),
    )
