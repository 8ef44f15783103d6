"""The servos of many lanes: what MuJoCo's step does not do of them, before each step.

Load-dependent friction and weakness (`robolamp.twin.servo`), a supply that all servos of a lamp share, and gears with
play (`robolamp.twin.gears`), where a motor turns its rotor but regulates what the encoder reads of the output.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from robolamp.calibration import SERVO
from robolamp.jit import njit
from robolamp.twin.gears import regulate
from robolamp.twin.model import TwinModel
from robolamp.twin.servo import friction_loss, weaken

Array = NDArray[np.float64]

LEAST_VOLTAGE = 0.5
"""A supply that sags keeps this much: a servo switches off long before [V]."""
_R, _KP, _VMAX = 0, 4, 7  # columns of a dcmotor's actuator_gainprm
_OPEN = 1e8  # no winding has as much [Ohm]


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
        gains: `actuator_gainprm`, shape (k, nu, 10); written to where a lamp's motors weaken or its supply sags.
        damping: `tendon_damping`, shape (k, tendons, ...); written to where springs have play.
    """

    qpos: Array
    qvel: Array
    ctrl: Array
    motor: Array
    bias: Array
    loss: Array
    gains: Array
    damping: Array

    @classmethod
    def of_batch(cls, batch: Batch, twins: Sequence[TwinModel], *, gains: bool = False) -> Views:
        """Return the views of a batch.

        Args:
            batch: Its lanes; gets own model values in each lane where servos need them.
            twins: The lamp of each lane, or some of which each lane has one.
            gains: Whether the caller writes gains.
        """
        bind = batch.bind
        gains = gains or any(twin.servos.weakens or twin.supply_resistance > 0.0 for twin in twins)
        springy = twins[0].gears.springy.any()
        return cls(
            bind("qpos"), bind("qvel"), bind("ctrl"), bind("qfrc_actuator"), bind("qfrc_bias"),
            loss=batch.expand("dof_frictionloss"),
            gains=batch.expand("actuator_gainprm") if gains else np.empty((0, 0, 0)),
            damping=batch.expand("tendon_damping") if springy else np.empty((0, 0)),
        )  # fmt: skip

    @classmethod
    def of_one(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Views:
        """Return the views of one lane, in the form that many lanes have."""
        return cls(
            data.qpos[None], data.qvel[None], data.ctrl[None], data.qfrc_actuator[None], data.qfrc_bias[None],
            loss=model.dof_frictionloss[None], gains=model.actuator_gainprm[None], damping=model.tendon_damping[None],
        )  # fmt: skip


class Motors:
    """The servos of k lanes, of lamps that differ in numbers only.

    Args:
        twins: The lamps.
        views: Of the lanes.
        variant: Which of the lamps each lane has, shape (k,); None: a lane a lamp.

    Attributes:
        goal: What each servo was told last, shape (k, n) [rad]; written by the caller.
        full: Supply voltage of each lane when no current is drawn, shape (k,) [V]. Whoever writes other gains into the
            motors calls `charge` for them.
        voltage: Supply voltage of each lane now, shape (k,) [V].
    """

    def __init__(self, twins: Sequence[TwinModel], views: Views, variant: NDArray[np.int64] | None = None) -> None:
        twin = twins[0]
        variant = np.arange(len(twins)) if variant is None else variant
        lanes, n = len(variant), len(twin.dof)
        self._twin, self._views, self._gears = twin, views, twin.gears
        servos = [each.servos for each in twins]
        self._friction = np.stack([each.friction() for each in servos])[variant]
        self._weakens = any(each.weakens for each in servos)
        weakness = [each.weakness() for each in servos] if self._weakens else []
        self._weakness = np.stack(weakness)[variant] if weakness else np.empty((0, n, 5))
        self._supply = np.array([each.supply_resistance for each in twins])[variant]
        self._every = np.arange(lanes)
        self._k = np.stack([each.torque_constant for each in servos])[variant]
        self.full = np.array([each.voltage for each in twins])[variant]
        self.voltage = self.full.copy()
        self.goal = np.zeros((lanes, n))
        self._parted = bool(twin.gears.parted.any())
        self._load = views.bias
        if self._parted:
            self._load = views.bias.copy()
            self._slack = np.stack([each.gears.slack for each in twins])[variant]
            steps = np.stack([each.delay for each in servos])[variant] / twin.timestep
            self._steps = np.floor(steps).astype(np.int64)
            self._part = steps - self._steps
            self._sent = np.zeros((lanes, n, math.ceil(SERVO["delay"].high / twin.timestep) + 2))
            self._head = 0
            springs = twin.gears.springs
            self._springs, self._springy = springs[twin.gears.springy], twin.gears.springy
            self._damping = np.array([each.gears.damping for each in twins])[variant]

    @property
    def angle(self) -> Array:
        """Angles at the servos' horns, where the encoders are, shape (k, n) [rad]."""
        angle = self._views.qpos[:, self._twin.qpos]
        if not self._gears.springy.any():
            return angle
        rotor = self._views.qpos[:, self._gears.qpos]
        return np.clip(angle, rotor - self._slack, rotor + self._slack)

    def place(self, angle: Array) -> None:
        """Put joints and what turns them to angles, shape (n,) or (k, n) [rad], at rest."""
        for address in (self._twin.qpos, self._gears.qpos):
            self._views.qpos[:, address] = angle

    def turn(self, angle: Array) -> None:
        """Turn joints until their horns are at angles, shape (n,) [rad]; gears stay pushed, links bent."""
        by = angle - self.angle
        self._views.qpos[:, self._twin.qpos] += by
        parted = self._gears.parted
        self._views.qpos[:, self._gears.qpos[parted]] += by[:, parted]

    def forget(self, goal: Array | float) -> None:
        """Let goals, shape (k, n) [rad] or one for all, have been told all along."""
        self.goal[:] = goal
        if self._parted:
            self._sent[:] = self.goal[:, :, None]

    def charge(self, voltage: Array) -> None:
        """Say that the motors' gains were just written for a supply of this voltage, shape (k,) [V]."""
        self.full[:] = self.voltage[:] = voltage

    def before_step(self, lanes: NDArray[np.int64] | None = None) -> None:
        """Write what the next physics step needs: voltages, resistances, friction, controls.

        Args:
            lanes: Which lanes will be stepped; None: all. What has fallen in a fleet costs nothing from then on.
        """
        views, twin, gears = self._views, self._twin, self._gears
        lanes = self._every if lanes is None else lanes
        if self._weakens:
            weaken(self._weakness, gears.dof, twin.actuator, views.motor, views.qvel, views.gains)
        if self._supply.any():
            sag(
                self._supply, self.full, LEAST_VOLTAGE, self._k, gears.dof, twin.actuator, views.motor, views.qvel,
                views.gains, self.voltage,
            )  # fmt: skip
        if not self._parted:
            drive(
                lanes, self._friction, gears.dof, views.motor, views.bias, views.qvel, views.loss, self.goal,
                twin.actuator, views.ctrl,
            )  # fmt: skip
            return
        self._load[:, gears.dof] = views.bias[:, twin.dof]  # gears feel the output's load
        views.loss[:, twin.dof] = 0.0
        friction_loss(lanes, self._friction, gears.dof, views.motor, self._load, views.qvel, views.loss)
        if self._springs.size:
            gap = np.abs(views.qpos[:, gears.qpos] - views.qpos[:, twin.qpos])
            beyond = (gap > self._slack)[:, self._springy]
            views.damping[:, self._springs] = self._damping[:, None] * beyond
        self._head = (self._head + 1) % self._sent.shape[2]
        regulate(
            self.goal, self._sent, self._head, self._steps, self._part, self._slack, twin.qpos, gears.qpos,
            twin.actuator, views.qpos, views.ctrl,
        )  # fmt: skip


@njit(nogil=True, error_model="numpy")
def drive(
    lanes: NDArray[np.int64],
    coefficients: NDArray[np.float64],
    dofs: NDArray[np.int64],
    motor: NDArray[np.float64],
    bias: NDArray[np.float64],
    velocity: NDArray[np.float64],
    loss: NDArray[np.float64],
    goal: NDArray[np.float64],
    actuators: NDArray[np.int64],
    ctrl: NDArray[np.float64],
) -> None:
    """Write friction and controls of some lanes whose gears have neither play nor springs.

    Args:
        lanes: Which, of k.
        coefficients: This, and what follows up to `loss`, as `servo.friction_loss` takes it.
        dofs: See there.
        motor: See there.
        bias: See there.
        velocity: See there.
        loss: See there.
        goal: What each servo was told last, shape (k, n) [rad].
        actuators: Actuator of each joint, shape (n,).
        ctrl: Written to, shape (k, nu).
    """
    friction_loss(lanes, coefficients, dofs, motor, bias, velocity, loss)
    for index in range(lanes.shape[0]):
        for joint in range(actuators.shape[0]):
            ctrl[lanes[index], actuators[joint]] = goal[lanes[index], joint]


@njit(nogil=True, error_model="numpy")
def sag(
    resistance: NDArray[np.float64],
    full: NDArray[np.float64],
    least: float,
    torque_constant: NDArray[np.float64],
    dofs: NDArray[np.int64],
    actuators: NDArray[np.int64],
    motor: NDArray[np.float64],
    velocity: NDArray[np.float64],
    gainprm: NDArray[np.float64],
    voltage: NDArray[np.float64],
) -> None:
    """Let the supplies of many lamps sag under the currents that their servos draw, all of one lamp from one supply.

    A servo's driver is a switching converter: it draws duty times the winding's current, duty being the motor's voltage
    over the supply's. The supply gives V = V_full - R sum(duty |i|), from the currents of the last step.

    Args:
        resistance: R of each lamp's supply, shape (lanes,) [Ohm].
        full: V_full, shape (lanes,) [V].
        least: What a supply keeps [V].
        torque_constant: K, shape (lanes, n) [Nm/A].
        dofs: Degree of freedom that each motor turns, shape (n,).
        actuators: Actuator of each joint, shape (n,).
        motor: `qfrc_actuator`, shape (lanes, nv) [Nm].
        velocity: `qvel`, shape (lanes, nv) [rad/s].
        gainprm: `actuator_gainprm`, for `voltage`; written to, shape (lanes, nu, 10 or more).
        voltage: V, written to, shape (lanes,) [V].
    """
    for lane in range(resistance.shape[0]):
        if resistance[lane] == 0.0:
            continue
        drawn = 0.0
        for joint in range(dofs.shape[0]):
            gain = gainprm[lane, actuators[joint]]
            if gain[_R] > _OPEN:
                continue
            k, dof = torque_constant[lane, joint], dofs[joint]
            winding = motor[lane, dof] / k
            duty = abs(winding * gain[_R] + k * velocity[lane, dof]) / voltage[lane]
            drawn += min(duty, 1.0) * abs(winding)
        now = max(full[lane] - resistance[lane] * drawn, least)
        for joint in range(dofs.shape[0]):
            gain = gainprm[lane, actuators[joint]]
            gain[_KP] *= now / voltage[lane]
            gain[_VMAX] *= now / voltage[lane]
        voltage[lane] = now
