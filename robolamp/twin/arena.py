"""Many figures at once, each lane with its own program and goal: the fleet of figures other than the lamp.

Joint angles are those of the moment. Objects' positions and velocities are MuJoCo's sensors after a step, which
describe the state before it: one physics step ago. To have them current would cost half as much again.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from robolamp.controller.kernels import bound_lanes, run_lanes
from robolamp.controller.program import Program, ProgramSet
from robolamp.errors import RobolampError
from robolamp.jit import njit
from robolamp.twin.figure import FigureTwin
from robolamp.twin.fleet import Fleet, Job
from robolamp.twin.lanes import deal
from robolamp.twin.model import TwinModel
from robolamp.twin.poses import KeyPose
from robolamp.twin.trace import Trace
from robolamp.twin.verdict import FigureOutcome, Verdict, way_to_goal

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


# A tick in one call: the way from Python into a kernel costs as much as the kernel does for a lane or two.
@njit(nogil=True, error_model="numpy")
def _decide(
    sense: tuple[Any, ...], run: tuple[Any, ...], bound: tuple[Any, ...], ask: tuple[Any, ...], time: float
) -> None:
    """Write every lane's terminals, run the programs on them, bound what they want, and ask the motors for it."""
    inputs, sources, qpos, sensors, point, where, ahead = sense
    _sense(inputs, sources, qpos, sensors, point, where, ahead, time)
    run_lanes(*run)
    bound_lanes(*bound)
    _ask(*ask)


class Drives:
    """Turns goals into what the motors are asked for, in many lanes.

    Args:
        twin: The figure.
    """

    def __init__(self, twin: FigureTwin) -> None:
        position = twin.figure.drive == "position"
        self._how = twin.actuator, twin.qpos, twin.figure.speed, position

    def arguments(
        self, ctrl: NDArray[np.float64], goal: NDArray[np.float64], qpos: NDArray[np.float64]
    ) -> tuple[Any, ...]:
        """Return what the kernel takes; see `ask`."""
        return ctrl, goal, qpos, *self._how

    def ask(self, ctrl: NDArray[np.float64], goal: NDArray[np.float64], qpos: NDArray[np.float64]) -> None:
        """Write the velocities to ask for.

        Args:
            ctrl: Written to, shape (lanes, nu) [rad/s].
            goal: Goals, shape (lanes, n) [rad/s or rad, by the figure's drive].
            qpos: Positions, shape (lanes, nq).
        """
        _ask(ctrl, goal, qpos, *self._how)


class _Shard:
    """The lanes of one worker."""

    def __init__(self, twins: Sequence[FigureTwin], variant: NDArray[np.int64], point: NDArray[np.float64]) -> None:
        self.twin = twin = twins[0]
        self.point = point
        self.batch = Batch(twin.model, len(variant), 1)
        if len(twins) > 1:
            self.batch.set_models([twins[index].model for index in variant])
        self.batch.state[:] = np.stack([each.state for each in twins])[variant]
        bind = self.batch.bind
        self.qpos, self.qvel, self.ctrl = bind("qpos"), bind("qvel"), bind("ctrl")
        self.sensors = bind("sensordata")
        if twin.goal is not None:
            self.qpos[:, twin.goal : twin.goal + 2] = point
        self.steps = 0

    def run(
        self,
        programs: ProgramSet,
        program: NDArray[np.int64],
        duration: float,
        period: float,
        trace: Trace | None,
        done: Callable[[float], None],
    ) -> FigureOutcome:
        """Run every lane for a duration [s]; the outcome leaves the trace to the caller, whose it is."""
        twin, figure, lanes = self.twin, self.twin.figure, len(self.point)
        verdict, drives = Verdict(twin, self.point, duration), Drives(twin)
        lower, upper, step = figure.lower, figure.upper, figure.slew * period
        goal = np.zeros((lanes, len(figure.joints)))
        sources = terminal_sources(twin, programs.terminals)
        inputs, wanted = np.zeros((lanes, len(sources))), np.zeros((lanes, len(figure.joints)))
        unstable, interventions = np.zeros(lanes, bool), np.zeros(lanes, np.int64)
        sense = inputs, sources, self.qpos, self.sensors, self.point, verdict.where, twin.ahead
        run = programs.arguments(program, inputs, wanted)
        bound = wanted, goal, lower, upper, step, interventions
        ask = drives.arguments(self.ctrl, goal, self.qpos)
        warned = self.batch.warning[:, :, 1].copy()
        self.batch.forward()
        verdict.begin(self.sensors)
        alive = np.arange(lanes)
        substeps = round(period / twin.timestep)
        for tick in range(round(duration / period)):
            done(tick * period / duration)
            _decide(sense, run, bound, ask, tick * period)
            if trace is not None:
                trace.record(alive, inputs, goal)
            for substep in range(substeps):
                if substep:
                    _ask(*ask)
                self.batch.step(alive if len(alive) < lanes else None, 1)
                self.steps += len(alive)
                verdict.step(alive, self.sensors, self.qvel)
            # A diverged lane is silently reset to the start; only its warning counters tell.
            now = (self.batch.warning[:, :, 1] > warned).any(axis=1)
            if (now & ~unstable).any():
                unstable |= now
                alive = np.flatnonzero(~unstable)
                if not len(alive):
                    break
        self.batch.forward()
        return verdict.outcome(self.sensors, self.qpos, self.qvel, unstable, interventions)


