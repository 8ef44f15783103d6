"""A Dynamixel in position mode, as MuJoCo's dcmotor plus friction that MuJoCo does not have.

The firmware works in voltage: V = clip(kv (goal - angle), -Vin, Vin) with kv = Kp 4096 / (2 pi) / (divisor 885) Vin,
and the motor gives tau = K (V - K w) / R. MuJoCo's dcmotor commands torque and compensates back-EMF, so K^2/R goes
back in as its damping gain (MuJoCo 4 documentation, XMLreference "dcmotor/controller"). Friction in the gear train
grows with the load it carries (Duclusaud et al. 2024, "Extended friction models for the physics simulation of servo
actuators", models M4 and M5): it is rewritten into `dof_frictionloss` before every step. What weakens the motor
(magnetic saturation, a supply that sags) is rewritten as an effective resistance, where a calibration has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.calibration import SERVO, Calibration
from robolamp.jit import njit
from robolamp.lamp import Lamp

_COUNTS_PER_RADIAN = 4096 / (2 * math.pi)  # e-manual XL330-M288-T, "Present Position": 4096 a turn
_PWM_COUNTS = 885  # e-manual, "PWM Limit": 885 counts are 100 %
_OPEN = 1e8  # no winding has as much [Ohm]
_OFF_RESISTANCE = 1e9  # an open circuit: no torque and, unlike 0 V, no braking [Ohm]
REFERENCE_TEMPERATURE = 30.0
"""At which resistance and viscous friction are as calibrated [degC]."""
_POSITION_INPUT = int(mujoco.mjtCtrlInput.mjINPUT_POS)  # the control is a goal position


@dataclass(frozen=True)
class ServoParameters:
    """The servos of one lamp; every array has shape (n,) over its joints.

    Attributes:
        torque_constant: K, at the output [Nm/A].
        resistance: R [Ohm].
        armature: Rotor inertia at the output [kg m^2].
        viscous: [Nm s/rad].
        coulomb: [Nm].
        stribeck: [Nm].
        stribeck_velocity: [rad/s].
        load_motor: Friction per motor torque.
        load_external: Friction per torque from outside.
        load_external_stribeck: The same at standstill, in addition.
        gain_divisor: Counts of Position P Gain per unit of gain.
        delay: [s].
        stribeck_exponent: Of the fall of friction with speed.
        load_motor_stribeck: Friction per motor torque at standstill, in addition.
        asymmetry: Friction towards larger angles, above its mean.
        saturation: Loss of torque per winding current [1/A].
        supply_resistance: Of the supply and its leads [Ohm].
        resistance_temperature: Growth of the resistance per degree above `REFERENCE_TEMPERATURE` [1/K].
        viscous_temperature: Logarithmic growth of viscous friction per degree above it [1/K].
    """

    torque_constant: NDArray[np.float64]
    resistance: NDArray[np.float64]
    armature: NDArray[np.float64]
    viscous: NDArray[np.float64]
    coulomb: NDArray[np.float64]
    stribeck: NDArray[np.float64]
    stribeck_velocity: NDArray[np.float64]
    load_motor: NDArray[np.float64]
    load_external: NDArray[np.float64]
    load_external_stribeck: NDArray[np.float64]
    gain_divisor: NDArray[np.float64]
    delay: NDArray[np.float64]
    stribeck_exponent: NDArray[np.float64]
    load_motor_stribeck: NDArray[np.float64]
    asymmetry: NDArray[np.float64]
    saturation: NDArray[np.float64]
    supply_resistance: NDArray[np.float64]
    resistance_temperature: NDArray[np.float64]
    viscous_temperature: NDArray[np.float64]

    @classmethod
    def of(cls, lamp: Lamp, calibration: Calibration) -> ServoParameters:
        """Return the calibrated parameters of a lamp's servos.

        Raises:
            FileError: The calibration lacks a parameter.
        """
        joints = [calibration.servo(joint.servo, joint.name) for joint in lamp.joints]
        return cls(**{name: np.array([values[name] for values in joints]) for name in SERVO})

    def friction(self) -> NDArray[np.float64]:
        """Return the coefficients that `friction_loss` takes, shape (n, 9)."""
        return np.stack(
            [
                self.coulomb,
                self.stribeck,
                1.0 / self.stribeck_velocity,
                self.load_motor,
                self.load_external,
                self.load_external_stribeck,
                self.load_motor_stribeck,
                self.stribeck_exponent,
                self.asymmetry,
            ],
            axis=1,
        )

    @property
    def weakens(self) -> bool:
        """Whether `weaken` has anything to do."""
        return bool((self.saturation > 0).any() or (self.supply_resistance > 0).any())

    def weakness(self) -> NDArray[np.float64]:
        """Return the coefficients that `weaken` takes, shape (n, 5)."""
        r = self.resistance
        return np.stack([self.torque_constant, r, self.saturation, self.supply_resistance, r], axis=1)

    def voltage_gain(self, p_gain: NDArray[np.float64], voltage: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return kv, the voltage per error, shape (n,) [V/rad].

        Args:
            p_gain: Position P Gain registers (84), shape (n,).
            voltage: Supply voltage, shape (n,) or a scalar [V].
        """
        return p_gain * _COUNTS_PER_RADIAN / (self.gain_divisor * _PWM_COUNTS) * voltage


