"""The firmware's control loops: from an error to a duty, once each control step.

Block diagrams and divisors: e-manual "Position PID Gain(80, 82, 84)", "Feedforward 1st/2nd Gains(88, 90)" and
"Velocity PI Gain(76, 78)". It does not print the sampling: I gains are taken per millisecond, D and feedforward gains
per change in a millisecond. That is an estimate; it gives the factory gains sensible times (XL430: Td 50 ms;
XL330-M077: Ti 0.5 s) and lets the feedforward gains' range reach what back-EMF and inertia ask for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from robolamp.dynamixel.registers import FULL_PWM, RAD_PER_COUNT, VELOCITY_UNIT

_SAMPLE = 0.001  # period that I and D gains refer to [s]; estimate


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of a loop, as PWM counts per unit of its error.

    Attributes:
        p: Per count of position, or per unit of velocity.
        i: The same, added each millisecond.
        d: Per change of the error in a millisecond.
        first: Per change of the desired position in a millisecond.
        second: Per change of that in a millisecond.
    """

    p: float
    i: float = 0.0
    d: float = 0.0
    first: float = 0.0
    second: float = 0.0

    @classmethod
    def position(cls, p: int, i: int, d: int, divisor: float, first: int = 0, second: int = 0) -> Gains:
        """Return the gains of the registers of position control.

        Args:
            p: Position P Gain(84).
            i: Position I Gain(82).
            d: Position D Gain(80).
            divisor: Of the P gain.
            first: Feedforward 1st Gain(90): velocity.
            second: Feedforward 2nd Gain(88): acceleration.
        """
        return cls(p / divisor, i / 65_536, d / 16, first / 4, second / 4)

    @classmethod
    def velocity(cls, p: int, i: int) -> Gains:
        """Return the gains of Velocity P and I Gain registers."""
        return cls(p / 128, i / 65_536)


class Loop:
    """A PID loop whose integral waits while the output is at its limit."""

    def __init__(self) -> None:
        self._integral = 0.0

    def reset(self) -> None:
        """Forget the integral."""
        self._integral = 0.0

    def position(
        self,
        error: float,
        rate: float,
        gains: Gains,
        limit: float,
        dt: float,
        desired: tuple[float, float] = (0.0, 0.0),
    ) -> float:
        """Return the duty for a position error.

        Args:
            error: Desired minus present position [rad].
            rate: Desired minus present velocity [rad/s].
            gains: The gains.
            limit: Largest duty.
            dt: Control step [s].
            desired: Velocity [rad/s] and acceleration [rad/s^2] of the trajectory.
        """
        velocity, acceleration = desired
        ahead = gains.first * velocity * _SAMPLE + gains.second * acceleration * _SAMPLE**2
        return self._duty(error / RAD_PER_COUNT, rate / RAD_PER_COUNT, gains, limit, dt, ahead / RAD_PER_COUNT)

    def velocity(self, error: float, gains: Gains, limit: float, dt: float) -> float:
        """Return the duty for a velocity error [rad/s]; the rest as for `position`."""
        return self._duty(error / VELOCITY_UNIT, 0.0, gains, limit, dt)

    def _duty(self, error: float, rate: float, gains: Gains, limit: float, dt: float, ahead: float = 0.0) -> float:
        added = gains.i * error * dt / _SAMPLE
        pwm = gains.p * error + gains.d * rate * _SAMPLE + self._integral + added + ahead
        most = limit * FULL_PWM
        if abs(pwm) <= most or pwm * error < 0:
            self._integral += added
        self._integral = max(-most, min(most, self._integral)) if gains.i else 0.0
        return max(-limit, min(limit, pwm / FULL_PWM))


def duty_for_current(current: float, speed: float, voltage: float, torque_constant: float, resistance: float) -> float:
    """Return the duty at which a servo draws a supply current.

    The driver is a switching converter: supply current = |duty| x winding current, and
    duty x voltage = resistance x winding current + torque_constant x speed.

    Args:
        current: Supply current, positive where the motor pushes towards larger angles [A]; 0: the winding's is 0.
        speed: Of the output [rad/s].
        voltage: Supply [V].
        torque_constant: At the output [Nm/A].
        resistance: Of the winding [Ohm].
    """
    emf = math.copysign(1.0, current) * torque_constant * speed
    if current == 0.0:
        return torque_constant * speed / voltage
    duty = (emf + math.sqrt(emf * emf + 4 * voltage * resistance * abs(current))) / (2 * voltage)
    return math.copysign(duty, current)
