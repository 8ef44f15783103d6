"""The servos of many lanes: THE motor step, what MuJoCo's own step does not do of them, before each of it.

The laws of one servo are those of servo.py beside this. Here they meet a physics: the motors' gains under heat,
saturation and a supply that all servos of a lamp share, friction under load, the goals' delay, and gears with play
(gears.py), where a motor turns its joint but regulates what the encoder reads behind the play. Twin, fleet, bank, bench
and the emulated lamp and pendulum all step through it; one lane is the same code as many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from robolamp.jit import njit
from robolamp.twin.actuators.encoders import Encoders, misreading
from robolamp.twin.actuators.gears import Gears, gear_inertia, gear_torque, read_beyond, read_speed
from robolamp.twin.actuators.servo import (
    OPEN,
    REFERENCE_TEMPERATURE,
    TORQUE_CONSTANT,
    ServoParameters,
    effective_resistance,
    friction_loss,
    motor_duty,
    viscous_friction,
    voltage_gain,
    write_motor,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LEAST_VOLTAGE = 0.5
"""A supply that sags keeps this much: a servo switches off long before [V]."""

HAND = 5.0
"""Friction by which a hand holds a joint and its gear [Nm]: ten times what a servo can push."""


class Driven(Protocol):
    """A compiled model whose n joints are driven by servos."""

    @property
    def servos(self) -> ServoParameters:
        """Their parameters."""
        ...

    @property
    def p_gain(self) -> Array:
        """Their Position P Gain registers (84), shape (n,)."""
        ...

    @property
    def voltage(self) -> float:
        """Supply voltage [V]."""
        ...

    @property
    def supply_resistance(self) -> float:
        """Of the supply that all servos share [Ohm]."""
        ...

    @property
    def qpos(self) -> Indices:
        """Position address of each joint, shape (n,)."""
        ...

    @property
    def dof(self) -> Indices:
        """Degree of freedom of each joint, shape (n,)."""
        ...

    @property
    def actuator(self) -> Indices:
        """Actuator of each joint, shape (n,)."""
        ...

    @property
    def gears(self) -> Gears:
        """What the motors turn."""
        ...

    @property
    def encoders(self) -> Encoders:
        """How their encoders are off."""
        ...

    @property
    def timestep(self) -> float:
        """Physics step [s]."""
        ...


@dataclass(frozen=True)
class Views:
    """Where the physics of k lanes keeps what servos read and write; arrays are live.

    Attributes:
        qpos: Shape (k, nq).
        qvel: Shape (k, nv).
        ctrl: Shape (k, nu); written to.
        motor: `qfrc_actuator`, shape (k, nv) [Nm].
        bias: `qfrc_bias`, shape (k, nv) [Nm].
        loss: `dof_frictionloss`, shape (k, nv) [Nm]; written to.
        gains: `actuator_gainprm`, shape (k, nu, 10 or more); written to. Of no lanes where all motors stay as compiled.
        viscous: `actuator_damping`, shape (k, nu, ...); written to. Of no lanes where it depends on no temperature.
        applied: `qfrc_applied`, shape (k, nv); written to [Nm].
        armature: `dof_armature`, shape (k, nv); written to. Of no lanes where all joints are rigid.
    """

    qpos: Array
    qvel: Array
    ctrl: Array
    motor: Array
    bias: Array
    loss: Array
    gains: Array
    viscous: Array
    applied: Array
    armature: Array

    @classmethod
    def of_batch(cls, batch: Batch, twins: Sequence[Driven], *, gains: bool = False) -> Views:
        """Return the views of a batch.

        Args:
            batch: Its lanes; gets own model values in each lane where servos need them.
            twins: The lamp of each lane, or some of which each lane has one.
            gains: Whether the caller changes what drives the motors: registers, torque or the supply.
        """
        bind = batch.bind
        gains = gains or any(twin.servos.weakens or twin.supply_resistance > 0.0 for twin in twins)
        thickens = any(twin.servos.viscous_temperature.any() for twin in twins)
        yields = any((twin.gears.dof >= 0).any() for twin in twins)
        return cls(
            bind("qpos"), bind("qvel"), bind("ctrl"), bind("qfrc_actuator"), bind("qfrc_bias"),
            loss=batch.expand("dof_frictionloss"),
            gains=batch.expand("actuator_gainprm") if gains else np.empty((0, 0, 0)),
            viscous=batch.expand("actuator_damping") if thickens else np.empty((0, 0)),
            applied=bind("qfrc_applied"),
            armature=batch.expand("dof_armature") if yields else np.empty((0, 0)),
        )  # fmt: skip

    @classmethod
    def of_one(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Views:
        """Return the views of one lane, in the form that many lanes have."""
        return cls(
            data.qpos[None], data.qvel[None], data.ctrl[None], data.qfrc_actuator[None], data.qfrc_bias[None],
            loss=model.dof_frictionloss[None], gains=model.actuator_gainprm[None],
            viscous=model.actuator_damping[None], applied=data.qfrc_applied[None], armature=model.dof_armature[None],
        )  # fmt: skip


class Motors:
    """The servos of k lanes, of lamps that differ in numbers only; each has n.

    What the caller may change acts from the next step on; registers, torque, temperature and supply do only where
    `Views` has gains (and viscous friction) of the lanes.

    Args:
        twins: The lamps.
        views: Of the lanes.
        variant: Which of the lamps each lane has, shape (k,); None: a lane a lamp.

    Attributes:
        goal: What each servo was told last, shape (k, n) [rad]; a duty, -1 to 1, where `by_duty`. Written by the
            caller; acts after the servo's delay.
        by_duty: Whether a motor gets a duty instead of regulating to a goal, shape (k, n); written by the caller.
        p_gain: Position P Gain registers (84), shape (k, n); written by the caller.
        limit: Goal PWM(100), 0 to 1: the most of the supply that a motor gets, shape (k, n); written by the caller.
        driven: Share of the next step in which a winding is driven, else open, shape (k, n); written by the caller.
        temperature: Of the servos, shape (k, n) [degC]; written by the caller.
        full: Supply voltages when no current is drawn, shape (k, n) [V]; written by the caller.
        held: Joints that a hand holds, shape (k, n); written by the caller.
        voltage: Supply voltages now, shape (k, n) [V].
    """

    def __init__(self, twins: Sequence[Driven], views: Views, variant: Indices | None = None) -> None:
        twin = twins[0]
        variant = np.arange(len(twins)) if variant is None else variant
        shape = lanes, n = len(variant), len(twin.dof)
        self._views, self._qpos, self._dof = views, twin.qpos, twin.dof
        self._bent = twin.gears.qpos[twin.gears.qpos >= 0]
        self._where = np.stack([twin.gears.qpos, twin.dof, twin.actuator, twin.gears.dof, twin.qpos])
        self._gears = np.stack([each.gears.table for each in twins])[variant]
        self._encoders = np.stack([each.encoders.table for each in twins])[variant]
        self._table = np.stack([each.servos.table for each in twins])[variant]
        self._supply = np.array([each.supply_resistance for each in twins])[variant]
        self._thickens = any(each.servos.viscous_temperature.any() for each in twins)
        self._every = np.arange(lanes)
        self.p_gain = np.stack([each.p_gain for each in twins])[variant]
        self.full = np.repeat(np.array([[each.voltage] for each in twins])[variant], n, axis=1)
        self.voltage = self.full.copy()
        self.by_duty, self.held = np.zeros(shape, bool), np.zeros(shape, bool)
        self.limit, self.driven = np.ones(shape), np.ones(shape)
        self.temperature = np.full(shape, REFERENCE_TEMPERATURE)
        self._resistance = np.stack([each.servos.resistance for each in twins])[variant]
        self._speed = np.zeros(shape)  # when the motors' torques were formed: before the last step
        steps = np.stack([each.servos.delay for each in twins])[variant] / twin.timestep
        self._steps = np.floor(steps).astype(np.int64)
        self._part = steps - self._steps
        self.goal = np.zeros(shape)
        self._sent = np.zeros((lanes, n, int(self._steps.max()) + 2))
        self._head = 0

    @property
    def angle(self) -> Array:
        """Angles at the servos' horns, where the encoders are, shape (k, n) [rad]."""
        return self._read()[0]

    @property
    def reading(self) -> Array:
        """What the encoders read of them, shape (k, n) [rad]."""
        return self._read()[2]

    @property
    def velocity(self) -> Array:
        """Speeds at the servos' horns, shape (k, n) [rad/s]."""
        return self._read()[1]

    def _read(self) -> tuple[Array, Array, Array]:
        angle, speed, reading = (np.empty_like(self.goal) for _ in range(3))
        _read(self._where, self._gears, self._encoders, self._views.qpos, self._views.qvel, angle, speed, reading)
        return angle, speed, reading

    @property
    def torque(self) -> Array:
        """Motor torques before friction, shape (k, n) [Nm]."""
        return self._views.motor[:, self._dof]

    @property
    def winding_current(self) -> Array:
        """Currents of the windings, shape (k, n) [A]."""
        return self.torque / self._table[:, :, TORQUE_CONSTANT]

    @property
    def duty(self) -> Array:
        """Motor voltages by supply voltage in the last step, -1 to 1, shape (k, n); 0 where the winding is open."""
        duty = np.empty_like(self.goal)
        _duties(self._table, self._resistance, self.torque, self._speed, self.voltage, duty)
        return duty

    @property
    def current(self) -> Array:
        """Currents drawn from the supply, shape (k, n) [A]: duty times the winding's, as an XL330 reports them.

        Positive where the motor pushes towards larger angles.
        """
        return np.abs(self.duty) * self.winding_current

    def place(self, angle: Array) -> None:
        """Put joints to angles, shape (n,) or (k, n) [rad], at rest, in the middle of their play and not bent."""
        self._views.qpos[:, self._qpos] = angle
        self._views.qpos[:, self._bent] = 0.0

    def turn(self, angle: Array) -> None:
        """Turn joints until their horns are at angles, shape (n,) [rad]; gears stay pushed, links bent."""
        self._views.qpos[:, self._qpos] += angle - self.angle

    def forget(self, goal: Array | float, joints: int | slice = slice(None)) -> None:
        """Let goals, shape (k, n) [rad] or one for all, have been told to joints all along."""
        self.goal[:, joints] = goal
        self._sent[:, joints] = self.goal[:, joints, None]

    def charge(self, voltage: Array | float) -> None:
        """Let the supplies be at these voltages now, and when no current is drawn, shape (k, n) or one for all [V]."""
        self.full[:] = voltage
        self.voltage[:] = self.full

    def before_step(self, lanes: Indices | None = None) -> None:
        """Write what the next physics step needs: motors, friction, controls.

        Args:
            lanes: Which lanes will be stepped; None: all. What has fallen in a fleet costs nothing from then on.
        """
        views = self._views
        lanes = self._every if lanes is None else lanes
        if len(views.gains):
            _feed(
                lanes, self._where, self._table, views.motor, views.qvel, self.temperature, self.p_gain, self.by_duty,
                self.limit, self.driven, self._supply, self.full, self.voltage, self._resistance, views.gains,
            )  # fmt: skip
        if self._thickens:
            _thicken(lanes, self._where, self._table, self.temperature, views.viscous)
        self._head = (self._head + 1) % self._sent.shape[2]
        _regulate(
            lanes, self._where, self._table, self._gears, self._encoders, views.motor, views.bias, views.qpos,
            views.qvel, self.held, self.goal, self._sent, self._head, self._steps, self._part, self.by_duty,
            self.voltage, self._speed, views.loss, views.ctrl, views.applied, views.armature,
        )  # fmt: skip


