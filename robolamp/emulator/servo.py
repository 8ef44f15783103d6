"""One emulated servo: its control table, what it answers, and what it drives its motor with.

Instructions as on the e-manual's protocol 2.0 page, registers as on its control table pages.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from robolamp.dynamixel.registers import (
    BAUD_CODES,
    COUNTS_PER_TURN,
    CURRENT_UNIT,
    FULL_PWM,
    RAD_PER_COUNT,
    RETURN_DELAY_UNIT,
    VELOCITY_UNIT,
    VOLTAGE_UNIT,
    WATCHDOG_UNIT,
    Model,
    Name,
)
from robolamp.emulator.packet import ALERT, Error, Instruction
from robolamp.emulator.table import TRIPPED, ControlTable, Refused

FIRMWARE = 52
"""Firmware Version(6) that the emulated servos report."""

BOOT_TIME = 0.2
"""How long a servo is silent after REBOOT [s]. Estimate: the e-manual gives none."""

IN_POSITION = 20
"""Distance from the goal at which Moving Status(123) says "arrived" [counts]. Estimate: the e-manual gives none."""

_TICKS = 32_768  # Realtime Tick(120) counts 0 to 32,767 ms
_HOMING_IN_MODE_3 = 1024  # e-manual "Homing Offset(20)": outside +-1,024 it is ignored in position mode
_PRESENT_FROM, _PRESENT_TO = 120, 148  # Realtime Tick to Backup Ready, refreshed when a client reads them


@dataclass(frozen=True, slots=True)
class Sensed:
    """What a servo's own sensors measure, before it is rounded to register units.

    Attributes:
        angle: Of the output shaft, 0 to 2 pi over its turn [rad].
        velocity: Of the output shaft [rad/s].
        current: Supply current, positive where the motor pushes towards larger angles [A].
        duty: Motor voltage by supply voltage, -1 to 1.
        voltage: Supply [V].
        temperature: Inside [degC].
    """

    angle: float
    velocity: float
    current: float
    duty: float
    voltage: float
    temperature: float


@dataclass(frozen=True, slots=True)
class Drive:
    """What a servo does to its motor.

    Attributes:
        torque: Whether the motor is driven; else its winding is open.
        goal: Shaft angle it regulates to [rad].
        p_gain: Position P Gain register.
        duty_limit: Largest duty, 0 to 1.
    """

    torque: bool
    goal: float
    p_gain: int
    duty_limit: float


class Servo:
    """A servo in position mode on a bus.

    Args:
        model: Its control table.
        eeprom: Values that differ from the factory's, by register.
        sense: Returns what its sensors measure at a time [s].
    """

    def __init__(self, model: Model, eeprom: Mapping[Name, int], sense: Callable[[float], Sensed]) -> None:
        self.model = model
        self._sense = sense
        self._table = ControlTable(model, {Name.FIRMWARE_VERSION: FIRMWARE, **eeprom})
        self._booted = -math.inf
        self._fed = 0.0
        self._power_on(0.0)

    @property
    def id(self) -> int:
        """ID(7)."""
        return self._table.get(Name.ID)

    @property
    def shadow_id(self) -> int:
        """Secondary ID(12): obeyed without an answer; 253 and more mean none."""
        return self._table.get(Name.SHADOW_ID)

    @property
    def level(self) -> int:
        """Status Return Level(68): 0 answers pings, 1 reads too, 2 everything."""
        return self._table.get(Name.STATUS_RETURN_LEVEL)

    @property
    def return_delay(self) -> float:
        """Time from an instruction's end to the answer's start [s]."""
        return self._table.get(Name.RETURN_DELAY_TIME) * RETURN_DELAY_UNIT

    def hears(self, baud: int, time: float) -> bool:
        """Return whether bytes at that rate [1/s] reach it at that time [s]: same rate, and not booting."""
        return time >= self._booted and BAUD_CODES.get(baud) == self._table.get(Name.BAUD_RATE)

    def drive(self) -> Drive:
        """Return what it does to its motor now."""
        return self._drive

    def poll(self, time: float) -> None:
        """Let time pass: trip the Bus Watchdog when nothing was heard for too long (e-manual "Bus Watchdog(98)").

        Args:
            time: Now [s].
        """
        limit = self._watchdog
        if limit > 0 and self._drive.torque and time - self._fed > limit * WATCHDOG_UNIT:
            self._table.put(Name.BUS_WATCHDOG, TRIPPED)
            self._table.put(Name.PROFILE_VELOCITY, 0)
            self._table.put(Name.PROFILE_ACCELERATION, 0)
            self._watchdog = TRIPPED
            self._hold = self._sense(time).angle
            self._update_drive()

    def heard(self, time: float) -> None:
        """Take note of an instruction packet on the bus, whoever it is for: it feeds the Bus Watchdog."""
        self._fed = time

    def read(self, address: int, size: int, time: float) -> bytes:
        """Return a stretch of the control table, measurements refreshed.

        Args:
            address: Of the first byte.
            size: How many bytes.
            time: Now [s].

        Raises:
            Refused: The stretch is empty or leaves the table.
        """
        if address < _PRESENT_TO and address + size > _PRESENT_FROM:
            self._measure(time)
        return self._table.read(address, size)

    def write(self, address: int, data: bytes) -> None:
        """Write whole registers, all or none, and let them act.

        Args:
            address: Of the first register.
            data: One or more registers' bytes.

        Raises:
            Refused: See `ControlTable.write`.
        """
        self._obey(self._table.write(address, data))

    def answer(self, instruction: int, parameters: bytes, time: float) -> tuple[int, bytes] | None:
        """Carry out an instruction for this servo alone.

        Args:
            instruction: INST byte.
            parameters: Its parameters.
            time: Now [s].

        Returns:
            ERR byte and parameters of the status packet; None where Status Return Level(68) wants none.
        """
        granted = self.level
        level, result = 2, b""
        error = Error.NONE
        try:
            if instruction == Instruction.PING:
                level = 0
                result = self._table.read(0, 2) + self._table.read(6, 1)  # model number, firmware
            elif instruction == Instruction.READ:
                level = 1
                if len(parameters) != 4:
                    raise Refused(Error.LENGTH)
                address, size = (int.from_bytes(parameters[i : i + 2], "little") for i in (0, 2))
                result = self.read(address, size, time)
            elif instruction == Instruction.WRITE:
                if len(parameters) < 2:
                    raise Refused(Error.LENGTH)
                self.write(int.from_bytes(parameters[:2], "little"), parameters[2:])
            elif instruction == Instruction.REBOOT:
                self._power_on(time)
                self._booted = time + BOOT_TIME
            elif instruction == Instruction.FACTORY_RESET:
                raise Refused(Error.RESULT)
            else:
                raise Refused(Error.INSTRUCTION)
        except Refused as refusal:
            error = refusal.error
        return (self.alert(error), result) if level <= granted else None

    def alert(self, error: Error) -> int:
        """Return an ERR byte: the error, and the alert bit while Hardware Error Status(70) is not 0."""
        return error | (ALERT if self._table.get(Name.HARDWARE_ERROR_STATUS) else 0)

    def _power_on(self, time: float) -> None:
        """Give RAM its values at power-on; goals are the limits, and the present position."""
        self._table.power_on()
        for goal, limit in (
            (Name.GOAL_PWM, Name.PWM_LIMIT),
            (Name.GOAL_CURRENT, Name.CURRENT_LIMIT),
            (Name.GOAL_VELOCITY, Name.VELOCITY_LIMIT),
        ):
            if goal in self._table:
                self._table.put(goal, self._table.get(limit))
        self._table.put(Name.BACKUP_READY, 1)
        self._started = time
        self._watchdog = 0
        self._hold: float | None = None  # where a tripped watchdog stopped it, until a goal or torque off [rad]
        self._table.put(Name.GOAL_POSITION, self._counts(self._sense(time).angle))
        self._update_drive()

    def _homing(self) -> int:
        offset = self._table.get(Name.HOMING_OFFSET)
        return offset if abs(offset) <= _HOMING_IN_MODE_3 else 0

    def _counts(self, angle: float) -> int:
        return round(angle / RAD_PER_COUNT) % COUNTS_PER_TURN + self._homing()

    def _obey(self, changes: Mapping[Name, int]) -> None:
        """Let written registers act."""
        if Name.BUS_WATCHDOG in changes:
            self._watchdog = changes[Name.BUS_WATCHDOG]
        if Name.GOAL_POSITION in changes or changes.get(Name.TORQUE_ENABLE) == 0:
            self._hold = None
        self._update_drive()

    def _update_drive(self) -> None:
        goal = (self._table.get(Name.GOAL_POSITION) - self._homing()) * RAD_PER_COUNT
        self._drive = Drive(
            torque=bool(self._table.get(Name.TORQUE_ENABLE)),
            goal=goal if self._hold is None else self._hold,
            p_gain=self._table.get(Name.POSITION_P_GAIN),
            duty_limit=abs(self._table.get(Name.GOAL_PWM)) / FULL_PWM,
        )

    def _measure(self, time: float) -> None:
        """Refresh the registers of what is measured."""
        seen = self._sense(time)
        position, goal = self._counts(seen.angle), self._table.get(Name.GOAL_POSITION)
        velocity = round(seen.velocity / VELOCITY_UNIT)
        self._table.put(Name.REALTIME_TICK, int(max(time - self._started, 0.0) * 1000) % _TICKS)
        self._table.put(Name.MOVING, int(abs(velocity) > self._table.get(Name.MOVING_THRESHOLD)))
        self._table.put(Name.MOVING_STATUS, int(abs(goal - position) <= IN_POSITION))
        self._table.put(Name.PRESENT_PWM, round(seen.duty * FULL_PWM))
        if Name.PRESENT_CURRENT in self._table:
            self._table.put(Name.PRESENT_CURRENT, max(-32768, min(32767, round(seen.current / CURRENT_UNIT))))
        else:
            self._table.put(Name.PRESENT_LOAD, round(seen.duty * 1000))
        self._table.put(Name.PRESENT_VELOCITY, velocity)
        self._table.put(Name.PRESENT_POSITION, position)
        self._table.put(Name.POSITION_TRAJECTORY, goal)
        self._table.put(Name.PRESENT_INPUT_VOLTAGE, round(seen.voltage / VOLTAGE_UNIT))
        self._table.put(Name.PRESENT_TEMPERATURE, round(seen.temperature))
