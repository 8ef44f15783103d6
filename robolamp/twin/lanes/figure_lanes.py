"""Figures other than the lamp under controllers: what those read, and what becomes of their goals.

Joint angles are those of the moment. Objects' positions and velocities are MuJoCo's sensors after a step, which
describe the state before it: one physics step ago. To have them current would cost half as much again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robolamp.jit import njit
from robolamp.twin.engine import Lanes, Variants
from robolamp.twin.figure_model import FigureTwin
from robolamp.twin.judges.figure_judge import FigureJudge, FigureOutcome, way_to_goal
from robolamp.twin.lanes.lane_runs import Job, Runs, RunSettings

_POSITION_TIME = 0.05  # a figure driven by position asks its motors for error / this [s]: five of the paper's steps
_TIME, _QPOS, _SENSOR, _POINT, _AHEAD, _LEFT, _DISTANCE = range(7)


def terminal_sources(twin: FigureTwin, terminals: Sequence[str]) -> NDArray[np.int64]:
    """Return where each terminal's value comes from: kind and address, shape (terminals, 2)."""
    sources = {
        "t": (_TIME, 0),
        "Ogoal.px": (_POINT, 0),
        "Ogoal.py": (_POINT, 1),
        "goal_ahead": (_AHEAD, 0),
        "goal_left": (_LEFT, 0),
        "goal_dist": (_DISTANCE, 0),
    }
    sources |= {f"k{joint}": (_QPOS, int(address)) for joint, address in enumerate(twin.qpos)}
    for index, axis in enumerate("xyz"):
        sources |= {f"O{name}.p{axis}": (_SENSOR, adr + index) for name, adr in twin.position.items()}
        sources |= {f"V{name}.{axis}": (_SENSOR, adr + index) for name, adr in twin.velocity.items()}
    return np.array([sources[name] for name in terminals], np.int64).reshape(-1, 2)


@njit(nogil=True, error_model="numpy")
def _sense(
    inputs: NDArray[np.float64],
    sources: NDArray[np.int64],
    qpos: NDArray[np.float64],
    sensors: NDArray[np.float64],
    point: NDArray[np.float64],
    where: tuple[int, int, int, int],
    ahead: int,
    time: float,
) -> None:
    """Write every lane's terminals."""
    for lane in range(inputs.shape[0]):
        x, y = way_to_goal(sensors, point, lane, where[0], where[1])
        hx, hy = sensors[lane, ahead], sensors[lane, ahead + 1]
        length = np.sqrt(hx * hx + hy * hy)
        if length > 1e-9:
            hx, hy = hx / length, hy / length
        for column in range(sources.shape[0]):
            kind, address = sources[column, 0], sources[column, 1]
            if kind == _TIME:
                value = time
            elif kind == _QPOS:
                value = qpos[lane, address]
            elif kind == _SENSOR:
                value = sensors[lane, address]
            elif kind == _POINT:
                value = point[lane, address]
            elif kind == _AHEAD:
                value = x * hx + y * hy
            elif kind == _LEFT:
                value = y * hx - x * hy
            else:
                value = np.sqrt(x * x + y * y)
            inputs[lane, column] = value


@njit(nogil=True, error_model="numpy")
def _ask(
    ctrl: NDArray[np.float64],
    goal: NDArray[np.float64],
    qpos: NDArray[np.float64],
    actuator: NDArray[np.int64],
    joint: NDArray[np.int64],
    speed: NDArray[np.float64],
    position: bool,
) -> None:
    """Write every lane's motor speeds."""
    for lane in range(goal.shape[0]):
        for index in range(goal.shape[1]):
            asked = goal[lane, index]
            if position:
                asked = (asked - qpos[lane, joint[index]]) / _POSITION_TIME
                asked = min(max(asked, -speed[index]), speed[index])
            ctrl[lane, actuator[index]] = asked


class FigureRuns(Runs):
    """Runs of figures; see `Runs`.

    Args:
        twins: The figures, all driven alike.
        variants: Their models.
        states: Where each figure starts, shape (figures, nstate).
        jobs: The lanes.
        settings: What they have in common.
    """

    def __init__(
        self,
        twins: Sequence[FigureTwin],
        variants: Variants,
        states: NDArray[np.float64],
        jobs: Sequence[Job],
        settings: RunSettings,
    ) -> None:
        if settings.poses:
            raise ValueError("figures other than the lamp have no key poses")
        self._twin = twin = twins[0]
        goal, direction = np.array([[job.goal, job.direction] for job in jobs]).T
        self._point = np.stack([goal * np.cos(direction), goal * np.sin(direction)], axis=1)
        variant = np.array([job.variant for job in jobs], np.int64)
        lanes = Lanes(variants, variant, states[variant])
        if twin.goal is not None:
            lanes.qpos[:, twin.goal : twin.goal + 2] = self._point
        super().__init__(lanes, settings, twin.timestep)
        self.unseen = [int(twin.model.joint(f"drive_{name}").qposadr[0]) for name in twin.figure.names]
        self._sources = terminal_sources(twin, settings.terminals)
        self.inputs = np.zeros((lanes.count, len(settings.terminals)))
        self._goals = np.zeros((lanes.count, len(twin.qpos)))
        self._ctrl = lanes.batch.bind("ctrl")
        self._how = twin.actuator, twin.qpos, twin.figure.speed, twin.figure.drive == "position"
        self._verdict = FigureJudge(twin, self._point, settings.duration)
        self._verdict.begin(lanes.sensors)

    @staticmethod
    def start(twin: FigureTwin) -> NDArray[np.float64]:
        """Return the state that a run starts from, shape (nstate,)."""
        return twin.state

    def sense(self, time: float) -> None:
        """Write what the controllers read now."""
        _sense(
            self.inputs, self._sources, self.lanes.qpos, self.lanes.sensors, self._point, self._verdict.where,
            self._twin.ahead, time,
        )  # fmt: skip

    def _send(self, goals: NDArray[np.float64]) -> None:
        self._goals = goals

    def _drive(self, alive: NDArray[np.int64], substep: int) -> None:
        _ask(self._ctrl, self._goals, self.lanes.qpos, *self._how)

    def _judge(self, alive: NDArray[np.int64]) -> None:
        self._verdict.step(alive, self.lanes.sensors, self.lanes.qvel)

    def _ended(self, time: float) -> NDArray[np.bool_]:
        return self.unstable

    def outcome(self, interventions: NDArray[np.int64]) -> FigureOutcome:
        """Return what became of the runs."""
        lanes = self.lanes
        lanes.batch.forward()
        return self._verdict.outcome(lanes.sensors, lanes.qpos, lanes.qvel, self.unstable, interventions)
