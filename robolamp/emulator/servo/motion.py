"""How a servo moves: operating mode, profile and control loops, from its registers to its motor.

Modes as on the e-manual's "Operating Mode(11)". Plain position control (no D, I and feedforward gain, PWM Slope as
delivered) may be left to the plant, whose actuator is that; everything else is regulated here, once each control step,
to a duty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from robolamp.dynamixel.registers import (
    ACCELERATION_UNIT,
    COUNTS_PER_TURN,
    CURRENT_UNIT,
    FULL_PWM,
    RAD_PER_COUNT,
    VELOCITY_UNIT,
    Name,
    OperatingMode,
)
from robolamp.emulator.servo.bare_motor import Datasheet
from robolamp.emulator.servo.control_loops import Control, Course
from robolamp.emulator.servo.control_table import ControlTable
from robolamp.emulator.servo.drive import Drive, Sensed
from robolamp.emulator.servo.profile import Profile

IN_POSITION = 20
"""Distance from the goal at which Moving Status(123) says "arrived" [counts]. Estimate: the e-manual gives none."""

FOLLOWING = 200
"""Distance from the trajectory at which Moving Status(123) says "not following" [counts]. Estimate, as above."""

REVERSE, TIME_BASED, TORQUE_BY_GOAL = 0x01, 0x04, 0x08
"""Bits of Drive Mode(10)."""

_TURN = 2 * math.pi
_HOMING_IN_MODE_3 = 1024  # e-manual "Homing Offset(20)": outside +-1,024 it is ignored in position mode
_SPEED_LAG = 0.01  # of the velocity that the loops see [s]; estimate
_LONGEST_STEP = 0.02  # a control step after a pause counts as no more [s]
_POSITION_MODES = (
    OperatingMode.POSITION,
    OperatingMode.EXTENDED_POSITION,
    OperatingMode.CURRENT_BASED_POSITION,
)
_GOAL_OF_MODE = {
    OperatingMode.CURRENT: Name.GOAL_CURRENT,
    OperatingMode.VELOCITY: Name.GOAL_VELOCITY,
    OperatingMode.PWM: Name.GOAL_PWM,
}
_LIMITED = (
    (Name.GOAL_PWM, Name.PWM_LIMIT),
    (Name.GOAL_CURRENT, Name.CURRENT_LIMIT),
    (Name.GOAL_VELOCITY, Name.VELOCITY_LIMIT),
)
_GAINS = (
    Name.VELOCITY_I_GAIN,
    Name.VELOCITY_P_GAIN,
    Name.POSITION_D_GAIN,
    Name.POSITION_I_GAIN,
    Name.POSITION_P_GAIN,
    Name.FEEDFORWARD_2ND_GAIN,
    Name.FEEDFORWARD_1ST_GAIN,
)


class Motion:
    """A servo's motion.

    Args:
        table: Its registers.
        sheet: Its motor, as the current control knows it.
        own_loop: Regulate plain position control here too.
        seen: What its sensors measure at power-on.

    Attributes:
        drive: What it does to its motor now; the same object for as long as nothing changes.
        position: Of the shaft in the servo's own sense of rotation, many turns, without the homing offset [rad].
    """

    def __init__(self, table: ControlTable, sheet: Datasheet, own_loop: bool, seen: Sensed) -> None:
        self._table, self._own_loop = table, own_loop
        self._profile, self._control = Profile(), Control(table, sheet)
        self._regulating = True  # here, not by the plant; `update` knows
        self.drive = Drive(False, 0.0, 0, 0.0)
        self.power_on(seen)

    @property
    def mode(self) -> OperatingMode:
        """Operating Mode(11)."""
        return OperatingMode(self._table.get(Name.OPERATING_MODE))

    @property
    def goal_register(self) -> Name:
        """The goal that commands motion in the present mode."""
        return _GOAL_OF_MODE.get(self.mode, Name.GOAL_POSITION)

    @property
    def watching(self) -> bool:
        """Whether `step` needs what the sensors measure: it counts turns, regulates, or follows a profile."""
        return self._regulating or self._profile.ongoing or self.mode is not OperatingMode.POSITION

    def power_on(self, seen: Sensed) -> None:
        """Set goal registers as at power-on: the limits, the present position; the mode's own goal moves nothing."""
        self.find(seen)
        for goal, limit in _LIMITED:
            if goal in self._table:
                self._table.put(goal, 0 if goal is self.goal_register else self._table.get(limit))
        self.hold_here()

    def change_mode(self, seen: Sensed) -> None:
        """Reset what a new Operating Mode resets (e-manual "Operating Mode(11)", note)."""
        for gain in _GAINS:
            self._table.put(gain, self._table.initial(gain))
        self._table.put(Name.PROFILE_ACCELERATION, 0)
        self._table.put(Name.PROFILE_VELOCITY, 0)
        self.power_on(seen)

    def find(self, seen: Sensed) -> None:
        """Count the present position as within the first turn."""
        self._reversed = bool(self._table.get(Name.DRIVE_MODE) & REVERSE)
        self._shaft = seen.angle
        self.position = self._sense(seen.angle) % _TURN
        self._speed = self._moved = 0.0

    def hold_here(self) -> None:
        """Make the present position the goal."""
        self._table.put(Name.GOAL_POSITION, self._counts(self.position))
        self._stopped: float | None = None  # shaft angle where the Bus Watchdog stopped it [rad]
        self._rest()
        self.update()

    def clear(self, seen: Sensed) -> None:
        """Take the present position back into the first turn (e-manual "Clear")."""
        self.find(seen)
        self.hold_here()  # or it would set out for a goal that now is turns away

    def torque_on(self, seen: Sensed) -> None:
        """Begin to drive the motor: forget old trajectories, go for the goal."""
        if self.mode is OperatingMode.POSITION:
            self.find(seen)
        else:
            self._track(seen, 0.0)
        self._rest()
        self._aim()
        self.update()

    def stop(self, seen: Sensed) -> None:
        """Stop as a tripped Bus Watchdog does: hold the position, or brake, until the next goal or torque off."""
        self._track(seen, 0.0)
        self._stopped = seen.angle
        self._rest()
        self.update()

    def obey(self, changes: Mapping[Name, int]) -> None:
        """Let written registers act."""
        goal = self.goal_register
        if goal in changes or changes.get(Name.TORQUE_ENABLE) == 0:
            self._stopped = None
        paced = {goal, Name.PROFILE_VELOCITY, Name.PROFILE_ACCELERATION}
        if changes.keys() & paced and self._stopped is None and self.drive.torque:
            self._aim()
        self.update()

    def step(self, seen: Sensed, dt: float) -> None:
        """Run one control step.

        Args:
            seen: What the sensors measure.
            dt: Since the last step [s].
        """
        self._track(seen, dt)
        dt = min(dt, _LONGEST_STEP)
        if not self._table.get(Name.TORQUE_ENABLE):
            return
        before = self._profile.velocity
        self._profile.step(dt)
        self._acceleration = (self._profile.velocity - before) / dt if dt > 0 else 0.0
        self.update(self._duty(seen, dt) if self._regulating and dt > 0 else None)

    def update(self, duty: float | None = None) -> None:
        """Bring `drive` up to date.

        Args:
            duty: What the loops ask for; None: as before.
        """
        table = self._table
        torque = bool(table.get(Name.TORQUE_ENABLE))
        plain = self.mode in (OperatingMode.POSITION, OperatingMode.EXTENDED_POSITION)
        self._regulating = self._own_loop or not plain or self._control.beyond_plain
        if self._regulating and duty is None:
            duty = (self.drive.duty or 0.0) if torque and self.drive.torque else 0.0
        drive = Drive(
            torque=torque,
            goal=self._shaft_goal() if self._stopped is None else self._stopped,
            p_gain=table.get(Name.POSITION_P_GAIN),
            duty_limit=self._control.limit(self.mode),
            duty=duty if self._regulating else None,
        )
        if drive != self.drive:
            self.drive = drive

    def measure(self, seen: Sensed) -> None:
        """Refresh the registers of what is measured."""
        table, way = self._table, -1 if self._reversed else 1
        self._track(seen, 0.0)
        position, goal = self._present(seen), table.get(Name.GOAL_POSITION)
        velocity = way * round(seen.velocity / VELOCITY_UNIT)
        moving_goal = self._profile.ongoing and self.mode in _POSITION_MODES
        trajectory = self._counts(self._profile.position) if moving_goal else goal
        table.put(Name.MOVING, int(abs(velocity) > table.get(Name.MOVING_THRESHOLD)))
        table.put(Name.MOVING_STATUS, self._status(goal - position, trajectory - position, moving_goal))
        table.put(Name.PRESENT_PWM, way * round(seen.duty * FULL_PWM))
        if Name.PRESENT_CURRENT in table:
            table.put(Name.PRESENT_CURRENT, max(-32768, min(32767, way * round(seen.current / CURRENT_UNIT))))
        else:
            table.put(Name.PRESENT_LOAD, way * round(seen.duty * 1000))
        table.put(Name.PRESENT_VELOCITY, velocity)
        table.put(Name.PRESENT_POSITION, position)
        table.put(Name.VELOCITY_TRAJECTORY, round(self._trajectory_speed() / VELOCITY_UNIT))
        table.put(Name.POSITION_TRAJECTORY, trajectory)

    def _sense(self, angle: float) -> float:
        """Return a shaft angle in the servo's sense of rotation."""
        return -angle if self._reversed else angle

    def _homing(self) -> int:
        offset = self._table.get(Name.HOMING_OFFSET)
        ignored = self.mode is OperatingMode.POSITION and abs(offset) > _HOMING_IN_MODE_3
        return 0 if ignored else offset

    def _counts(self, position: float) -> int:
        counts = round(position / RAD_PER_COUNT)
        return (counts % COUNTS_PER_TURN if self.mode is OperatingMode.POSITION else counts) + self._homing()

    def _present(self, seen: Sensed) -> int:
        if self.mode is OperatingMode.POSITION:
            return self._counts(self._sense(seen.angle))
        return self._counts(self.position)

    def _goal(self) -> float:
        return (self._table.get(Name.GOAL_POSITION) - self._homing()) * RAD_PER_COUNT

    def _shaft_goal(self) -> float:
        """Return the shaft angle for a plant that regulates [rad]."""
        target = self._profile.position if self._profile.ongoing else self._goal()
        if self.mode is OperatingMode.POSITION:
            return _TURN - target if self._reversed else target
        return self._shaft + self._sense(target - self.position)

    def _rest(self) -> None:
        self._profile.rest(self.position if self.mode in _POSITION_MODES else 0.0)
        self._acceleration = 0.0
        self._control.reset()

    def _aim(self) -> None:
        """Set out for the goal, as fast as the profile registers allow."""
        speed, ramp = (self._table.get(name) for name in (Name.PROFILE_VELOCITY, Name.PROFILE_ACCELERATION))
        timed = bool(self._table.get(Name.DRIVE_MODE) & TIME_BASED)
        if self.mode in _POSITION_MODES:
            if timed:
                self._profile.aim_in(self._goal(), speed * 1e-3, ramp * 1e-3)
            else:
                self._profile.aim(
                    self._goal(),
                    speed * VELOCITY_UNIT if speed else math.inf,
                    ramp * ACCELERATION_UNIT if ramp else math.inf,
                )
        elif self.mode is OperatingMode.VELOCITY:  # the profile's position is the desired velocity here
            most = self._table.get(Name.VELOCITY_LIMIT)
            goal = max(-most, min(most, self._table.get(Name.GOAL_VELOCITY))) * VELOCITY_UNIT
            change = abs(goal - self._profile.position)
            rate = (change / (ramp * 1e-3) if timed else ramp * ACCELERATION_UNIT) if ramp else math.inf
            self._profile.aim(goal, rate if rate > 0 else math.inf, math.inf)

    def _track(self, seen: Sensed, dt: float) -> None:
        """Count turns, and estimate the velocity that the loops see."""
        moved = self._sense((seen.angle - self._shaft + math.pi) % _TURN - math.pi)
        self._shaft = seen.angle
        self.position += moved
        self._moved += moved
        if dt > 0:
            self._speed += (self._moved / dt - self._speed) * -math.expm1(-dt / _SPEED_LAG)
            self._moved = 0.0

    def _trajectory_speed(self) -> float:
        if self.mode is OperatingMode.VELOCITY:
            return self._profile.position
        return self._profile.velocity if self.mode in _POSITION_MODES else 0.0

    def _duty(self, seen: Sensed, dt: float) -> float:
        """Return the duty that the loops ask for, in the shaft's sense."""
        profile = self._profile
        course = Course(
            position=self.position,
            speed=self._speed,
            wanted=profile.position,
            velocity=profile.velocity,
            acceleration=self._acceleration,
            stopped=self._stopped is not None,
        )
        before = self._sense(seen.duty if self.drive.duty is None else self.drive.duty)
        return self._sense(self._control.duty(self.mode, course, seen, before, dt))

    def _status(self, to_goal: int, to_trajectory: int, ongoing: bool) -> int:
        """Return Moving Status(123)."""
        bits = self._profile.shape << 4 | int(ongoing) << 1
        if self.mode in _POSITION_MODES:
            bits |= int(abs(to_trajectory) > FOLLOWING) << 3 | int(abs(to_goal) <= IN_POSITION)
        return bits
