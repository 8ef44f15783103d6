"""Odometry: how far the lamp has come by its own measure, step by step, over many lanes or one.

A step is a flight, also one too short to count as a hop, or a while without one. It is measured some ticks after the
landing, from all that happened since the step before it was: what the foot creeps between two flights is part of the
way, too. `robolamp.odometer` holds what was learnt.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.odometer import LANDING, TAKEOFF, Odometer

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_KEPT = 64  # ticks; a flight and its windows take 30 at most
_FLIGHT = 2  # ticks without contact that end a step; a gait's last corrections are too short to be hops
_WHILE = 30  # ticks after which a step ends without a flight: a lamp may rock along


class Steps:
    """Cuts what was measured into steps, and gives the features of each once it is over; see `feature_names`.

    Args:
        lanes: Number of lanes.
        joints: Number of joints.
        period: Control period [s].
    """

    def __init__(self, lanes: int, joints: int, period: float) -> None:
        self._joints, self._period = joints, period
        channels = 2 * joints + 2
        self._ring = np.zeros((lanes, _KEPT, channels + 2))  # ... and the sums of force and contact so far
        self._tick = -1
        self._grounded = np.zeros(lanes, np.int64)  # last tick on the ground
        self._takeoff, self._landing = np.zeros(lanes, np.int64), np.full(lanes, -1, np.int64)
        self._began = np.zeros(lanes, np.int64)
        self._beginning = np.zeros((lanes, channels + 2))

    def update(
        self, angle: Array, velocity: Array, force: Array, contact: Array, grounded: NDArray[np.bool_], elapsed: int = 1
    ) -> tuple[Indices, Array]:
        """Take a tick; ticks that were missed are taken to have been like it.

        Args:
            angle: Shape (lanes, joints) [rad].
            velocity: Shape (lanes, joints) [rad/s].
            force: Mean floor force of the tick, shape (lanes,) [N].
            contact: Share of it on the ground, shape (lanes,).
            grounded: Whether the foot is on the ground at its end, shape (lanes,).
            elapsed: Control periods since the last call.

        Returns:
            The lanes that have just finished a step, shape (k,), and its features, shape (k, f).
        """
        lanes, features = np.empty(0, np.int64), np.empty((0, 0))
        row = np.column_stack([angle, velocity, force, contact])
        first = self._tick < 0
        if first:
            self._ring[:, :, :-2] = row[:, None]
        sums = self._ring[:, self._tick % _KEPT, -2:]
        for _ in range(1 if first else elapsed):
            self._tick += 1
            sums = sums + row[:, -2:]
            self._ring[:, self._tick % _KEPT, :-2] = row
            self._ring[:, self._tick % _KEPT, -2:] = sums
        if first:
            self._beginning[:] = self._ring[:, 0]
        tick = self._tick
        landed = grounded & (tick - self._grounded > _FLIGHT)
        pending = self._landing >= 0
        due = pending & ((tick >= self._landing + LANDING[-1]) | landed)
        late = grounded & ~pending & ~landed & (tick - self._began >= _WHILE)
        self._landing[late] = self._takeoff[late] = tick - LANDING[-1]
        due |= late
        if due.any():
            lanes = np.flatnonzero(due)
            features = self._features(lanes)
            self._landing[lanes], self._began[lanes] = -1, tick
            self._beginning[lanes] = self._ring[lanes, tick % _KEPT]
        self._landing[landed], self._takeoff[landed] = tick, self._grounded[landed]
        self._grounded[grounded] = tick
        return lanes, features

    def _features(self, lanes: Indices) -> Array:
        now, joints = self._tick, self._joints
        takeoff, landing = self._takeoff[lanes], self._landing[lanes]

        def at(tick: Indices) -> Array:
            return self._ring[lanes, np.clip(tick, max(now - _KEPT + 1, 0), now) % _KEPT]

        def between(before: Array, after: Array) -> Array:
            """Return how much of force and contact came from after one row to another, (k, 2) [N s], [s]."""
            return (after[:, -2:] - before[:, -2:]) * self._period

        seen = [at(takeoff + offset)[:, :-2] for offset in TAKEOFF]
        seen += [at(landing + offset)[:, :-2] for offset in LANDING]
        start, end = self._beginning[lanes], at(np.full(len(lanes), now))
        lift, touch = at(takeoff - 1), at(landing)
        length = (now - self._began[lanes]) * self._period
        flight, before, after = between(lift, touch), between(start, lift), between(touch, end)
        air = (landing - takeoff + 1) * self._period - flight[:, 1]
        waiting = (takeoff - 1 - self._began[lanes]) * self._period - before[:, 1]
        rebound = (now - landing) * self._period - after[:, 1]
        push = between(at(takeoff + TAKEOFF[0]), at(takeoff))[:, 0]
        rows = [*seen, air, waiting, rebound, length, push, after[:, 0], start[:, :joints]]
        return np.column_stack(rows).astype(np.float64)


class Odometry:
    """Adds up the steps of lanes.

    Args:
        lanes: Number of lanes.
        odometer: What was learnt.

    Attributes:
        way: How far each lane has come, shape (lanes,) [m].
        stderr: Its standard error, shape (lanes,) [m].
        unlike: How many of its steps were unlike those that the odometer was learnt from, shape (lanes,).
    """

    def __init__(self, lanes: int, odometer: Odometer) -> None:
        self._odometer = odometer
        self._steps = Steps(lanes, odometer.joints, odometer.control_period)
        self.way, self.stderr = np.zeros(lanes), np.zeros(lanes)
        self.unlike = np.zeros(lanes, np.int64)
        self._variance, self._sum = np.zeros(lanes), np.zeros(lanes)

    def update(
        self, angle: Array, velocity: Array, force: Array, contact: Array, grounded: NDArray[np.bool_], elapsed: int = 1
    ) -> None:
        """Take a tick; see `Steps.update`."""
        lanes, features = self._steps.update(angle, velocity, force, contact, grounded, elapsed)
        if not len(lanes):
            return
        length, error, unlike = self._odometer.measure(features)
        self.way[lanes] += length
        self.unlike[lanes] += unlike
        self._variance[lanes] += error**2
        self._sum[lanes] += error
        # Errors of one lamp's steps are alike in part: of n equal ones the variance is n (1 - c) + n^2 c of one's.
        share = self._odometer.correlation
        self.stderr[lanes] = np.sqrt((1 - share) * self._variance[lanes] + share * self._sum[lanes] ** 2)