@njit(nogil=True, error_model="numpy")
def _feed(
    lanes: Indices,
    where: Indices,
    table: Array,
    motor: Array,
    velocity: Array,
    temperature: Array,
    p_gain: Array,
    by_duty: NDArray[np.bool_],
    limit: Array,
    driven: Array,
    supply: Array,
    full: Array,
    voltage: Array,
    resistance: Array,
    gainprm: Array,
) -> None:
    """Write the motors of some lanes as their registers, heat, saturation and supplies let them be.

    A servo's driver is a switching converter: it draws duty times the winding's current, duty being the motor's voltage
    over the supply's. The supply gives V = V_full - R sum(duty |i|), from the currents of the last step.

    Args:
        lanes: Which, of k.
        where: Position address of each joint's gear or -1, the joint's degree of freedom, its actuator, the gear's
            degree of freedom or -1, and the joint's position address, shape (5, n).
        table: `ServoParameters.table` of each lane, shape (k, n, parameters).
        motor: See `Views`.
        velocity: `Views.qvel`.
        temperature: See `Motors`, as for those that follow up to `driven`.
        p_gain: See there.
        by_duty: See there.
        limit: See there.
        driven: See there.
        supply: R of each lane's supply, shape (k,) [Ohm].
        full: See `Motors`.
        voltage: See `Motors`; written to.
        resistance: Effective resistances of the last step, shape (k, n) [Ohm]; written to.
        gainprm: `Views.gains`; written to.
    """
    for index in range(lanes.shape[0]):
        lane = lanes[index]
        drawn = 0.0
        for joint in range(where.shape[1]):
            servo, dof = table[lane, joint], where[1, joint]
            torque, speed, share = motor[lane, dof], velocity[lane, dof], driven[lane, joint]
            if supply[lane] == 0.0:
                voltage[lane, joint] = max(full[lane, joint], LEAST_VOLTAGE)
            if share == 0.0:
                resistance[lane, joint] = OPEN
                continue
            before = resistance[lane, joint]
            drop = 0.0 if before == OPEN else torque / servo[TORQUE_CONSTANT] * before
            now = effective_resistance(servo, temperature[lane, joint], drop, speed, voltage[lane, joint]) / share
            duty = motor_duty(servo, now, torque, speed, voltage[lane, joint])
            drawn += abs(duty * torque / servo[TORQUE_CONSTANT])
            resistance[lane, joint] = now
        for joint in range(where.shape[1]):
            servo = table[lane, joint]
            if supply[lane] != 0.0:
                voltage[lane, joint] = max(full[lane, joint] - supply[lane] * drawn, LEAST_VOLTAGE)
            volts = voltage[lane, joint]
            gain = 1.0 if by_duty[lane, joint] else voltage_gain(servo, p_gain[lane, joint], volts)
            row = gainprm[lane, where[2, joint]]
            write_motor(row, servo, resistance[lane, joint], gain, volts * limit[lane, joint])


