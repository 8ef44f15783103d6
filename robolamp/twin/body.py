"""One lamp's physics: MuJoCo's step with the servos' load-dependent friction before it."""

from __future__ import annotations

import copy
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.twin.model import TwinModel
from robolamp.twin.servo import friction_loss, weaken, write_motors


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
        self._friction, self._weakness = twin.servos.friction()[None], twin.servos.weakness()[None]
        self._weakens = twin.servos.weakens
        data = self.data
        # Views of one lane, shape (1, nv), in the form that the many-lane kernel takes.
        self._motor, self._bias = data.qfrc_actuator[None], data.qfrc_bias[None]
        self._velocity, self._loss = data.qvel[None], self.model.dof_frictionloss[None]
        self._gains = self.model.actuator_gainprm[None]
        self.reset()

    def reset(self) -> None:
        """Stand in the neutral pose, goals 0, clock 0."""
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        mujoco.mj_forward(self.model, self.data)

    def step(self, count: int = 1) -> None:
        """Take physics steps."""
        twin = self._twin
        for _ in range(count):
            if self._weakens:
                weaken(self._weakness, twin.dof, twin.actuator, self._motor, self._velocity, self._gains)
            friction_loss(self._friction, self._twin.dof, self._motor, self._bias, self._velocity, self._loss)
            mujoco.mj_step(self.model, self.data)

    def set_goal(self, goal: NDArray[np.float64]) -> None:
        """Give the servos their goals, shape (n,) [rad]."""
        self.data.ctrl[self._twin.actuator] = goal

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

    @property
    def angle(self) -> NDArray[np.float64]:
        """True joint angles, shape (n,) [rad]."""
        return self.data.qpos[self._twin.qpos]

    @property
    def velocity(self) -> NDArray[np.float64]:
        """True joint velocities, shape (n,) [rad/s]."""
        return self.data.qvel[self._twin.dof]

    @property
    def torque(self) -> NDArray[np.float64]:
        """Torques of the motors, shape (n,) [Nm]."""
        return self.data.qfrc_actuator[self._twin.dof]

    @property
    def current(self) -> NDArray[np.float64]:
        """Currents drawn from the supply, shape (n,) [A]: duty times the winding's, as an XL330 reports them."""
        servos = self._twin.servos
        winding = self.torque / servos.torque_constant
        voltage = servos.resistance * winding + servos.torque_constant * self.velocity
        return np.clip(np.abs(voltage) / self._twin.voltage, 0.0, 1.0) * winding

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
