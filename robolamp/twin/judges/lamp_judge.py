"""The judge: what a lamp truly did (hops, flight, falls, travel), from the physics and never from its sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.hop_counter import shortest_flight
from robolamp.jit import njit
from robolamp.twin.judges.run_outcome import RunOutcome
from robolamp.twin.lamp_model import TwinModel

HOP_CLEARANCE = 0.002
"""Height that every point of the foot must reach in a hop [m]."""
HOP_LANDING_TILT = math.radians(15)
"""Largest tilt of the foot at a hop's landing [rad]."""
FALLEN_TILT = math.radians(70)
"""The lamp has fallen when the foot leans more than this [rad] ..."""
FALLEN_HEAD = 0.03
"""... or the head comes closer to the floor than this [m]."""
GOAL_RADIUS = 0.015
"""Distance from the goal that counts as there [m] (Gritz & Hahn 1997: hits)."""
REST_WINDOW = 0.5
"""Time before the end in which a lamp at rest may no longer move [s]."""
REST_MOTION = 0.005
"""How far the base may still move in that window [m]."""

(
    _X,
    _TRAVEL,
    _AIR,
    _HEIGHT,
    _LEAP,
    _FLIGHT,
    _HOPS,
    _BAD,
    _ARRIVAL,
    _AFTER,
    _NEAREST,
    _TILT,
    _MAX_TILT,
    _CLEAR,
    _REST_X,
    _REST,
) = range(16)
_COLUMNS = 16


@njit(nogil=True, error_model="numpy")
def _judge(
    state: NDArray[np.float64],
    fallen: NDArray[np.float64],
    touched: NDArray[np.bool_],
    lanes: NDArray[np.int64],
    qpos: NDArray[np.float64],
    force: NDArray[np.float64],
    head: NDArray[np.float64],
    axis: NDArray[np.float64],
    pole: NDArray[np.float64],
    goal: NDArray[np.float64],
    sizes: tuple[float, float, float],
    time: float,
    timestep: float,
    least: float,
    resting: bool,
) -> None:
    radius, head_radius, head_half = sizes
    for lane in lanes:
        s = state[lane]
        x, z = qpos[lane, 0], qpos[lane, 2]
        up = 1.0 - 2.0 * (qpos[lane, 4] ** 2 + qpos[lane, 5] ** 2)
        up = min(max(up, -1.0), 1.0)
        tilt = math.acos(up)
        clearance = z - radius * math.sqrt(1.0 - up * up)
        moved = abs(x - s[_X])
        s[_X] = x
        s[_TRAVEL] += moved
        s[_TILT] = tilt
        s[_MAX_TILT] = max(s[_MAX_TILT], tilt)
        s[_CLEAR] = clearance
        if force[lane] > 0.0:
            if s[_AIR] >= least and s[_HEIGHT] >= HOP_CLEARANCE:
                if tilt <= HOP_LANDING_TILT:
                    s[_HOPS] += 1.0
                    s[_FLIGHT] += s[_LEAP]
                else:
                    s[_BAD] += 1.0
            s[_AIR] = 0.0
            s[_HEIGHT] = 0.0
            s[_LEAP] = 0.0
        else:
            s[_AIR] += timestep
            s[_HEIGHT] = max(s[_HEIGHT], clearance)
            s[_LEAP] += moved
        distance = abs(x - goal[lane])
        s[_NEAREST] = min(s[_NEAREST], distance)
        if not math.isnan(s[_ARRIVAL]):
            s[_AFTER] += moved
        elif distance <= GOAL_RADIUS:
            s[_ARRIVAL] = time
        if resting:
            if math.isnan(s[_REST_X]):
                s[_REST_X] = x
            s[_REST] = max(s[_REST], abs(x - s[_REST_X]))
        upright = min(max(axis[lane], -1.0), 1.0)
        lowest = head[lane] - head_radius * math.sqrt(1.0 - upright * upright) - head_half * abs(upright)
        if pole[lane] > 0.0:
            touched[lane] = True
        if math.isnan(fallen[lane]) and (tilt > FALLEN_TILT or lowest < FALLEN_HEAD or not math.isfinite(x + z)):
            fallen[lane] = time