class FigureFleet:
    """Many figures that can be run again and again; see `robolamp.twin.fleet.Fleet`.

    Args:
        twins: The figures (variants of one model), all driven alike.
        period: Control period [s], a whole number of physics steps.
        workers: Threads; None: one for each core.

    Attributes:
        steps: Physics steps taken so far, of all lanes together.

    Raises:
        RobolampError: The period is not a whole number of physics steps.
    """

    def __init__(self, twins: Sequence[FigureTwin], period: float, workers: int | None = None) -> None:
        timestep = twins[0].timestep
        if abs(period - round(period / timestep) * timestep) > 1e-9 or period < timestep / 2:
            raise RobolampError(
                f"{period:g} s is not a whole number of physics steps of {timestep:g} s", "control_period"
            )
        self.twins = list(twins)
        self.period = period
        self.workers = workers or len(os.sched_getaffinity(0))
        self.steps = 0

    def run(
        self,
        programs: Sequence[Program],
        jobs: Sequence[Job],
        duration: float,
        *,
        poses: Sequence[KeyPose] = (),
        record: bool = False,
        done: Callable[[float], None] = lambda _share: None,
    ) -> FigureOutcome:
        """Run every job to its end and judge it.

        Args:
            programs: The controllers, all over the same terminals.
            jobs: The lanes.
            duration: Length of each run [s].
            poses: None: key poses are the lamp's.
            record: Keep what the controllers saw and sent: `FigureOutcome.trace`, 8 bytes a number.
            done: Called at each tick with the share that is done, 0 to 1, from one thread or several.

        Returns:
            The outcomes, in the order of the jobs.
        """
        if not jobs:
            raise ValueError("no jobs to run")
        if poses:
            raise ValueError("figures other than the lamp have no key poses")
        compiled = ProgramSet(programs)
        program = np.array([job.program for job in jobs], np.int64)
        variant = np.array([job.variant for job in jobs], np.int64)
        goal, direction = np.array([[job.goal, job.direction] for job in jobs]).T
        point = np.stack([goal * np.cos(direction), goal * np.sin(direction)], axis=1)
        trace = None
        if record:
            joints = len(self.twins[0].figure.joints)
            trace = Trace.blank(len(jobs), round(duration / self.period), len(compiled.terminals), joints)

        def work(share: slice) -> tuple[FigureOutcome, int]:
            shard = _Shard(self.twins, variant[share], point[share])
            own = None if trace is None else trace.take(share)  # a view: each worker writes its part
            return shard.run(compiled, program[share], duration, self.period, own, done), shard.steps

        outcome, steps = deal(len(jobs), self.workers, work)
        self.steps += steps
        return replace(outcome, trace=trace)


def make_fleet(
    twins: Sequence[TwinModel] | Sequence[FigureTwin], period: float, workers: int | None = None
) -> Fleet | FigureFleet:
    """Return a fleet of lamps or of figures, whichever they are; see `Fleet`."""
    figures = [twin for twin in twins if isinstance(twin, FigureTwin)]
    if figures:
        return FigureFleet(figures, period, workers)
    return Fleet([twin for twin in twins if isinstance(twin, TwinModel)], period, workers)