def set_motor(
    actuator: mujoco.MjsActuator,
    parameters: ServoParameters,
    joint: int,
    p_gain: float,
    voltage: float,
    samples: int,
    *,
    torque: bool = True,
) -> None:
    """Write one servo's motor, controller and delay into a model specification.

    Args:
        actuator: The joint's actuator.
        parameters: The servos.
        joint: Which of them.
        p_gain: Position P Gain register (84).
        voltage: Supply voltage [V].
        samples: Length of the goal's history in physics steps; must hold the longest delay.
        torque: False: Torque Enable is 0, the winding is open.
    """
    k = parameters.torque_constant[joint]
    r = parameters.resistance[joint] if torque else _OFF_RESISTANCE
    kv = parameters.voltage_gain(np.full(len(parameters.resistance), p_gain), voltage)[joint]
    actuator.set_to_dcmotor(
        motorconst=[k, k],
        resistance=r,
        controller=[kv * k / r, 0.0, k * k / r, 0.0, 0.0, voltage],
        ctrlspec=_POSITION_INPUT,
    )
    actuator.damping[0] = parameters.viscous[joint]
    actuator.armature = parameters.armature[joint]
    actuator.delay = parameters.delay[joint]
    actuator.nsample = samples


# Columns of `actuator_gainprm` that set_to_dcmotor compiles to.
_R, _KP, _KD, _VMAX = 0, 4, 6, 7


def write_motors(
    gainprm: NDArray[np.float64],
    parameters: ServoParameters,
    p_gain: NDArray[np.float64],
    voltage: NDArray[np.float64],
    torque: NDArray[np.bool_],
    duty: float = 1.0,
) -> None:
    """Change compiled motors while a simulation runs: registers that were written, a supply that sags.

    Args:
        gainprm: The joints' rows of `actuator_gainprm`, shape (n, 10); written to.
        parameters: The servos.
        p_gain: Position P Gain registers (84), shape (n,).
        voltage: Voltage that full duty gives, shape (n,) [V].
        torque: Torque Enable, shape (n,).
        duty: Goal PWM(100), 0 to 1: the most of the supply that a motor gets.
    """
    k = parameters.torque_constant
    r = np.where(torque, parameters.resistance, _OFF_RESISTANCE)
    gainprm[:, _R] = r
    gainprm[:, _KP] = parameters.voltage_gain(p_gain, voltage) * k / r
    gainprm[:, _KD] = k * k / r
    gainprm[:, _VMAX] = voltage * duty


