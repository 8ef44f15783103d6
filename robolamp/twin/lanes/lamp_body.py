"""One lamp's physics: MuJoCo's step with what the servos have beside it."""

from __future__ import annotations

import copy
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.twin.actuators.motors import Motors, Views
from robolamp.twin.lamp_model import TwinModel


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

    @property
    def goal(self) -> NDArray[np.float64]:
        """What the servos were told last, shape (n,) [rad]."""
        return self._motors.goal[0]

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
        """Change registers and supply from the next step on.

        Args:
            p_gain: Position P Gain registers (84), shape (n,).
            voltage: Supply voltage of each servo, shape (n,) [V].
            torque: Torque Enable, shape (n,).
            duty: Goal PWM(100), 0 to 1: the most of the supply that a motor gets.
        """
        motors = self._motors
        motors.p_gain[0], motors.driven[0], motors.limit[0] = p_gain, torque, duty
        motors.charge(voltage)

    @property
    def angle(self) -> NDArray[np.float64]:
        """True joint angles, at the servos' horns, shape (n,) [rad]."""
        return self._motors.angle[0]

    @property
    def velocity(self) -> NDArray[np.float64]:
        """True joint velocities, shape (n,) [rad/s]."""
        return self._motors.velocity[0]

    @property
    def torque(self) -> NDArray[np.float64]:
        """Torques of the motors, shape (n,) [Nm]."""
        return self._motors.torque[0]

    @property
    def current(self) -> NDArray[np.float64]:
        """Currents drawn from the supply, shape (n,) [A]; see `Motors.current`."""
        return self._motors.current[0]

    @property
    def voltage(self) -> float:
        """Supply voltage [V]."""
        return float(self._motors.voltage[0, 0])

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
