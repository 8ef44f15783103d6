"""A servo's motor with a pendulum on its shaft: the twin's servo model in MuJoCo, one step at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.calibration import JOINT, SERVO
from robolamp.emulator.delay import DelayLine
from robolamp.emulator.difference import PerJoint, Reality
from robolamp.emulator.drive import Drive, Sensed
from robolamp.twin.pendulum import Load, pendulum_model
from robolamp.twin.servo import ServoParameters, friction_loss, weaken, write_motors

_FRICTIONS = {
    "viscous": "viscous", "coulomb": "coulomb", "stribeck": "stribeck", "load_motor": "load_friction",
    "load_external": "load_friction", "load_external_stribeck": "load_friction",
}  # fmt: skip
_IDLE = Drive(False, 0.0, 1, 1.0)
_R = 0  # column of a dcmotor's actuator_gainprm
_KP, _KD, _VMAX = 4, 6, 7
_ONE = np.zeros(1, np.int64)  # the lanes: one


def bent(values: Mapping[str, float], reality: Reality) -> dict[str, float]:
    """Return a servo's parameters as a reality has them.

    Play, links and what stands on a floor are not a pendulum's.

    Args:
        values: Parameters by name, with `encoder_offset`.
        reality: How they differ; of values a joint, the first one's.
    """

    def first(value: PerJoint) -> float:
        return float(np.atleast_1d(value)[0])

    found = dict(values)
    found["torque_constant"] *= first(reality.strength)
    found["armature"] *= first(reality.armature)
    found["stribeck_velocity"] *= first(reality.stribeck_velocity)
    found["encoder_offset"] += first(reality.encoder_offset)
    found["delay"] += reality.delay
    for name, kind in _FRICTIONS.items():
        found[name] *= first(reality.friction) * first(getattr(reality, kind))
    legal = {**SERVO, **JOINT}
    return {name: min(max(value, legal[name].low), legal[name].high) for name, value in found.items()}


class Pendulum:
    """A motor, its gear, and an arm with a weight that hangs straight down at first.

    Args:
        values: The servo's parameters by name, and `encoder_offset` [rad].
        load: The arm and its weight.
        timestep: Physics step [s].
        zero: Of the shaft, where the arm hangs straight down [rad].
        noise: Standard deviation of each reading of the encoder [rad].
        seed: Of that noise.

    """

    def __init__(
        self,
        values: Mapping[str, float],
        load: Load,
        timestep: float,
        *,
        zero: float = math.pi,
        noise: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._servo = ServoParameters(**{name: np.array([values[name]]) for name in SERVO})
        self._offset, self._zero = values["encoder_offset"], zero
        self._model = model = pendulum_model(timestep)
        mass, centre, model.body_inertia[1] = load.body
        model.body_mass[1], model.body_ipos[1, 2] = mass, -centre
        model.actuator_armature[0] = values["armature"]
        model.actuator_damping[0] = values["viscous"]
        model.actuator_gainprm[0, 1] = values["torque_constant"]
        self._data = mujoco.MjData(model)
        mujoco.mj_setConst(model, self._data)
        mujoco.mj_resetData(model, self._data)
        self._random, self._noise = np.random.default_rng(seed), noise
        self._delay = DelayLine(values["delay"], timestep)
        self._friction, self._weakness = self._servo.friction()[None], self._servo.weakness()[None]
        data, self._index = self._data, np.zeros(1, np.int64)
        self._lanes = tuple(
            array.reshape(1, -1) for array in (data.qfrc_actuator, data.qfrc_bias, data.qvel, model.dof_frictionloss)
        )
        self._drive, self._goal = _IDLE, 0.0
        self._duty = self._speed = 0.0
        self._steps = 0
        self._write(_IDLE, 1.0)
        mujoco.mj_forward(model, data)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * self._model.opt.timestep

    def step(self, drive: Drive, volts: float, late: float = 0.0) -> None:
        """Let one physics step pass.

        Args:
            drive: What the servo does to it.
            volts: Supply voltage [V].
            late: How far into this step a changed `drive` comes, 0 to 1 of it.
        """
        data, gain = self._data, self._model.actuator_gainprm[0]
        goal = drive.goal - self._zero - self._offset
        late = min(max(late, 0.0), 1.0) if drive is not self._drive else 0.0
        if drive.torque and not self._drive.torque:
            self._delay.reset(goal)  # a servo that is switched on has forgotten what it was told before
            self._goal, late = goal, 0.0
        released = self._drive.torque and not drive.torque
        self._write(self._drive if released and late > 0.0 else drive, volts)
        if released and late > 0.0:
            gain[[_KP, _KD]] *= late
            gain[_R] /= late
        delayed = self._delay.push(goal + late * (self._goal - goal))
        self._drive, self._goal = drive, goal
        angle = float(data.qpos[0])
        if drive.duty is None:
            data.ctrl[0] = delayed
        else:  # a goal that stands for the duty
            data.ctrl[0] = angle + drive.duty * volts
            gain[_KP] = gain[_KD] / self._servo.torque_constant[0]
        if self._servo.weakens:
            motor, velocity = self._lanes[0], self._lanes[2]
            weaken(self._weakness, self._index, self._index, motor, velocity, self._model.actuator_gainprm[None])
        friction_loss(_ONE, self._friction, self._index, *self._lanes)
        self._speed = float(data.qvel[0])
        mujoco.mj_step(self._model, data)
        current = float(data.actuator_force[0]) / float(self._servo.torque_constant[0])
        applied = current * float(gain[_R]) + float(self._servo.torque_constant[0]) * self._speed
        self._duty = min(max(applied / volts, -1.0), 1.0) if drive.torque else 0.0
        self._steps += 1

    @property
    def current(self) -> float:
        """Of the supply, by the duty what the winding carries; positive towards larger angles [A]."""
        return abs(self._duty) * float(self._data.actuator_force[0]) / float(self._servo.torque_constant[0])

    def sensed(self, time: float, volts: float, air: float) -> Sensed:
        """Return what the servo's sensors see.

        Args:
            time: When, up to a step after the last one [s].
            volts: Supply voltage [V].
            air: Temperature around it [degC].
        """
        ahead = min(max(time - self.time, 0.0), self._model.opt.timestep)
        velocity = float(self._data.qvel[0])
        angle = float(self._data.qpos[0]) + velocity * ahead + self._offset + self._zero
        if self._noise:
            angle += self._noise * float(self._random.standard_normal())
        return Sensed(angle, velocity, self.current, self._duty, volts, air)

    def _write(self, drive: Drive, volts: float) -> None:
        """Write the motor as it is driven into the model."""
        rows = self._model.actuator_gainprm
        row: NDArray[np.float64] = rows[:1]
        write_motors(
            row, self._servo, np.array([float(drive.p_gain)]), np.array([volts]), np.array([drive.torque]),
            drive.duty_limit,
        )  # fmt: skip
        if drive.torque and self._servo.weakens:  # what the last step left of the winding goes on from there
            effective = self._weakness[0, 0, 4]
            row[0, [_KP, _KD]] *= row[0, _R] / effective
            row[0, _R] = effective