@njit(nogil=True, error_model="numpy")
def friction_loss(
    lanes: NDArray[np.int64],
    coefficients: NDArray[np.float64],
    dofs: NDArray[np.int64],
    motor: NDArray[np.float64],
    bias: NDArray[np.float64],
    velocity: NDArray[np.float64],
    loss: NDArray[np.float64],
) -> None:
    """Write each joint's friction under its present load, for some of k lanes.

    loss = coulomb + |load_external tau_e - load_motor tau_m|
           + exp(-(|w| / w_s)^n) (stribeck + load_external_stribeck |tau_e| + load_motor_stribeck |tau_m|)
    with the motor's torque tau_m and the torque from outside (gravity, inertia) tau_e; times 1 + asymmetry towards
    larger angles, 1 - asymmetry towards smaller ones.

    Args:
        lanes: Which.
        coefficients: `ServoParameters.friction` of each lane, shape (k, n, 9).
        dofs: Degree of freedom of each joint, shape (n,).
        motor: `qfrc_actuator`, shape (k, nv) [Nm].
        bias: `qfrc_bias`, shape (k, nv) [Nm].
        velocity: `qvel`, shape (k, nv) [rad/s].
        loss: `dof_frictionloss`, written to, shape (k, nv) [Nm].
    """
    for index in range(lanes.shape[0]):
        lane = lanes[index]
        for joint in range(dofs.shape[0]):
            c = coefficients[lane, joint]
            dof = dofs[joint]
            external, driving = -bias[lane, dof], motor[lane, dof]
            speed = abs(velocity[lane, dof]) * c[2]
            still = np.exp(-speed if c[7] == 1.0 else -(speed ** c[7]))
            load = abs(c[4] * external - c[3] * driving)
            friction = c[0] + load + still * (c[1] + c[5] * abs(external) + c[6] * abs(driving))
            if c[8] != 0.0:
                heading = velocity[lane, dof] if velocity[lane, dof] != 0.0 else external + driving
                friction *= 1.0 + c[8] * np.sign(heading)
            loss[lane, dof] = friction


@njit(nogil=True, error_model="numpy")
def weaken(
    coefficients: NDArray[np.float64],
    dofs: NDArray[np.int64],
    actuators: NDArray[np.int64],
    motor: NDArray[np.float64],
    velocity: NDArray[np.float64],
    gainprm: NDArray[np.float64],
) -> None:
    """Write each motor's effective resistance under its present current, for many lanes.

    A winding current u = (V - K w) / R that saturates the iron gives the torque K u / (1 + s |u|), and a supply of
    resistance R_s that carries duty times the winding's current gives the motor duty (V_in - R_s duty i). Both are what
    a resistance R (1 + s |u|) + R_s duty^2 gives.

    Args:
        coefficients: `ServoParameters.weakness` of each lane, shape (lanes, n, 5); the last is the effective resistance
            of the last step, written to.
        dofs: Degree of freedom of each joint, shape (n,).
        actuators: Actuator of each joint, shape (n,).
        motor: `qfrc_actuator`, shape (lanes, nv) [Nm].
        velocity: `qvel`, shape (lanes, nv) [rad/s].
        gainprm: `actuator_gainprm`, written to, shape (lanes, nu, 10 or more).
    """
    for lane in range(coefficients.shape[0]):
        for joint in range(dofs.shape[0]):
            k, r, saturation, supply, before = coefficients[lane, joint]
            gain, dof = gainprm[lane, actuators[joint]], dofs[joint]
            if gain[_R] > _OPEN or (saturation == 0.0 and supply == 0.0):
                continue
            drop = motor[lane, dof] / k * before
            duty = (drop + k * velocity[lane, dof]) / gain[_VMAX]
            effective = r * (1.0 + saturation * abs(drop / r)) + supply * min(duty * duty, 1.0)
            gain[_KP] *= gain[_R] / effective
            gain[_KD] *= gain[_R] / effective
            gain[_R] = coefficients[lane, joint, 4] = effective