@dataclass(frozen=True)
class Outcome(RunOutcome):
    """What each lane's lamp did; see `RunOutcome` for what is told of any run.

    Attributes:
        goal: Where it was sent [m].
        goal_time: Time it was told to take for the way [s]; 0 where it was not told.
        x: Base centre at the end [m].
        nearest: Smallest distance from the goal on the way [m].
        travel: Path length of the base centre along x [m].
        flight: Part of it spent in hops [m].
        hops: Hops: off the floor for lamp.toml's flight_time, cleared by 2 mm, landed within 15 degrees of flat.
        bad_landings: Flights that landed more tilted than that.
        fall_time: When it fell [s]; NaN if it did not.
        arrival: When it first came within 1.5 cm of the goal [s]; NaN if it did not.
        travel_after: Path length after that [m].
        tilt: Tilt of the foot at the end [rad].
        max_tilt: Largest tilt [rad].
        motion: How far the base moved in the last half second [m].
        pole: It touched the pole.
        pose_error: Mean over the key poses of the mean |joint angle - wanted| [rad]; 0 without key poses.
        unstable: The simulation diverged; also counted as fallen.
    """

    goal_time: NDArray[np.float64]
    x: NDArray[np.float64]
    travel: NDArray[np.float64]
    flight: NDArray[np.float64]
    bad_landings: NDArray[np.float64]
    fall_time: NDArray[np.float64]
    travel_after: NDArray[np.float64]
    max_tilt: NDArray[np.float64]
    motion: NDArray[np.float64]
    pole: NDArray[np.bool_]
    pose_error: NDArray[np.float64]

    @property
    def fallen(self) -> NDArray[np.bool_]:
        """Whether each lamp fell."""
        return ~np.isnan(self.fall_time)

    @property
    def error(self) -> NDArray[np.float64]:
        """Where each landed beyond (positive) or short of (negative) its goal [m]."""
        return self.x - self.goal

    @property
    def flight_share(self) -> NDArray[np.float64]:
        """Part of the travel spent in hops; NaN below 1 cm of travel."""
        return np.where(self.travel < 0.01, np.nan, self.flight / np.maximum(self.travel, 0.01))

    @property
    def upright(self) -> NDArray[np.bool_]:
        """Stands within 15 degrees of flat at the end, and has not fallen."""
        return (self.tilt <= HOP_LANDING_TILT) & ~self.fallen

    @property
    def hit(self) -> NDArray[np.bool_]:
        """At rest within 1.5 cm of the goal, upright, at the end."""
        return (np.abs(self.error) <= GOAL_RADIUS) & (self.motion <= REST_MOTION) & self.upright

    @property
    def hit_1997(self) -> NDArray[np.bool_]:
        """Came within 1.5 cm of the goal at some time (Gritz & Hahn 1997), but not by a simulation that diverged."""
        return (self.nearest <= GOAL_RADIUS) & ~self.unstable


