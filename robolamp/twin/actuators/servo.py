"""A Dynamixel in position mode, as MuJoCo's dcmotor plus what MuJoCo does not have: each law of the servo, once.

The firmware works in voltage: V = clip(kv (goal - angle), -Vin, Vin) with kv = Kp 4096 / (2 pi) / (divisor 885) Vin,
and the motor gives tau = K (V - K w) / R. MuJoCo's dcmotor commands torque and compensates back-EMF, so K^2/R goes
back in as its damping gain (MuJoCo 4 documentation, XMLreference "dcmotor/controller"). Friction in the gear train
grows with the load it carries (Duclusaud et al. 2024, "Extended friction models for the physics simulation of servo
actuators", models M4 and M5). What weakens the motor (heat, magnetic saturation, a supply that sags) is an effective
resistance. `robolamp.twin.actuators.motors` writes these laws into MuJoCo before every step.

The functions take one servo's row of `ServoParameters.table`, or any longer row that begins so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.calibration import SERVO, Calibration
from robolamp.dynamixel.registers import COUNTS_PER_TURN, FULL_PWM
from robolamp.jit import njit
from robolamp.lamp import Lamp

OPEN = 1e9
"""Resistance of a winding without torque: no torque and, unlike 0 V, no braking [Ohm]."""

REFERENCE_TEMPERATURE = 30.0
"""At which resistance and viscous friction are as calibrated [degC]."""

FIRM = 0.999
"""MuJoCo's d of a joint's friction: with its 0.9 an arm that friction holds creeps by degrees in seconds."""

QUICK = 0.004
"""Time constant of a joint's friction [s]: twice the step that lamps are scored in. With MuJoCo's 0.02 a hop of 60 cm
lands 1.2 % elsewhere in steps of 2 ms than of 1 ms."""

_COUNTS_PER_RADIAN = COUNTS_PER_TURN / (2 * math.pi)
_LEAST_GROWTH = 0.1  # of the resistance: a law that is linear in the temperature holds only so far
_POSITION_INPUT = int(mujoco.mjtCtrlInput.mjINPUT_POS)  # the control is a goal position

# Columns of `ServoParameters.table`, as `SERVO` has them.
(
    TORQUE_CONSTANT, _RESISTANCE, _ARMATURE, _VISCOUS, _COULOMB, _STRIBECK, _STRIBECK_VELOCITY, _LOAD_MOTOR,
    _LOAD_EXTERNAL, _LOAD_EXTERNAL_STRIBECK, _GAIN_DIVISOR, _, _STRIBECK_EXPONENT, _LOAD_MOTOR_STRIBECK, _ASYMMETRY,
    _SATURATION, _SUPPLY_RESISTANCE, _RESISTANCE_TEMPERATURE, _VISCOUS_TEMPERATURE,
) = range(len(SERVO))  # fmt: skip

_R, _K, _KP, _KD, _VMAX = 0, 1, 4, 6, 7  # columns of `actuator_gainprm` that set_to_dcmotor compiles to


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

    @classmethod
    def single(cls, values: Mapping[str, float]) -> ServoParameters:
        """Return the parameters of one servo alone.

        Args:
            values: Parameters by name; others than a servo's are left out.
        """
        return cls(**{name: np.array([values[name]]) for name in SERVO})

    @property
    def table(self) -> NDArray[np.float64]:
        """The same as rows for the functions below: a servo each, a parameter a column, shape (n, len(SERVO))."""
        return np.stack([getattr(self, name) for name in SERVO], axis=1)

    @property
    def weakens(self) -> bool:
        """Whether the effective resistance ever is another than `resistance`."""
        return any(values.any() for values in (self.saturation, self.supply_resistance, self.resistance_temperature))


@njit(nogil=True, error_model="numpy")
def voltage_gain(servo: NDArray[np.float64], p_gain: float, voltage: float) -> float:
    """Return kv, the motor's voltage per error [V/rad].

    Args:
        servo: Its parameters.
        p_gain: Position P Gain register (84).
        voltage: Supply voltage [V].
    """
    return p_gain * _COUNTS_PER_RADIAN / (servo[_GAIN_DIVISOR] * FULL_PWM) * voltage


@njit(nogil=True, error_model="numpy")
def effective_resistance(
    servo: NDArray[np.float64], temperature: float, drop: float, speed: float, voltage: float
) -> float:
    """Return the winding's resistance by which a motor is as weak as heat, saturation and its supply make it [Ohm].

    A winding current u = (V - K w) / R that saturates the iron gives the torque K u / (1 + s |u|), and a supply of
    resistance R_s that carries duty times the winding's current gives the motor duty (V_in - R_s duty i). Both are what
    a resistance R (1 + s |u|) + R_s duty^2 gives.

    Args:
        servo: Its parameters.
        temperature: Of the servo [degC].
        drop: Voltage over the winding's resistance in the last step [V].
        speed: Of the joint [rad/s].
        voltage: Supply voltage [V].
    """
    growth = 1.0 + servo[_RESISTANCE_TEMPERATURE] * (temperature - REFERENCE_TEMPERATURE)
    resistance = servo[_RESISTANCE] * max(growth, _LEAST_GROWTH)
    if servo[_SATURATION] == 0.0 and servo[_SUPPLY_RESISTANCE] == 0.0:
        return resistance
    duty = (drop + servo[TORQUE_CONSTANT] * speed) / voltage
    saturated = resistance * (1.0 + servo[_SATURATION] * abs(drop / resistance))
    return saturated + servo[_SUPPLY_RESISTANCE] * min(duty * duty, 1.0)


@njit(nogil=True, error_model="numpy")
def motor_torque(
    servo: NDArray[np.float64], resistance: float, gain: float, error: float, speed: float, voltage: float
) -> float:
    """Return what a motor gives, as MuJoCo's dcmotor does [Nm].

    Args:
        servo: Its parameters.
        resistance: `effective_resistance` [Ohm].
        gain: `voltage_gain` [V/rad].
        error: Goal minus angle [rad].
        speed: Of the joint [rad/s].
        voltage: Supply voltage [V].
    """
    k = servo[TORQUE_CONSTANT]
    return k * (min(max(gain * error, -voltage), voltage) - k * speed) / resistance


@njit(nogil=True, error_model="numpy")
def motor_duty(servo: NDArray[np.float64], resistance: float, torque: float, speed: float, voltage: float) -> float:
    """Return a motor's voltage by its supply's, -1 to 1.

    Args:
        servo: Its parameters.
        resistance: `effective_resistance` [Ohm].
        torque: Of the motor [Nm].
        speed: Of the joint [rad/s].
        voltage: Supply voltage [V].
    """
    k = servo[TORQUE_CONSTANT]
    return min(max((torque / k * resistance + k * speed) / voltage, -1.0), 1.0)


@njit(nogil=True, error_model="numpy")
def viscous_friction(servo: NDArray[np.float64], temperature: float) -> float:
    """Return a servo's viscous friction at a temperature [degC], in Nm s/rad."""
    growth = servo[_VISCOUS_TEMPERATURE]
    if growth == 0.0:
        return servo[_VISCOUS]
    return servo[_VISCOUS] * math.exp(growth * (temperature - REFERENCE_TEMPERATURE))


