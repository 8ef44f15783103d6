"""Lamps side by side: their physics with what the servos have beside it, and their runs under controllers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.foot_window import FootWindow
from robolamp.controller.hop_counter import SignalLimits
from robolamp.controller.terminals import TWIN_ONLY, Signals
from robolamp.jit import njit
from robolamp.twin.actuators.motors import Motors, Views
from robolamp.twin.engine import Lanes, Variants, state_of
from robolamp.twin.judges.key_poses import PoseErrors
from robolamp.twin.judges.lamp_judge import Judge, Outcome
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.lanes.lane_runs import Job, Runs, RunSettings
from robolamp.twin.sensor_model import measure_angle, measure_force

Array = NDArray[np.float64]

SETTLE_TIME = 1.0
"""How long a lamp stands in the neutral pose before a run [s]: the twin's share of the soft start."""


def settle(twin: TwinModel) -> Array:
    """Return the state of a lamp that has stood in the neutral pose for `SETTLE_TIME`.

    Args:
        twin: The lamp.

    Returns:
        MuJoCo's integration state, shape (nstate,). Its clock goes on from there: the delay lines hold times.
    """
    body = Body(twin)
    body.step(round(SETTLE_TIME / twin.timestep))
    return state_of(body.model, body.data)


class Lamps(Lanes):
    """Lanes with a lamp each.

    Args:
        twins: The lamps, variants of one model.
        variant: Which of them each lane has, shape (k,); None: a lane a lamp.
        variants: Their models, where those have been compared already.
        states: State of each lane, shape (k, nstate), or one for all; None: MuJoCo's default.
        gains: Whether the caller writes gains.

    Attributes:
        motors: The servos.
        views: What they read and write.
        force: True floor force on the foot, shape (k,) [N].
    """

    def __init__(
        self,
        twins: Sequence[TwinModel],
        variant: NDArray[np.int64] | None = None,
        variants: Variants | None = None,
        states: Array | None = None,
        *,
        gains: bool = False,
    ) -> None:
        super().__init__(variants or Variants([twin.model for twin in twins]), variant, states)
        self.views = Views.of_batch(self.batch, twins, gains=gains)
        self.motors = Motors(twins, self.views, variant)
        self.force = self.sensors[:, twins[0].foot_sensor]

    def step(self, lanes: NDArray[np.int64]) -> None:
        """Take a physics step, servos and all.

        Args:
            lanes: Which lanes.
        """
        self.motors.before_step(lanes)
        super().step(lanes)


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


class LampRuns(Runs):
    """Runs of lamps; see `Runs`.

    Args:
        twins: The lamps.
        variants: Their models.
        states: Where each lamp starts, shape (lamps, nstate).
        jobs: The lanes.
        settings: What they have in common.
    """

    lanes: Lamps

    def __init__(
        self, twins: Sequence[TwinModel], variants: Variants, states: Array, jobs: Sequence[Job], settings: RunSettings
    ) -> None:
        twin, variant = twins[0], np.array([job.variant for job in jobs], np.int64)
        super().__init__(Lamps(twins, variant, variants, states[variant]), settings, twin.timestep)
        lanes, joints = self.lanes, len(twin.lamp.joints)
        self._goal = np.array([job.goal for job in jobs], np.float64)
        self._goal_time = np.array([job.goal_time for job in jobs], np.float64)
        limits = SignalLimits.of(twin.lamp, settings.period)
        self._signals = Signals(lanes.count, joints, limits, settings.terminals, settings.read)
        self.inputs = self._signals.values
        felt = FootWindow(lanes.count, twin.lamp.contact_on, twin.lamp.contact_off)
        self._felt = felt if self._signals.feels_all else None
        self._sees_base = bool(settings.read & {*TWIN_ONLY})
        self._foot_gain = np.array([each.foot_gain for each in twins])[variant]
        noise = np.array([each.foot_noise for each in twins])
        self._foot_noise = noise[variant] if noise.any() else None
        self._random = [np.random.default_rng(each.seed) for each in twins]  # the same noise in each run of a lamp
        # Goals under way on the line, the newest first: a delay may be longer than a control period.
        self._arrival = np.array([round(each.line_delay / twin.timestep) for each in twins])[variant]
        self._line = np.zeros((1 + math.ceil(self._arrival.max() / self._substeps), lanes.count, joints))
        self._arriving = set((self._arrival % self._substeps).tolist())
        self._judged = Judge(twin, self._goal, settings.duration)
        self._judged.begin(lanes.qpos[:, 0])
        self._poses, self._steps = PoseErrors(settings.poses, lanes.count, twin.timestep), 0
        site, axes = lanes.batch.bind("site_xpos"), lanes.batch.bind("site_xmat").reshape(lanes.count, -1, 9)
        self._head, self._axis = site[:, twin.head_site, 2], axes[:, twin.head_site, 8]
        self._pole = None if twin.pole_sensor is None else lanes.sensors[:, twin.pole_sensor]

    @staticmethod
    def start(twin: TwinModel) -> Array:
        """Return the state that a run starts from, shape (nstate,)."""
        return settle(twin)

    def sense(self, time: float) -> None:
        """Write what the controllers read now; their clock counts the calls."""
        lanes, base = self.lanes, None
        if self._sees_base:
            base = np.column_stack([lanes.qpos[:, :3], lanes.qvel[:, :3], self._judged.goal_met])
            base[:, 0] -= self._goal
        angle, noise = measure_angle(lanes.motors.reading), self._noise()
        pressed = measure_force(lanes.force, self._foot_gain, noise)
        foot = None
        if self._felt is not None:
            mean, contact = self._felt.take()
            foot = mean + self._noise() / math.sqrt(self._substeps), contact
        self._signals.update(angle, pressed, self._goal, base, goal_time=self._goal_time, foot=foot)

    def _noise(self) -> Array | float:
        """Return the noise of one reading of each foot, shape (k,) [N]."""
        if self._foot_noise is None:
            return 0.0
        return self._foot_noise * np.array([random.standard_normal() for random in self._random])[self.lanes.variant]

    def _send(self, goals: Array) -> None:
        self._line[1:] = self._line[:-1].copy()
        self._line[0] = goals

    def _drive(self, alive: NDArray[np.int64], substep: int) -> None:
        if self._poses.at(self._steps):
            self._poses.compare(self._steps, self.lanes.motors.angle)
        self._steps += 1
        if substep in self._arriving:
            _arrive(alive, self.lanes.motors.goal, self._line, self._arrival, substep, self._substeps)

    def _judge(self, alive: NDArray[np.int64]) -> None:
        if self._felt is not None:
            self._felt.add(measure_force(self.lanes.force, self._foot_gain))
        self._judged.step(alive, self.lanes.qpos, self.lanes.force, self._head, self._axis, self._pole)

    def _ended(self, time: float) -> NDArray[np.bool_]:
        fall_time = self._judged.fall_time
        fall_time[self.unstable & np.isnan(fall_time)] = time
        return ~np.isnan(fall_time)

    def outcome(self, interventions: NDArray[np.int64]) -> Outcome:
        """Return what became of the runs."""
        angles = self.lanes.motors.angle.copy()
        return self._judged.outcome(angles, self.unstable, interventions, self._poses.finish(angles), self._goal_time)
