"""A Dynamixel in position mode, as MuJoCo's dcmotor plus friction that MuJoCo does not have.

The firmware works in voltage: V = clip(kv (goal - angle), -Vin, Vin) with kv = Kp 4096 / (2 pi) / (divisor 885) Vin,
and the motor gives tau = K (V - K w) / R. MuJoCo's dcmotor commands torque and compensates back-EMF, so K^2/R goes
back in as its damping gain (MuJoCo 4 documentation, XMLreference "dcmotor/controller"). Friction in the gear train
grows with the load it carries (Duclusaud et al. 2024, "Extended friction models for the physics simulation of servo
actuators", models M4 and M5): it is rewritten into `dof_frictionloss` before every step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from robolamp.calibration import SERVO, Calibration
from robolamp.lamp import Lamp

_COUNTS_PER_RADIAN = 4096 / (2 * math.pi)  # e-manual XL330-M288-T, "Present Position": 4096 a turn
_PWM_COUNTS = 885  # e-manual, "PWM Limit": 885 counts are 100 %
_OFF_RESISTANCE = 1e9  # an open circuit: no torque and, unlike 0 V, no braking [Ohm]
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

    @classmethod
    def of(cls, lamp: Lamp, calibration: Calibration) -> ServoParameters:
        """Return the calibrated parameters of a lamp's servos.

        Raises:
            FileError: The calibration lacks a parameter.
        """
        joints = [calibration.servo(joint.servo, joint.name) for joint in lamp.joints]
        return cls(**{name: np.array([values[name] for values in joints]) for name in SERVO})

    def friction(self) -> NDArray[np.float64]:
        """Return the coefficients that `friction_loss` takes, shape (n, 6)."""
        return np.stack(
            [
                self.coulomb,
                self.stribeck,
                1.0 / self.stribeck_velocity,
                self.load_motor,
                self.load_external,
                self.load_external_stribeck,
            ],
            axis=1,
        )

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
) -> None:
    """Change compiled motors while a simulation runs: registers that were written, a supply that sags.

    Args:
        gainprm: The joints' rows of `actuator_gainprm`, shape (n, 10); written to.
        parameters: The servos.
        p_gain: Position P Gain registers (84), shape (n,).
        voltage: Voltage that full duty gives, shape (n,) [V].
        torque: Torque Enable, shape (n,).
    """
    k = parameters.torque_constant
    r = np.where(torque, parameters.resistance, _OFF_RESISTANCE)
    gainprm[:, _R] = r
    gainprm[:, _KP] = parameters.voltage_gain(p_gain, voltage) * k / r
    gainprm[:, _KD] = k * k / r
    gainprm[:, _VMAX] = voltage


@njit(cache=True, nogil=True, error_model="numpy")
def friction_loss(
    coefficients: NDArray[np.float64],
    dofs: NDArray[np.int64],
    motor: NDArray[np.float64],
    bias: NDArray[np.float64],
    velocity: NDArray[np.float64],
    loss: NDArray[np.float64],
) -> None:
    """Write each joint's friction under its present load, for many lanes.

    loss = coulomb + |load_external tau_e - load_motor tau_m|
           + exp(-|w| / w_s) (stribeck + load_external_stribeck |tau_e|)
    with the motor's torque tau_m and the torque from outside (gravity, inertia) tau_e.

    Args:
        coefficients: `ServoParameters.friction` of each lane, shape (lanes, n, 6).
        dofs: Degree of freedom of each joint, shape (n,).
        motor: `qfrc_actuator`, shape (lanes, nv) [Nm].
        bias: `qfrc_bias`, shape (lanes, nv) [Nm].
        velocity: `qvel`, shape (lanes, nv) [rad/s].
        loss: `dof_frictionloss`, written to, shape (lanes, nv) [Nm].
    """
    for lane in range(coefficients.shape[0]):
        for joint in range(dofs.shape[0]):
            c = coefficients[lane, joint]
            dof = dofs[joint]
            external = -bias[lane, dof]
            still = np.exp(-abs(velocity[lane, dof]) * c[2])
            load = abs(c[4] * external - c[3] * motor[lane, dof])
            loss[lane, dof] = c[0] + load + still * (c[1] + c[5] * abs(external))