@njit(nogil=True, error_model="numpy")
def _thicken(lanes: Indices, where: Indices, table: Array, temperature: Array, damping: Array) -> None:
    """Write viscous friction at the servos' temperatures into `actuator_damping` of some lanes; see `_feed`."""
    for index in range(lanes.shape[0]):
        lane = lanes[index]
        for joint in range(where.shape[1]):
            damping[lane, where[2, joint]] = viscous_friction(table[lane, joint], temperature[lane, joint])


@njit(nogil=True, error_model="numpy")
def _regulate(
    lanes: Indices,
    where: Indices,
    table: Array,
    gears: Array,
    encoders: Array,
    motor: Array,
    bias: Array,
    qpos: Array,
    velocity: Array,
    held: NDArray[np.bool_],
    goal: Array,
    sent: Array,
    head: int,
    steps: Indices,
    part: Array,
    by_duty: NDArray[np.bool_],
    voltage: Array,
    formed: Array,
    loss: Array,
    ctrl: Array,
    applied: Array,
    armature: Array,
) -> None:
    """Write gears, friction and controls of some lanes: let motors regulate what encoders read, after their delay.

    An actuator regulates its joint, so its control is the delayed goal less what the encoder reads beyond the joint.

    Args:
        lanes: Which, of k.
        where: See `_feed`.
        table: See `_feed`.
        gears: `Gears.table` of each lane, shape (k, n, 5).
        encoders: `Encoders.table` of each lane, shape (k, n, 4).
        motor: See `Views`.
        bias: See `Views`.
        qpos: See `Views`.
        velocity: `Views.qvel`.
        held: See `Motors`.
        goal: See `Motors`.
        sent: Goals of the last steps, a ring, shape (k, n, longest delay in steps + 2); written to.
        head: Where in it this step's goal belongs.
        steps: Whole physics steps of each servo's delay, shape (k, n).
        part: The rest of it, in steps, shape (k, n): the goals before and after are mixed.
        by_duty: See `Motors`.
        voltage: See `Motors`.
        formed: Speeds that this step's torques are formed with, shape (k, n) [rad/s]; written to.
        loss: See `Views`; written to.
        ctrl: See `Views`; written to.
        applied: See `Views`; written to.
        armature: See `Views`; written to.
    """
    for index in range(lanes.shape[0]):
        lane = lanes[index]
        for joint in range(where.shape[1]):
            gear, dof = where[0, joint], where[1, joint]
            speed, angle = velocity[lane, dof], qpos[lane, where[4, joint]]
            beyond = 0.0
            if gear >= 0:
                bent, turns = gears[lane, joint], where[3, joint]
                applied[lane, turns] = gear_torque(bent, qpos[lane, gear], velocity[lane, turns])
                armature[lane, turns] = gear_inertia(bent, qpos[lane, gear])
                loss[lane, turns] = HAND if held[lane, joint] else 0.0
                beyond = read_beyond(bent, qpos[lane, gear])
            beyond += misreading(encoders[lane, joint], angle + beyond)
            formed[lane, joint] = speed
            friction = friction_loss(table[lane, joint], motor[lane, dof], -bias[lane, dof], speed)
            loss[lane, dof] = HAND if held[lane, joint] else friction
            ring, back = sent[lane, joint], steps[lane, joint]
            ring[head] = goal[lane, joint]
            newer, older = ring[head - back], ring[head - back - 1]  # below 0: from the ring's end on
            late = newer + part[lane, joint] * (older - newer)
            if by_duty[lane, joint]:
                ctrl[lane, where[2, joint]] = angle + late * voltage[lane, joint]
                continue
            ctrl[lane, where[2, joint]] = late - beyond


