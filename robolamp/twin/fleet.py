"""The fleet: many lamps at once, each lane with its own program, goal and (if wanted) its own bent lamp.

A worker thread for each core owns a `mujoco.batch.Batch` over its share of the lanes, so that no barrier is met inside
a tick. Lanes do not touch each other: results are the same to the bit for any number of workers.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch
from numpy.typing import NDArray

from robolamp.controller.hops import SignalLimits
from robolamp.controller.kernels import bound_lanes, run_lanes
from robolamp.controller.program import Program, ProgramSet
from robolamp.controller.terminals import TWIN_ONLY, Signals
from robolamp.errors import RobolampError
from robolamp.jit import njit
from robolamp.twin.body import Body
from robolamp.twin.judge import Judge, Outcome
from robolamp.twin.lanes import deal
from robolamp.twin.model import TwinModel
from robolamp.twin.motors import Motors, Views
from robolamp.twin.poses import KeyPose, PoseErrors
from robolamp.twin.sensors import measure_angle, measure_force
from robolamp.twin.trace import Trace

SETTLE_TIME = 1.0
"""How long a lamp stands in the neutral pose before a run [s]: the twin's share of the soft start."""

SETTLED = mujoco.mjtState.mjSTATE_INTEGRATION
"""What `settle` returns of a state."""


@dataclass(frozen=True)
class Job:
    """A lane: which program on which lamp to which goal.

    Attributes:
        program: Index of the program.
        variant: Index of the lamp.
        goal: Commanded distance [m].
        goal_time: Commanded time to take for it [s]; 0: none is commanded.
        direction: Of the goal, from x towards y [rad]; the lamp's is always ahead.
    """

    program: int
    variant: int
    goal: float
    goal_time: float = 0.0
    direction: float = 0.0


def settle(twin: TwinModel) -> NDArray[np.float64]:
    """Return the state of a lamp that has stood in the neutral pose for `SETTLE_TIME`.

    Args:
        twin: The lamp.

    Returns:
        MuJoCo's integration state, shape (nstate,). Its clock goes on from there: the delay lines hold times.
    """
    body = Body(twin)
    body.step(round(SETTLE_TIME / twin.timestep))
    state = np.empty(mujoco.mj_stateSize(body.model, SETTLED))
    mujoco.mj_getState(body.model, body.data, state, SETTLED)
    return state


def _differing(models: Sequence[mujoco.MjModel]) -> dict[str, NDArray[np.float64]]:
    """Return the fields of models that are not alike in all of them, with their values, shape (models, ...)."""
    found = {}
    for name in sorted(MODEL_FIELDS):
        if name.startswith("opt.") or name in ("dof_frictionloss", "tendon_damping"):
            continue
        values = [getattr(model, name) for model in models]
        if any(not np.array_equal(values[0], value) for value in values[1:]):
            found[name] = np.stack(values)
    return found


