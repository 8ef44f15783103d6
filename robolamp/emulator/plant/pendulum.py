"""A servo's motor with a pendulum on its shaft: the twin's servo model in MuJoCo, one step at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np

from robolamp.calibration import JOINT, SERVO
from robolamp.emulator.plant.motor_commands import Driver
from robolamp.emulator.reality.reality import PerJoint, Reality
from robolamp.emulator.servo.drive import Drive, Sensed
from robolamp.twin.actuators.motors import Motors, Views
from robolamp.twin.actuators.servo import ServoParameters
from robolamp.twin.pendulum_model import Load, build_pendulum

_FRICTIONS = {
    "viscous": "viscous", "coulomb": "coulomb", "stribeck": "stribeck", "load_motor": "load_friction",
    "load_external": "load_friction", "load_external_stribeck": "load_friction",
}  # fmt: skip


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
    if reality.resistance_per_kelvin:  # in place of what the calibration says of it
        found["resistance_temperature"] = reality.resistance_per_kelvin
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
        twin = build_pendulum(ServoParameters.single(values), load, timestep)
        self._offset, self._zero = values["encoder_offset"], zero
        self._model = twin.model
        self._data = mujoco.MjData(twin.model)
        self._motors = Motors([twin], Views.of_one(twin.model, self._data))
        self._driver, self._drive = Driver(self._motors), Drive(False, 0.0, 1, 1.0)
        self._random, self._noise = np.random.default_rng(seed), noise
        self._steps = 0
        mujoco.mj_forward(twin.model, self._data)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * self._model.opt.timestep

    def step(self, drive: Drive, volts: float, temperature: float, late: float = 0.0) -> None:
        """Let one physics step pass.

        Args:
            drive: What the servo does to it.
            volts: Supply voltage [V].
            temperature: Of the servo [degC].
            late: How far into this step a changed `drive` comes, 0 to 1 of it.
        """
        self._motors.charge(volts)
        self._motors.temperature[:] = temperature
        if drive is not self._drive:
            self._driver.drive(0, replace(drive, goal=drive.goal - self._zero - self._offset), late)
            self._drive = drive
        self._motors.before_step()
        mujoco.mj_step(self._model, self._data)
        self._driver.after_step()
        self._steps += 1

    @property
    def current(self) -> float:
        """Of the supply, by the duty what the winding carries; positive towards larger angles [A]."""
        return float(self._motors.current[0, 0])

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
        return Sensed(angle, velocity, self.current, float(self._motors.duty[0, 0]), volts, air)
