"""What the emulated servos turn and the foot stands on: the twin in MuJoCo, one lane, one step at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.emulator.plant.motor_commands import Driver
from robolamp.emulator.servo.drive import Drive
from robolamp.errors import RobolampError
from robolamp.twin.actuators.motors import LEAST_VOLTAGE, Motors, Views
from robolamp.twin.judges.lamp_judge import FALLEN_HEAD, FALLEN_TILT
from robolamp.twin.lamp_model import TwinModel

Array = NDArray[np.float64]

_SETTLE = 0.5  # time for the foot to come to rest on the floor before the clock starts [s]


@dataclass(frozen=True)
class Truth:
    """What really happens, which no client of the ports is told.

    Attributes:
        base_x: Base centre, forward [m].
        base_z: Base centre above the floor [m].
        lean: Of the base from upright, positive forward [rad].
        clearance: Lowest point of the foot above the floor [m]; slightly negative where it presses in.
        force: Floor force on the foot [N].
        fallen: Leaning more than 70 degrees, or the head within 3 cm of the floor.
    """

    base_x: float
    base_z: float
    lean: float
    clearance: float
    force: float
    fallen: bool


class Plant:
    """The lamp's mechanics and motors.

    It starts standing in the neutral pose, each joint held as if by hand until its motor is first driven.

    Args:
        twin: The compiled lamp; this plant alone may use it, for it writes into its model.

    Attributes:
        timestep: Physics step [s].
    """

    def __init__(self, twin: TwinModel) -> None:
        self._twin, self._model = twin, twin.model
        self._data = data = mujoco.MjData(twin.model)
        self.timestep = twin.timestep
        # The supply is not the motors': it has capacitors.
        self._motors = Motors([replace(twin, supply_resistance=0.0)], Views.of_one(twin.model, data))
        self._driver = Driver(self._motors)
        self._held = self._motors.held[0]
        self._held[:] = True
        self._steps = 0
        self._known: tuple[Array, Array] | None = None  # duties and currents: servos ask often
        mujoco.mj_resetDataKeyframe(self._model, data, 0)
        for _ in range(round(_SETTLE / self.timestep)):
            self.step()
        data.qvel[:] = 0.0
        self._steps = 0

    @property
    def time(self) -> float:
        """Simulated time, 0 at the start [s]."""
        return self._steps * self.timestep

    @property
    def mass(self) -> float:
        """Of the whole lamp, as a scale would show it [kg]."""
        return float(self._model.body_subtreemass[self._model.body("base").id])

    @property
    def angle(self) -> Array:
        """Joint angles at the servos' horns, shape (n,) [rad]."""
        return self._motors.angle[0]

    @property
    def reading(self) -> Array:
        """What the encoders read of them, without noise, shape (n,) [rad]."""
        return self._motors.reading[0]

    @property
    def velocity(self) -> Array:
        """Joint velocities, shape (n,) [rad/s]."""
        return self._motors.velocity[0]

    @property
    def torque(self) -> Array:
        """Motor torques before friction, shape (n,) [Nm]."""
        return self._motors.torque[0]

    @property
    def current(self) -> Array:
        """Currents drawn from the supply, shape (n,) [A]; see `Motors.current`."""
        return self._drawn()[1]

    @property
    def duty(self) -> Array:
        """Motor voltages by supply voltage, shape (n,); 0 where the winding is open."""
        return self._drawn()[0]

    @property
    def voltage(self) -> float:
        """Supply voltage [V]."""
        return float(self._motors.voltage[0, 0])

    @property
    def force(self) -> float:
        """Floor force on the foot [N]."""
        return float(self._data.sensordata[self._twin.foot_sensor])

    @property
    def held(self) -> tuple[bool, ...]:
        """Whether each joint is still held by hand."""
        return tuple(bool(held) for held in self._held)

    def drive(self, joint: int, drive: Drive, late: float = 0.0) -> None:
        """Set what a servo does to its motor from the next step on, and take the hand off it; see `Driver.drive`."""
        if drive.torque and self._held[joint]:
            self._held[joint] = False
            self._data.qfrc_applied[self._twin.dof[joint]] = 0.0
        self._driver.drive(joint, drive, late)

    def warm(self, temperature: Array) -> None:
        """Let the servos be at temperatures, shape (n,) [degC], from the next step on."""
        self._motors.temperature[0] = temperature

    def sag(self, volts: float) -> None:
        """Let the supply sag from the next step on.

        Args:
            volts: By how much [V]; it stays above `LEAST_VOLTAGE`.
        """
        voltage = max(self._twin.voltage - volts, LEAST_VOLTAGE)
        if voltage != self.voltage:
            self._motors.charge(voltage)
            self._known = None

    def step(self) -> None:
        """Advance by one physics step.

        Raises:
            RobolampError: The physics diverged.
        """
        data = self._data
        self._motors.before_step()
        if self._held.any():  # a hand carries the weight too: friction alone creeps
            held, gears = self._twin.dof[self._held], self._twin.gears.dof[self._held]
            data.qfrc_applied[held] = data.qfrc_bias[held]
            gears = gears[gears >= 0]  # their springs have been written
            data.qfrc_applied[gears] += data.qfrc_bias[gears]
        before = data.time
        mujoco.mj_step(self._model, data)
        if data.time <= before:  # MuJoCo resets what diverges, and only its clock tells
            raise RobolampError(
                "the physics diverged; check masses, sizes and servo parameters", str(self._twin.lamp.path)
            )
        self._steps, self._known = self._steps + 1, None
        self._driver.after_step()

    def _drawn(self) -> tuple[Array, Array]:
        if self._known is None:
            self._known = self._motors.duty[0], self._motors.current[0]
        return self._known

    def truth(self) -> Truth:
        """Return what really happens now."""
        data, twin = self._data, self._twin
        site = data.site("base")
        x, z = float(site.xpos[0]), float(site.xpos[2])
        forward, upright = float(site.xmat[2]), float(site.xmat[8])
        lean = math.copysign(math.acos(max(-1.0, min(1.0, upright))), forward)
        axis = abs(float(data.site_xmat[twin.head_site][8]))
        radius, half = twin.head_size
        head = float(data.site_xpos[twin.head_site][2]) - half * axis - radius * math.sqrt(max(1.0 - axis * axis, 0.0))
        return Truth(
            base_x=x,
            base_z=z,
            lean=lean,
            clearance=z - twin.foot_radius * math.sqrt(max(1.0 - upright * upright, 0.0)),
            force=self.force,
            fallen=abs(lean) > FALLEN_TILT or head < FALLEN_HEAD,
        )
