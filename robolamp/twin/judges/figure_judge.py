"""The verdict on a figure's run: how near it came to its goal, and in what style (Kwasnicka & Wozniak, section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.jit import njit
from robolamp.twin.figure_model import FigureTwin
from robolamp.twin.judges.run_outcome import RunOutcome

JUMP_AIR_TIME = 0.04
"""Shortest time that nothing carries a figure which counts as a jump [s]: chosen; their joints are rigid and do not
rebound as the lamp's do, whose time is in lamp.toml."""
IDLE_SPEED = 0.1
"""A figure is idle while no joint turns faster than this [rad/s], and it is not at its goal: our choice, the paper only
says that it punishes "too long idleness"."""

_NEAREST, _ARRIVAL, _IDLE, _COLLISION, _AIR, _JUMPS, _ALOFT, _GAIN, _FROM = range(9)
_COLUMNS = 9


@njit(nogil=True, error_model="numpy")
def way_to_goal(
    sensors: NDArray[np.float64], point: NDArray[np.float64], lane: int, root: int, goal: int
) -> tuple[float, float]:
    """Return the way from a figure's root to its goal, in the plane [m].

    Args:
        sensors: `sensordata`, shape (lanes, k).
        point: The goal, shape (lanes, 2) [m].
        lane: Which lane.
        root: Address of the root's position.
        goal: Address of the position of the body at the goal, which counts then; -1: the point counts.
    """
    x, y = point[lane, 0], point[lane, 1]
    if goal >= 0:
        x, y = sensors[lane, goal], sensors[lane, goal + 1]
    return x - sensors[lane, root], y - sensors[lane, root + 1]


@njit(nogil=True, error_model="numpy")
def _follow(
    state: NDArray[np.float64],
    lanes: NDArray[np.int64],
    sensors: NDArray[np.float64],
    qvel: NDArray[np.float64],
    point: NDArray[np.float64],
    dof: NDArray[np.int64],
    where: tuple[int, int, int, int],
    radius: float,
    time: float,
    timestep: float,
) -> None:
    root, goal, unsafe, support = where
    for lane in lanes:
        s = state[lane]
        x, y = way_to_goal(sensors, point, lane, root, goal)
        distance = math.sqrt(x * x + y * y)
        s[_NEAREST] = min(s[_NEAREST], distance)
        fastest = 0.0
        for joint in dof:
            fastest = max(fastest, abs(qvel[lane, joint]))
        if distance > radius and fastest <= IDLE_SPEED:
            s[_IDLE] += timestep
        if distance <= radius and math.isnan(s[_ARRIVAL]):
            s[_ARRIVAL] = time
        if sensors[lane, unsafe] > 0.0 and math.isnan(s[_COLLISION]):
            s[_COLLISION] = time
        if sensors[lane, support] > 0.0:
            if s[_AIR] >= JUMP_AIR_TIME:
                s[_JUMPS] += 1.0
                s[_ALOFT] += s[_AIR]
                s[_GAIN] += s[_FROM] - distance
            s[_AIR], s[_FROM] = 0.0, distance
        else:
            s[_AIR] += timestep


@dataclass(frozen=True)
class FigureOutcome(RunOutcome):
    """What each lane's figure did; see `RunOutcome` for what is told of any run.

    Attributes:
        goal: Distance of the goal at the start [m].
        direction: Its direction, from x towards y [rad].
        error: Distance of the root's centre from the goal, in the plane, at the end [m].
        nearest: Smallest such distance on the way [m].
        arrival: When it first came within the figure's radius [s]; NaN if it did not.
        idle: Time spent idle away from the goal [s], see `IDLE_SPEED`.
        collision: When what must not be touched was touched first [s]; NaN if it was not.
        tilt: Tilt of the root at the end [rad].
        velocities: Joint velocities at the end, shape (lanes, n) [rad/s].
        hops: Times that nothing carried the figure for 40 ms or longer: its jumps.
        aloft: Time spent in those [s].
        flight_gain: How much nearer to the goal they brought it, all together [m].
        goal_moved: How far the body at the goal was moved, in the plane, from the start to the end [m]; 0 for a point.
        goal_pulled: How much nearer that brought it to where the figure stood at the start [m].
        within: Distance that counts as there [m].
        upright_tilt: Largest tilt that counts as upright [rad].
    """

    direction: NDArray[np.float64]
    error: NDArray[np.float64]
    idle: NDArray[np.float64]
    collision: NDArray[np.float64]
    velocities: NDArray[np.float64]
    aloft: NDArray[np.float64]
    flight_gain: NDArray[np.float64]
    goal_moved: NDArray[np.float64]
    goal_pulled: NDArray[np.float64]
    within: NDArray[np.float64]
    upright_tilt: NDArray[np.float64]

    @property
    def fallen(self) -> NDArray[np.bool_]:
        """Touched what must not be touched, or diverged: what a run's progress counts as falls."""
        return ~np.isnan(self.collision) | self.unstable

    @property
    def upright(self) -> NDArray[np.bool_]:
        """Stands upright at the end."""
        return (self.tilt <= self.upright_tilt) & ~self.unstable

    @property
    def hit(self) -> NDArray[np.bool_]:
        """At the goal at the end, upright, and nothing touched that must not be."""
        return (self.error <= self.within) & self.upright & ~self.fallen

    @property
    def hit_1997(self) -> NDArray[np.bool_]:
        """Came to the goal at some time, but not by a simulation that diverged."""
        return (self.nearest <= self.within) & ~self.unstable

    @property
    def flight_share(self) -> NDArray[np.float64]:
        """Not told of figures: NaN."""
        return np.full(len(self.goal), np.nan)


