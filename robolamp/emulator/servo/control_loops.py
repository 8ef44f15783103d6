"""A servo's control loops in its operating modes: what duty its registers, sensors and trajectory ask for.

Modes as on the e-manual's "Operating Mode(11)". PWM Slope(62) keeps the duty from jumping.
"""

from __future__ import annotations

from dataclasses import dataclass

from robolamp.dynamixel.registers import CURRENT_UNIT, FULL_PWM, Name, OperatingMode
from robolamp.emulator.servo.bare_motor import Datasheet
from robolamp.emulator.servo.control_table import ControlTable
from robolamp.emulator.servo.drive import Sensed
from robolamp.emulator.servo.regulators import Gains, Loop, duty_for_current

PWM_SLOPE_UNIT = 1.977
"""Of PWM Slope(62) [V/s] (e-manual)."""

_BEYOND_P = (
    Name.POSITION_I_GAIN,
    Name.POSITION_D_GAIN,
    Name.FEEDFORWARD_2ND_GAIN,
    Name.FEEDFORWARD_1ST_GAIN,
)


@dataclass(frozen=True, slots=True)
class Course:
    """Where a servo is and where it is to be, in its own sense of rotation.

    Attributes:
        position: Present, many turns [rad].
        speed: Present [rad/s].
        wanted: Desired position [rad]; in velocity control, desired velocity [rad/s].
        velocity: Of the trajectory [rad/s].
        acceleration: Of the trajectory [rad/s^2].
        stopped: Whether the Bus Watchdog has stopped it.
    """

    position: float
    speed: float
    wanted: float
    velocity: float
    acceleration: float
    stopped: bool


class Control:
    """Regulates one servo.

    Args:
        table: Its registers.
        sheet: Its motor, as the current control knows it.
    """

    def __init__(self, table: ControlTable, sheet: Datasheet) -> None:
        self._table, self._sheet = table, sheet
        self._loop = Loop()

    @property
    def beyond_plain(self) -> bool:
        """Whether position control is more than the plant's actuator can do.

        So it is with a D, I or feedforward gain, and with a PWM Slope(62) that is not the factory's: that one's effect
        is part of the plant's calibrated delay.
        """
        table = self._table
        sloped = Name.PWM_SLOPE in table and table.get(Name.PWM_SLOPE) != table.initial(Name.PWM_SLOPE)
        return sloped or any(table.get(gain) for gain in _BEYOND_P)

    def limit(self, mode: OperatingMode) -> float:
        """Return the largest duty that PWM Limit(36) and Goal PWM(100) allow, 0 to 1."""
        limit = self._table.get(Name.PWM_LIMIT)
        if mode is not OperatingMode.PWM:
            limit = min(limit, abs(self._table.get(Name.GOAL_PWM)))
        return limit / FULL_PWM

    def reset(self) -> None:
        """Forget the integral."""
        self._loop.reset()

    def duty(self, mode: OperatingMode, course: Course, seen: Sensed, before: float, dt: float) -> float:
        """Return the duty that the loops ask for, as far as PWM Slope(62) lets it come by now.

        Args:
            mode: Operating Mode(11).
            course: Where it is and is to be.
            seen: What the sensors measure.
            before: The duty until now, in the servo's own sense of rotation, as the result is.
            dt: Control step [s].
        """
        limit = self.limit(mode)
        asked = max(-limit, min(limit, self._asked(mode, course, seen, limit, dt)))
        if Name.PWM_SLOPE not in self._table:
            return asked
        change = self._table.get(Name.PWM_SLOPE) * PWM_SLOPE_UNIT * dt / seen.voltage
        return max(before - change, min(before + change, asked))

    def _asked(self, mode: OperatingMode, course: Course, seen: Sensed, limit: float, dt: float) -> float:
        table = self._table
        if mode is OperatingMode.VELOCITY:
            gains = Gains.velocity(table.get(Name.VELOCITY_P_GAIN), table.get(Name.VELOCITY_I_GAIN))
            return self._loop.velocity(course.wanted - course.speed, gains, limit, dt)
        if mode is OperatingMode.PWM:
            return 0.0 if course.stopped else table.get(Name.GOAL_PWM) / FULL_PWM
        if mode is OperatingMode.CURRENT:
            if course.stopped:
                return 0.0
            return self._duty_at(self._current(table.get(Name.GOAL_CURRENT)), course, seen)
        if mode is not OperatingMode.CURRENT_BASED_POSITION:
            return self._to_position(course, limit, dt)
        most = abs(self._current(table.get(Name.GOAL_CURRENT)))
        if most == 0.0:
            return self._duty_at(0.0, course, seen)
        duty = self._to_position(course, limit, dt)
        return max(self._duty_at(-most, course, seen), min(self._duty_at(most, course, seen), duty))

    def _to_position(self, course: Course, limit: float, dt: float) -> float:
        table = self._table
        gains = Gains.position(
            p=table.get(Name.POSITION_P_GAIN),
            i=table.get(Name.POSITION_I_GAIN),
            d=table.get(Name.POSITION_D_GAIN),
            divisor=self._sheet.p_divisor,
            first=table.get(Name.FEEDFORWARD_1ST_GAIN),
            second=table.get(Name.FEEDFORWARD_2ND_GAIN),
        )
        return self._loop.position(
            course.wanted - course.position,
            course.velocity - course.speed,
            gains,
            limit,
            dt,
            (course.velocity, course.acceleration),
        )

    def _current(self, goal: int) -> float:
        most = self._table.get(Name.CURRENT_LIMIT)
        return max(-most, min(most, goal)) * CURRENT_UNIT

    def _duty_at(self, current: float, course: Course, seen: Sensed) -> float:
        return duty_for_current(
            current, course.speed, seen.voltage, self._sheet.torque_constant, self._sheet.resistance
        )