@njit(nogil=True, error_model="numpy")
def _arrive(
    lanes: NDArray[np.int64],
    told: NDArray[np.float64],
    line: NDArray[np.float64],
    arrival: NDArray[np.int64],
    substep: int,
    substeps: int,
) -> None:
    """Tell servos the goals that reach them in this physics step of a tick; `line` has the newest first."""
    for lane in lanes:
        if (substep - arrival[lane]) % substeps == 0:
            late = max(-((substep - arrival[lane]) // substeps), 0)
            for joint in range(told.shape[1]):
                told[lane, joint] = line[late, lane, joint]


class _Shard:
    """The lanes of one worker."""

    def __init__(
        self,
        twins: Sequence[TwinModel],
        states: NDArray[np.float64],
        differing: dict[str, NDArray[np.float64]],
        variant: NDArray[np.int64],
        period: float,
    ) -> None:
        twin = twins[0]
        self.twin = twin
        self.variant = variant
        self.substeps = round(period / twin.timestep)
        self.period = period
        self.batch = Batch(twin.model, len(variant), 1)
        present = np.unique(variant)
        for name, values in differing.items():
            if (values[present] != values[0]).any():
                self.batch.expand(name)[:] = values[variant]
        self.batch.state[:] = states[variant]
        views = Views.of_batch(self.batch, twins)
        self.motors = Motors(twins, views, variant)
        self.arrival_step = np.array([round(each.line_delay / twin.timestep) for each in twins])[variant]
        self.foot_gain = np.array([each.foot_gain for each in twins])[variant]
        bind = self.batch.bind
        self.qpos, self.qvel, self.sensors = views.qpos, views.qvel, bind("sensordata")
        self.site, self.site_axes = bind("site_xpos"), bind("site_xmat").reshape(len(variant), -1, 9)
        self.steps = 0

    def run(
        self,
        programs: ProgramSet,
        program: NDArray[np.int64],
        goal: NDArray[np.float64],
        goal_time: NDArray[np.float64],
        duration: float,
        poses: Sequence[KeyPose],
        trace: Trace | None,
        done: Callable[[float], None],
    ) -> Outcome:
        """Run every lane for a duration [s]; the outcome leaves the trace to the caller, whose it is."""
        twin, lamp, lanes = self.twin, self.twin.lamp, len(self.variant)
        joints = len(lamp.joints)
        judge = Judge(twin, goal, duration)
        judge.begin(self.qpos[:, 0])
        key = PoseErrors(poses, lanes, twin.timestep)
        signals = Signals(lanes, joints, SignalLimits.of(lamp, self.period), programs.terminals)
        sees_base = bool(set(programs.terminals) & set(TWIN_ONLY))
        wanted, sent = np.zeros((lanes, joints)), np.zeros((lanes, joints))
        unstable, interventions = np.zeros(lanes, bool), np.zeros(lanes, np.int64)
        warned = self.batch.warning[:, :, 1].copy()
        # The first reading: sensors describe a state only after a step, and the settled lamp stands on its foot.
        self.batch.forward()
        alive = np.arange(lanes)
        # Goals under way on the line, the newest first: a delay may be longer than a control period.
        line = np.zeros((1 + math.ceil(self.arrival_step.max() / self.substeps), lanes, joints))
        arriving = set((self.arrival_step % self.substeps).tolist())
        head, axis = self.site[:, twin.head_site, 2], self.site_axes[:, twin.head_site, 8]
        force = self.sensors[:, twin.foot_sensor]
        pole = None if twin.pole_sensor is None else self.sensors[:, twin.pole_sensor]
        steps = 0
        for tick in range(round(duration / self.period)):
            done(tick * self.period / duration)
            base = None
            if sees_base:
                base = np.column_stack([self.qpos[:, :3], self.qvel[:, :3], judge.goal_met])
                base[:, 0] -= goal
            angle, pressed = measure_angle(self.motors.angle), measure_force(force, self.foot_gain)
            inputs = signals.update(angle, pressed, goal, base, goal_time=goal_time)
            asked, goals, changed = wanted[: len(alive)], sent[alive], interventions[alive]
            run_lanes(*programs.arguments(program[alive], inputs[alive], asked))
            bound_lanes(asked, goals, lamp.lower, lamp.upper, lamp.slew * self.period, changed)
            sent[alive], interventions[alive] = goals, changed
            line[1:] = line[:-1].copy()
            line[0] = sent
            if trace is not None:
                trace.record(alive, inputs, line[0])
            for substep in range(self.substeps):
                if key.at(steps):
                    key.compare(steps, self.motors.angle)
                if substep in arriving:
                    _arrive(alive, self.motors.goal, line, self.arrival_step, substep, self.substeps)
                self.motors.before_step(alive)
                self.batch.step(alive, 1)
                steps += 1
                self.steps += len(alive)
                judge.step(alive, self.qpos, force, head, axis, pole)
            # A diverged lane is silently reset to the standing start; only its warning counters tell.
            unstable |= (self.batch.warning[:, :, 1] > warned).any(axis=1)
            judge.fall_time[unstable & np.isnan(judge.fall_time)] = tick * self.period
            alive = np.flatnonzero(np.isnan(judge.fall_time))
            if not len(alive):
                break
        angles = self.motors.angle.copy()
        return judge.outcome(angles, unstable, interventions, key.finish(angles), goal_time)


class Fleet:
    """Many lamps that can be run again and again.

    Args:
        twins: The lamps (variants of one model); their MuJoCo models differ in numbers only.
        period: Control period [s], a whole number of physics steps.
        workers: Threads; None: one for each core.

    Attributes:
        steps: Physics steps taken so far, of all lanes together.

    Raises:
        RobolampError: The period is not a whole number of physics steps.
    """

    def __init__(self, twins: Sequence[TwinModel], period: float, workers: int | None = None) -> None:
        timestep = twins[0].timestep
        if abs(period - round(period / timestep) * timestep) > 1e-9:
            raise RobolampError(
                f"{period:g} s is not a whole number of physics steps of {timestep:g} s", "control_period"
            )
        if len({twin.pole_sensor for twin in twins}) > 1:
            raise ValueError("some lamps have a pole, some none")
        self.twins = list(twins)
        self.period = period
        self.workers = workers or len(os.sched_getaffinity(0))
        self.steps = 0
        self._states = np.stack([settle(twin) for twin in self.twins])
        self._differing = _differing([twin.model for twin in self.twins])

    def run(
        self,
        programs: Sequence[Program],
        jobs: Sequence[Job],
        duration: float,
        *,
        poses: Sequence[KeyPose] = (),
        record: bool = False,
        done: Callable[[float], None] = lambda _share: None,
    ) -> Outcome:
        """Run every job to its end and judge it.

        Args:
            programs: The controllers, all over the same terminals.
            jobs: The lanes.
            duration: Length of each run [s].
            poses: Poses that every lane is compared with; a lane that ended before one is judged on its last angles.
            record: Keep what the controllers saw and sent: `Outcome.trace`, 8 bytes a number.
            done: Called at each tick with the share that is done, 0 to 1, from one thread or several.

        Returns:
            The outcomes, in the order of the jobs.
        """
        if not jobs:
            raise ValueError("no jobs to run")
        compiled = ProgramSet(programs)
        program = np.array([job.program for job in jobs], np.int64)
        variant = np.array([job.variant for job in jobs], np.int64)
        goal = np.array([job.goal for job in jobs], np.float64)
        goal_time = np.array([job.goal_time for job in jobs], np.float64)
        trace = None
        if record:
            ticks, joints = round(duration / self.period), len(self.twins[0].lamp.joints)
            trace = Trace.blank(len(jobs), ticks, len(compiled.terminals), joints)

        def work(share: slice) -> tuple[Outcome, int]:
            shard = _Shard(self.twins, self._states, self._differing, variant[share], self.period)
            own = None if trace is None else trace.take(share)  # a view: each worker writes its part
            outcome = shard.run(compiled, program[share], goal[share], goal_time[share], duration, poses, own, done)
            return outcome, shard.steps

        outcome, steps = deal(len(jobs), self.workers, work)
        self.steps += steps
        return replace(outcome, trace=trace)