class FigureJudge:
    """Follows many lanes step by step.

    Args:
        twin: The figure.
        point: Goal of each lane, shape (lanes, 2) [m].
        duration: Length of the run [s].
    """

    def __init__(self, twin: FigureTwin, point: NDArray[np.float64], duration: float) -> None:
        self._twin, self._point, self._duration = twin, point, duration
        goal = twin.figure.goal
        self.where = (
            twin.position[twin.figure.root], twin.position.get(goal, -1), twin.unsafe, twin.support,
        )  # fmt: skip
        self._state = np.zeros((len(point), _COLUMNS))
        self._state[:, _NEAREST] = np.inf
        self._state[:, [_ARRIVAL, _COLLISION]] = np.nan
        self._time, self._timestep = 0.0, twin.timestep

    def begin(self, sensors: NDArray[np.float64]) -> None:
        """Take the start: where the figures and their goals are.

        Args:
            sensors: `sensordata`, shape (lanes, k).
        """
        self._start, self._root = self._way(sensors), sensors[:, self.where[0] : self.where[0] + 2].copy()
        self._state[:, _FROM] = np.hypot(*self._start.T)

    def _way(self, sensors: NDArray[np.float64]) -> NDArray[np.float64]:
        root, goal, *_ = self.where
        return np.array([way_to_goal(sensors, self._point, lane, root, goal) for lane in range(len(self._point))])

    def step(self, lanes: NDArray[np.int64], sensors: NDArray[np.float64], qvel: NDArray[np.float64]) -> None:
        """Take one physics step of some lanes.

        Args:
            lanes: Which lanes were stepped.
            sensors: `sensordata`, shape (lanes, k).
            qvel: Velocities, shape (lanes, nv).
        """
        twin = self._twin
        self._time += self._timestep
        _follow(
            self._state, lanes, sensors, qvel, self._point, twin.dof, self.where, twin.figure.radius, self._time,
            self._timestep,
        )  # fmt: skip

    def outcome(
        self,
        sensors: NDArray[np.float64],
        qpos: NDArray[np.float64],
        qvel: NDArray[np.float64],
        unstable: NDArray[np.bool_],
        interventions: NDArray[np.int64],
    ) -> FigureOutcome:
        """Return the verdicts.

        Args:
            sensors: `sensordata` at the end, shape (lanes, k).
            qpos: Positions, shape (lanes, nq).
            qvel: Velocities, shape (lanes, nv).
            unstable: Lanes whose simulation diverged, shape (lanes,).
            interventions: Of the envelope, shape (lanes,).
        """
        twin, s, lanes = self._twin, self._state, len(self._point)
        upright = 1.0 - 2.0 * (qpos[:, twin.root + 4] ** 2 + qpos[:, twin.root + 5] ** 2)
        gone = np.where(unstable, np.nan, 0.0)  # where a diverged figure is, nobody knows
        goal = self._way(sensors) + sensors[:, self.where[0] : self.where[0] + 2] - self._root  # from the first place
        return FigureOutcome(
            goal=np.hypot(*self._start.T),
            direction=np.arctan2(self._start[:, 1], self._start[:, 0]),
            duration=np.full(lanes, self._duration),
            error=np.hypot(*self._way(sensors).T) + gone,
            nearest=s[:, _NEAREST].copy(),
            arrival=s[:, _ARRIVAL].copy(),
            idle=s[:, _IDLE].copy(),
            collision=s[:, _COLLISION].copy(),
            tilt=np.arccos(np.clip(upright, -1.0, 1.0)) + gone,
            angles=qpos[:, twin.qpos].copy(),
            velocities=qvel[:, twin.dof].copy(),
            hops=s[:, _JUMPS].copy(),
            aloft=s[:, _ALOFT].copy(),
            flight_gain=s[:, _GAIN].copy(),
            goal_moved=np.hypot(*(goal - self._start).T) + gone,
            goal_pulled=np.hypot(*self._start.T) - np.hypot(*goal.T) + gone,
            unstable=unstable,
            within=np.full(lanes, twin.figure.radius),
            upright_tilt=np.full(lanes, twin.figure.tilt),
            interventions=interventions,
        )