@njit(nogil=True, error_model="numpy")
def _duties(table: Array, resistance: Array, torque: Array, speed: Array, voltage: Array, duty: Array) -> None:
    """Write the duty of each motor, shape (k, n), into `duty`; see `Motors.duty`."""
    for lane in range(duty.shape[0]):
        for joint in range(duty.shape[1]):
            duty[lane, joint] = 0.0
            if resistance[lane, joint] != OPEN:
                duty[lane, joint] = motor_duty(
                    table[lane, joint], resistance[lane, joint], torque[lane, joint], speed[lane, joint],
                    voltage[lane, joint],
                )  # fmt: skip


@njit(nogil=True, error_model="numpy")
def _read(
    where: Indices, gears: Array, encoders: Array, qpos: Array, velocity: Array, angle: Array, speed: Array,
    reading: Array,
) -> None:  # fmt: skip
    """Write angles at the horns, how fast they change, and what the encoders read, shape (k, n); see `_regulate`."""
    for lane in range(angle.shape[0]):
        for joint in range(angle.shape[1]):
            angle[lane, joint] = qpos[lane, where[4, joint]]
            speed[lane, joint] = velocity[lane, where[1, joint]]
            gear = where[0, joint]
            if gear >= 0:
                bent, turning = gears[lane, joint], velocity[lane, where[3, joint]]
                angle[lane, joint] += read_beyond(bent, qpos[lane, gear])
                speed[lane, joint] += read_speed(bent, qpos[lane, gear], turning)
            reading[lane, joint] = angle[lane, joint] + misreading(encoders[lane, joint], angle[lane, joint])
