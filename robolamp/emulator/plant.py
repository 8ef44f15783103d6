"""What the emulated servos turn and the foot stands on: the twin in MuJoCo, one lane, one step at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.emulator.bend import Bent
from robolamp.emulator.delay import DelayLine
from robolamp.errors import RobolampError
from robolamp.twin.judge import FALLEN_HEAD, FALLEN_TILT
from robolamp.twin.servo import friction_loss, weaken, write_motors

Array = NDArray[np.float64]

_HAND = 5.0  # friction by which a hand holds a joint [Nm]: ten times what a servo can push
_SETTLE = 0.5  # time for the foot to come to rest on the floor before the clock starts [s]
_LEAST_VOLTAGE = 0.1  # a supply that sags keeps this much: duties are shares of it [V]
_GAIN, _LARGEST_VOLTAGE = 4, 7  # where a dcmotor's actuator_gainprm holds them
_FAR = 1e6  # goal that stands for a duty of 1 [rad]
_ONE = np.zeros(1, np.int64)  # the lanes: one


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
        bent: The compiled lamp; this plant alone may use it, for it writes into its model.

    Attributes:
        timestep: Physics step [s].
    """

    def __init__(self, bent: Bent) -> None:
        twin = bent.twin
        self._twin = twin
        self._servos = twin.servos
        self._weakens = twin.servos.weakens
        self._model = twin.model
        mujoco.mj_setConst(self._model, mujoco.MjData(self._model))  # masses may have been changed
        gears = twin.gears
        self._motor_qpos, self._motor_dof = gears.qpos, gears.dof
        self._slack, self._damping = gears.slack, gears.damping
        self._springy, self._springs = gears.springy, gears.springs[gears.springy]
        self._parted = gears.parted  # joints whose motors turn rotors of their own
        self._encoders = bent.encoders
        self._delays: list[DelayLine] | None = None
        if bent.own_delay:
            self._delays = [DelayLine(float(delay), twin.timestep) for delay in twin.servos.delay]
        self._data = mujoco.MjData(twin.model)
        self.timestep = twin.timestep
        n = len(twin.qpos)
        self._driven = np.zeros(n, bool)
        self._hand = np.ones(n, bool)
        self._p_gain = np.ones(n)
        self._by_duty = np.zeros(n, bool)
        self._duty_limit = np.ones(n)
        self._speed = np.zeros(n)  # when the motors' torques were formed: before the last step
        self._steps = 0
        self._sag = 0.0
        self._goal = np.zeros(n)
        self._arriving: dict[int, float] = {}  # goals that come within the next step, by joint
        self._friction, self._weakness = twin.servos.friction()[None], twin.servos.weakness()[None]
        self._gains = self._model.actuator_gainprm[None]
        data = self._data
        self._load = data.qfrc_bias.copy() if self._parted.any() else data.qfrc_bias
        self._lanes = tuple(
            array.reshape(1, -1) for array in (data.qfrc_actuator, self._load, data.qvel, self._model.dof_frictionloss)
        )
        mujoco.mj_resetDataKeyframe(self._model, data, 0)
        self._write_motors()
        for _ in range(round(_SETTLE / self.timestep)):
            self.step()
        data.qvel[:] = 0.0
        self._steps = 0  # data.time runs on: the delay lines hold its stamps

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
        angle = self._data.qpos[self._twin.qpos]
        if not self._springy.any():
            return angle
        rotor = self._data.qpos[self._motor_qpos]
        return np.clip(angle, rotor - self._slack, rotor + self._slack)

    @property
    def reading(self) -> Array:
        """What the encoders read of them, without noise, shape (n,) [rad]."""
        return self._encoders.read(self.angle) if self._encoders else self.angle

    @property
    def velocity(self) -> Array:
        """Joint velocities, shape (n,) [rad/s]."""
        return self._data.qvel[self._twin.dof]

    @property
    def torque(self) -> Array:
        """Motor torques before friction, shape (n,) [Nm]."""
        return self._data.actuator_force[self._twin.actuator]

    @property
    def phase_current(self) -> Array:
        """Winding currents, shape (n,) [A]."""
        return self.torque / self._servos.torque_constant

    @property
    def duty(self) -> Array:
        """Motor voltages by supply voltage, shape (n,); 0 where the winding is open."""
        servos = self._servos
        resistance = self._weakness[0, :, 4] if self._weakens else servos.resistance
        volts = self.phase_current * resistance + servos.torque_constant * self._speed
        return np.where(self._driven, np.clip(volts / self.voltage, -1.0, 1.0), 0.0)

    @property
    def voltage(self) -> float:
        """Supply voltage [V]."""
        return self._twin.voltage - self._sag

    @property
    def force(self) -> float:
        """Floor force on the foot [N]."""
        return float(self._data.sensordata[self._twin.foot_sensor])

    @property
    def held(self) -> tuple[bool, ...]:
        """Whether each joint is still held by hand."""
        return tuple(bool(held) for held in self._hand)

    def drive(
        self,
        joint: int,
        *,
        torque: bool,
        goal: float,
        p_gain: int,
        duty_limit: float,
        duty: float | None = None,
        late: float = 0.0,
    ) -> None:
        """Set what a servo does to its motor from the next step on.

        Args:
            joint: Which joint.
            torque: Whether the motor is driven; else its winding is open.
            goal: Joint angle to regulate to [rad].
            p_gain: Position P Gain register.
            duty_limit: Largest duty, 0 to 1.
            duty: Motor voltage by supply voltage, instead of a goal; None: regulate to the goal.
            late: How far into the next step the goal or duty comes, 0 to 1 of it: that step's is the mean of the one
                before and this one, weighted by the time that each holds, or else every goal would come early.
        """
        actuator = int(self._twin.actuator[joint])
        before = self._goal[joint]
        by_duty = duty is not None
        if duty is not None:
            # So far away that the joint's own angle is nothing to it: gain times distance is the voltage.
            goal, p_gain = duty * _FAR, 1
        if torque and (not self._driven[joint] or by_duty != self._by_duty[joint]):
            # The delay line still holds goals from before: a servo that is switched on has forgotten them.
            if self._delays:
                self._delays[joint].reset(goal)
            else:
                mujoco.mj_initCtrlHistory(self._model, self._data, actuator, None, np.full(self._samples(joint), goal))
            self._hand[joint] = False
            self._data.qfrc_applied[self._twin.dof[joint]] = 0.0
            before = goal
        self._driven[joint], self._p_gain[joint], self._duty_limit[joint] = torque, p_gain, duty_limit
        self._by_duty[joint] = by_duty
        mixed = goal + min(max(late, 0.0), 1.0) * (before - goal)
        self._goal[joint] = self._data.ctrl[actuator] = mixed
        if mixed != goal:
            self._arriving[joint] = goal
        self._write_motors()

    def warm(self, factor: Array) -> None:
        """Let the windings' resistance be their calibrated one times a factor, shape (n,), from the next step on."""
        self._servos = replace(self._servos, resistance=self._twin.servos.resistance * factor)
        self._weakness[0, :, 1] = self._servos.resistance
        self._write_motors()

    def sag(self, volts: float) -> None:
        """Let the supply sag from the next step on.

        Args:
            volts: By how much [V]; it stays above 0.1 V.
        """
        volts = min(volts, self._twin.voltage - _LEAST_VOLTAGE)
        if volts != self._sag:
            self._sag = volts
            self._write_motors()

    def step(self) -> None:
        """Advance by one physics step.

        Raises:
            RobolampError: The physics diverged.
        """
        data, dofs = self._data, self._twin.dof
        if self._parted.any():
            self._load[self._motor_dof] = data.qfrc_bias[dofs]  # gears feel the output's load
            self._model.dof_frictionloss[dofs] = 0.0
        if self._springs.size:
            gap = np.abs(data.qpos[self._motor_qpos] - data.qpos[self._twin.qpos])
            self._model.tendon_damping[self._springs] = self._damping * (gap > self._slack)[self._springy]
        if self._weakens:
            motor, velocity = self._lanes[0], self._lanes[2]
            weaken(self._weakness, self._motor_dof, self._twin.actuator, motor, velocity, self._gains)
        friction_loss(_ONE, self._friction, self._motor_dof, *self._lanes)
        if self._hand.any():
            held = dofs[self._hand]
            self._model.dof_frictionloss[held] = _HAND
            data.qfrc_applied[held] = data.qfrc_bias[held]  # it carries the weight too: friction alone creeps
        if self._delays:
            self._regulate(self._delays)
        self._speed = data.qvel[self._motor_dof]
        before = data.time
        mujoco.mj_step(self._model, data)
        if data.time <= before:  # MuJoCo resets what diverges, and only its clock tells
            raise RobolampError(
                "the physics diverged; check masses, sizes and servo parameters", str(self._twin.lamp.path)
            )
        self._steps += 1
        for joint, goal in self._arriving.items():
            self._goal[joint] = data.ctrl[self._twin.actuator[joint]] = goal
        self._arriving.clear()

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

    def _regulate(self, delays: list[DelayLine]) -> None:
        """Let the motors act on what the encoders read, though the model's actuators see the rotors."""
        goal = np.array([delay.push(goal) for delay, goal in zip(delays, self._goal.tolist(), strict=True)])
        self._data.ctrl[self._twin.actuator] = goal + self._data.qpos[self._motor_qpos] - self.reading

    def _write_motors(self) -> None:
        actuators, voltage = self._twin.actuator, self.voltage
        rows = self._model.actuator_gainprm[actuators]
        write_motors(rows, self._servos, self._p_gain, np.full(len(rows), voltage), self._driven)
        k, r = self._servos.torque_constant, self._servos.resistance
        rows[self._by_duty, _GAIN] = (k / r * voltage / _FAR)[self._by_duty]
        rows[:, _LARGEST_VOLTAGE] = voltage * self._duty_limit
        self._model.actuator_gainprm[actuators] = rows

    def _samples(self, joint: int) -> int:
        return int(self._model.actuator_history[self._twin.actuator[joint], 0])