class Judge:
    """Follows many lanes step by step.

    Args:
        twin: The lamp (its sizes).
        goal: Goal of each lane, shape (lanes,) [m].
        duration: Length of the run [s].
    """

    def __init__(self, twin: TwinModel, goal: NDArray[np.float64], duration: float) -> None:
        self._sizes = (twin.foot_radius, *twin.head_size)
        self._timestep = twin.timestep
        self._least = shortest_flight(twin.lamp.flight_time, twin.timestep)
        self._duration = duration
        self._time = 0.0
        self._goal = goal
        self._state = np.zeros((len(goal), _COLUMNS))
        self._state[:, [_ARRIVAL, _REST_X]] = np.nan
        self._state[:, _NEAREST] = np.inf
        self.fall_time = np.full(len(goal), np.nan)
        self._touched = np.zeros(len(goal), bool)
        self._no_pole = np.zeros(len(goal))

    def begin(self, x: NDArray[np.float64]) -> None:
        """Take the base's position at the start, shape (lanes,) [m]."""
        self._state[:, _X] = x

    def step(
        self,
        lanes: NDArray[np.int64],
        qpos: NDArray[np.float64],
        force: NDArray[np.float64],
        head: NDArray[np.float64],
        axis: NDArray[np.float64],
        pole: NDArray[np.float64] | None = None,
    ) -> None:
        """Take one physics step of some lanes.

        Args:
            lanes: Which lanes were stepped.
            qpos: Positions, the base's free joint first, shape (lanes, nq).
            force: True floor force on the foot, shape (lanes,) [N].
            head: Height of the head's centre, shape (lanes,) [m].
            axis: Vertical part of the head's axis, shape (lanes,).
            pole: Force on the pole, shape (lanes,) [N]; None without a pole.
        """
        self._time += self._timestep
        resting = self._time > self._duration - REST_WINDOW
        _judge(
            self._state, self.fall_time, self._touched, lanes, qpos, force, head, axis,
            self._no_pole if pole is None else pole, self._goal, self._sizes, self._time, self._timestep,
            self._least, resting,
        )  # fmt: skip

    @property
    def goal_met(self) -> NDArray[np.float64]:
        """1 once a lane has come within 1.5 cm of its goal, else 0; shape (lanes,)."""
        return np.where(np.isnan(self._state[:, _ARRIVAL]), 0.0, 1.0)

    @property
    def tilt(self) -> NDArray[np.float64]:
        """Present tilt of the foot, shape (lanes,) [rad]."""
        return self._state[:, _TILT]

    @property
    def clearance(self) -> NDArray[np.float64]:
        """Present height of the foot's lowest point, shape (lanes,) [m]."""
        return self._state[:, _CLEAR]

    @property
    def hops(self) -> NDArray[np.float64]:
        """Hops so far, shape (lanes,)."""
        return self._state[:, _HOPS]

    def outcome(
        self,
        angles: NDArray[np.float64],
        unstable: NDArray[np.bool_],
        interventions: NDArray[np.int64],
        pose_error: NDArray[np.float64] | None = None,
        goal_time: NDArray[np.float64] | None = None,
    ) -> Outcome:
        """Return the verdicts.

        Args:
            angles: Joint angles at the end, shape (lanes, n) [rad].
            unstable: Lanes whose simulation diverged, shape (lanes,).
            interventions: Of the envelope, shape (lanes,).
            pose_error: See `Outcome`, shape (lanes,) [rad]; None: there were no key poses.
            goal_time: See `Outcome`, shape (lanes,) [s]; None: it was not told.
        """
        s = self._state
        nothing = np.zeros(len(self._goal))
        return Outcome(
            goal=self._goal,
            goal_time=nothing if goal_time is None else goal_time,
            duration=np.full(len(self._goal), self._duration),
            x=s[:, _X].copy(),
            nearest=s[:, _NEAREST].copy(),
            travel=s[:, _TRAVEL].copy(),
            flight=s[:, _FLIGHT].copy(),
            hops=s[:, _HOPS].copy(),
            bad_landings=s[:, _BAD].copy(),
            fall_time=self.fall_time.copy(),
            arrival=s[:, _ARRIVAL].copy(),
            travel_after=s[:, _AFTER].copy(),
            tilt=s[:, _TILT].copy(),
            max_tilt=s[:, _MAX_TILT].copy(),
            angles=angles,
            motion=np.where(np.isnan(s[:, _REST_X]), np.inf, s[:, _REST]),
            pole=self._touched.copy(),
            pose_error=nothing if pose_error is None else pose_error,
            unstable=unstable,
            interventions=interventions,
        )