@njit(nogil=True, error_model="numpy")
def friction_loss(servo: NDArray[np.float64], motor: float, external: float, speed: float) -> float:
    """Return the most friction that a joint meets under its load, viscous friction aside [Nm].

    loss = coulomb + |load_external tau_e - load_motor tau_m|
           + exp(-(|w| / w_s)^n) (stribeck + load_external_stribeck |tau_e| + load_motor_stribeck |tau_m|)
    with the motor's torque tau_m and the torque from outside (gravity, inertia) tau_e; times 1 + asymmetry towards
    larger angles, 1 - asymmetry towards smaller ones.

    Args:
        servo: Its parameters.
        motor: tau_m [Nm].
        external: tau_e [Nm].
        speed: w [rad/s].
    """
    relative, exponent = abs(speed) * (1.0 / servo[_STRIBECK_VELOCITY]), servo[_STRIBECK_EXPONENT]
    still = math.exp(-relative if exponent == 1.0 else -(relative**exponent))
    load = abs(servo[_LOAD_EXTERNAL] * external - servo[_LOAD_MOTOR] * motor)
    sticking = servo[_STRIBECK] + servo[_LOAD_EXTERNAL_STRIBECK] * abs(external)
    loss = servo[_COULOMB] + load + still * (sticking + servo[_LOAD_MOTOR_STRIBECK] * abs(motor))
    if servo[_ASYMMETRY] != 0.0:
        heading = speed if speed != 0.0 else external + motor
        loss *= 1.0 + servo[_ASYMMETRY] * np.sign(heading)
    return loss


@njit(nogil=True, error_model="numpy")
def write_motor(
    row: NDArray[np.float64],
    servo: NDArray[np.float64],
    resistance: float,
    gain: float,
    limit: float,
) -> None:
    """Write a motor into MuJoCo's dcmotor.

    Args:
        row: The actuator's `actuator_gainprm`, shape (10,) or longer; written to.
        servo: The servo's parameters.
        resistance: `effective_resistance`, or `OPEN` [Ohm].
        gain: `voltage_gain` [V/rad].
        limit: Most voltage that the motor gets [V].
    """
    k = servo[TORQUE_CONSTANT]
    row[_R], row[_K], row[_VMAX] = resistance, k, limit
    row[_KP] = row[_KD] = 0.0
    if resistance != OPEN:
        row[_KP], row[_KD] = gain * k / resistance, k * k / resistance


def hold(joint: mujoco.MjsJoint) -> None:
    """Write how hard friction holds a servo's joint into a model specification; how much there is, each step says.

    Args:
        joint: The joint.
    """
    joint.solref_friction, joint.solimp_friction = [QUICK, 1.0], [FIRM, FIRM, 0.001, 0.5, 2.0]


def set_motor(
    actuator: mujoco.MjsActuator, servo: NDArray[np.float64], p_gain: float, voltage: float, *, torque: bool = True
) -> None:
    """Write one servo's motor and controller into a model specification; motors.py keeps its delay.

    Args:
        actuator: The joint's actuator.
        servo: The servo's parameters.
        p_gain: Position P Gain register (84).
        voltage: Supply voltage [V].
        torque: Whether Torque Enable is 1; else the winding is open.
    """
    row, resistance = np.zeros(_VMAX + 1), servo[_RESISTANCE] if torque else OPEN
    write_motor(row, servo, resistance, voltage_gain(servo, p_gain, voltage), voltage)
    actuator.set_to_dcmotor(
        motorconst=[row[_K], row[_K]],
        resistance=row[_R],
        controller=[row[_KP], 0.0, row[_KD], 0.0, 0.0, row[_VMAX]],
        ctrlspec=_POSITION_INPUT,
    )
    actuator.damping[0] = servo[_VISCOUS]
    actuator.armature = servo[_ARMATURE]
    actuator.delay, actuator.nsample = 0.0, 0
