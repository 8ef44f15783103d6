"""One lamp's physics: MuJoCo's step with what the servos have beside it."""

from __future__ import annotations

import copy
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.twin.model import TwinModel
from robolamp.twin.motors import Motors, Views
from robolamp.twin.servo import write_motors


class Body:
    """A lamp that stands in the neutral pose and can be stepped.

    Args:
        twin: The lamp; its model is copied, so that bodies do not share friction or gains.

    Attributes:
        model: This body's own MuJoCo model.
        data: Its state.
    """

    def __init__(self, twin: TwinModel) -> None:
        self._twin = twin
        self.model = copy.copy(twin.model)
        self.data = mujoco.MjData(self.model)
        self._motors = Motors([twin], Views.of_one(self.model, self.data))
        self.reset()

    def reset(self) -> None:
        """Stand in the neutral pose, goals 0, clock 0."""
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self._motors.forget(0.0)
        mujoco.mj_forward(self.model, self.data)

    def step(self, count: int = 1) -> None:
        """Take physics steps."""
        for _ in range(count):
            self._motors.before_step()
            mujoco.mj_step(self.model, self.data)

    def set_goal(self, goal: NDArray[np.float64]) -> None:
        """Give the servos their goals, shape (n,) [rad]."""
        self._motors.goal[0] = goal
        self.data.ctrl[self._twin.actuator] = goal

    def place(self, angle: NDArray[np.float64]) -> None:
        """Put the joints to angles, shape (n,) [rad]."""
        self._motors.place(angle)

    def set_motors(
        self,
        p_gain: NDArray[np.float64],
        voltage: NDArray[np.float64],
        torque: NDArray[np.bool_],
        duty: float = 1.0,
    ) -> None:
        """Change gains, supply and torque enable, all of shape (n,), and the duty limit; see `servo.write_motors`."""
        rows = self.model.actuator_gainprm[self._twin.actuator]
        write_motors(rows, self._twin.servos, p_gain, voltage, torque, duty)
        self.model.actuator_gainprm[self._twin.actuator] = rows
        self._motors.charge(voltage[:1])

    @property
    def angle(self) -> NDArray[np.float64]:
        """True joint angles, at the servos' horns, shape (n,) [rad]."""
        return self._motors.angle[0]

    @property
    def velocity(self) -> NDArray[np.float64]:
        """True joint velocities, shape (n,) [rad/s]."""
        return self.data.qvel[self._twin.dof]

    @property
    def torque(self) -> NDArray[np.float64]:
        """Torques of the motors, shape (n,) [Nm]."""
        return self.data.qfrc_actuator[self._twin.gears.dof]

    @property
    def current(self) -> NDArray[np.float64]:
        """Currents drawn from the supply, shape (n,) [A]: duty times the winding's, as an XL330 reports them."""
        servos = self._twin.servos
        winding = self.torque / servos.torque_constant
        speed = self.data.qvel[self._twin.gears.dof]
        volts = servos.resistance * winding + servos.torque_constant * speed
        return np.clip(np.abs(volts) / self.voltage, 0.0, 1.0) * winding

    @property
    def voltage(self) -> float:
        """Supply voltage [V]."""
        return float(self._motors.voltage[0])

    @property
    def force(self) -> float:
        """True floor force on the foot [N]."""
        return float(self.data.sensordata[self._twin.foot_sensor])

    @property
    def base(self) -> tuple[float, float, float]:
        """Base centre's x and z [m] and its pitch (positive forward) [rad]."""
        x, _, z, _, qx, qy, _ = self.data.qpos[:7]
        qw, qz = self.data.qpos[3], self.data.qpos[6]
        # Angle of the foot's axis in the x-z plane.
        pitch = math.atan2(2 * (qx * qz + qw * qy), 1 - 2 * (qx * qx + qy * qy))
        return float(x), float(z), pitch
