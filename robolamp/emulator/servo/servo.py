"""One emulated servo: its control table, what it answers, and what it drives its motor with.

Instructions as on the e-manual's protocol 2.0 page, registers as on its control table pages.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

from robolamp.dynamixel.registers import (
    BAUD_CODES,
    RETURN_DELAY_UNIT,
    VOLTAGE_UNIT,
    WATCHDOG_UNIT,
    HardwareError,
    Model,
    Name,
)
from robolamp.emulator.packet import ALERT, Error, Instruction
from robolamp.emulator.servo.bare_motor import DATASHEETS
from robolamp.emulator.servo.control_table import TRIPPED, ControlTable, Refused
from robolamp.emulator.servo.drive import Drive, Sensed
from robolamp.emulator.servo.eeprom_file import load_eeprom
from robolamp.emulator.servo.memory import Memory
from robolamp.emulator.servo.motion import TORQUE_BY_GOAL, Motion
from robolamp.emulator.servo.shutdown import Guard

FIRMWARE = 52
"""Firmware Version(6) that the emulated servos report."""

BOOT_TIME = 0.2
"""How long a servo is silent after REBOOT [s]. Estimate: the e-manual gives none."""

WAKING = 0.003
"""Between the servos of one line, how much longer than the last each has been awake [s]: no two start counting
Realtime Tick(120) in the same millisecond. Estimate."""

_TICKS = 32_768  # Realtime Tick(120) counts 0 to 32,767 ms
_PRESENT_FROM, _PRESENT_TO = 120, 148  # Realtime Tick to Backup Ready, refreshed when a client reads them
_GUARD_STEP = 0.01  # how often heat and errors are looked at [s]
_CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"  # e-manual "Clear": option 1 and its fixed values
_STARTUP_TORQUE = 0x01  # bit of Startup Configuration(60)


class Servo:
    """A servo on a bus.

    Args:
        model: Its control table.
        eeprom: Values that differ from the factory's, by register.
        sense: Returns what its sensors measure at a time [s].
        own_loop: Regulate plain position control too, for a plant that is only a motor.
        store: File that keeps its EEPROM; what it holds goes before `eeprom`. None: EEPROM ends with the process.
        woke: How much earlier than others that start with it its clock begins to count [s].

    Attributes:
        model: As given.
        written: When registers were last written [s].

    Raises:
        FileError: The file cannot be read, or is not this model's.
    """

    def __init__(
        self,
        model: Model,
        eeprom: Mapping[Name, int],
        sense: Callable[[float], Sensed],
        *,
        own_loop: bool = False,
        store: Path | None = None,
        woke: float = 0.0,
    ) -> None:
        self.model = model
        self._sense = sense
        kept = load_eeprom(store, model) if store else {}
        self._table = ControlTable(model, {Name.FIRMWARE_VERSION: FIRMWARE, **eeprom, **kept})
        self._memory = Memory(self._table, model, store)
        self._guard = Guard(DATASHEETS[model.name], self._table)
        self._booted = -math.inf
        self._woke = woke
        self._fed = self._polled = self._guarded = 0.0
        self.written = -math.inf
        self._table.power_on()
        self._motion = Motion(self._table, DATASHEETS[model.name], own_loop, sense(0.0))
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

    @property
    def heat(self) -> float:
        """How much warmer it is than the air around it [K]."""
        return self._guard.rise

    def hears(self, baud: int, time: float) -> bool:
        """Return whether it understands bytes at that rate [1/s] and time [s]: same rate, protocol 2.0, not booting."""
        same = BAUD_CODES.get(baud) == self._table.get(Name.BAUD_RATE) and self._table.get(Name.PROTOCOL_TYPE) == 2
        return time >= self._booted and same

    def drive(self) -> Drive:
        """Return what it does to its motor now: the same object for as long as that does not change."""
        return self._motion.drive

    def poll(self, time: float) -> None:
        """Let time pass; call it before each physics step.

        Control loops and profiles run here, heat and errors are watched, and the Bus Watchdog trips when nothing was
        heard for too long (e-manual "Bus Watchdog(98)").

        Args:
            time: Now [s].
        """
        dt = time - self._polled
        if dt <= 0.0:
            return
        self._polled = time
        if self._motion.watching:
            self._motion.step(self._sense(time), dt)
        if time - self._guarded >= _GUARD_STEP:
            self._watch(time)
        limit = self._table.get(Name.BUS_WATCHDOG)
        if limit > 0 and self._motion.drive.torque and time - self._fed > limit * WATCHDOG_UNIT:
            self._table.put(Name.BUS_WATCHDOG, TRIPPED)
            self._table.put(Name.PROFILE_VELOCITY, 0)
            self._table.put(Name.PROFILE_ACCELERATION, 0)
            self._motion.stop(self._sense(time))

    def heard(self, time: float) -> None:
        """Notice an instruction packet on the bus for any servo: it feeds the Bus Watchdog."""
        self._fed = time

    def reboot(self, time: float) -> None:
        """Start again, silent for `BOOT_TIME`: RAM is lost, EEPROM and heat are not.

        Args:
            time: Now [s].
        """
        self._power_on(time)
        self._booted = time + BOOT_TIME

    def register(self, name: Name) -> int:
        """Return a register as it was last written or measured."""
        return self._table.get(name)

    def put(self, name: Name, value: int) -> None:
        """Set a register, whatever its access, and let it act.

        Args:
            name: Which.
            value: What to.
        """
        self._table.put(name, value)
        self._motion.obey({name: value})

    def fail(self, errors: HardwareError) -> None:
        """Set hardware errors: they stay until a reboot, and shut the servo down if Shutdown(63) says so.

        Args:
            errors: Bits of Hardware Error Status(70).
        """
        self._guard.fail(errors)
        self._halt()

    def read(self, address: int, size: int, time: float) -> bytes:
        """Return a stretch of the control table, measurements refreshed.

        Args:
            address: Of the first byte.
            size: How many bytes.
            time: Now [s].

        Raises:
            Refused: The stretch is empty or leaves the table.
        """
        if self._table.touches(address, size, _PRESENT_FROM, _PRESENT_TO):
            self._measure(time)
        return self._table.read(address, size)

    def write(self, address: int, data: bytes, time: float) -> None:
        """Write whole registers, all or none, and let them act.

        Args:
            address: Of the first register.
            data: One or more registers' bytes.
            time: Now [s].

        Raises:
            Refused: See `ControlTable.write`; RESULT: torque on after a shutdown.
        """
        before = {name: self._table.get(name) for name in (Name.OPERATING_MODE, Name.TORQUE_ENABLE)}
        if self._guard.shut_down and self._table.check(address, data).get(Name.TORQUE_ENABLE) == 1:
            raise Refused(Error.RESULT)
        changes = self._table.write(address, data)
        self.written = time
        by_goal = self._motion.goal_register in changes and self._table.get(Name.DRIVE_MODE) & TORQUE_BY_GOAL
        if by_goal and not self._guard.shut_down:
            self._table.put(Name.TORQUE_ENABLE, 1)
        if changes.get(Name.OPERATING_MODE, before[Name.OPERATING_MODE]) != before[Name.OPERATING_MODE]:
            self._motion.change_mode(self._sense(time))
        elif changes.keys() & {Name.DRIVE_MODE, Name.HOMING_OFFSET, Name.OPERATING_MODE}:
            self._motion.find(self._sense(time))
        if self._table.get(Name.TORQUE_ENABLE) > before[Name.TORQUE_ENABLE]:
            self._fed = time
            self._motion.torque_on(self._sense(time))
        self._motion.obey(changes)
        if any(self.model[name].eeprom for name in changes):
            self._memory.keep()

    def answer(
        self, instruction: int, parameters: bytes, time: float, *, broadcast: bool = False
    ) -> tuple[int, bytes] | None:
        """Carry out an instruction for this servo alone.

        Args:
            instruction: INST byte.
            parameters: Its parameters.
            time: Now [s].
            broadcast: It was meant for all servos.

        Returns:
            ERR byte and parameters of the status packet; None where Status Return Level(68) wants none.
        """
        granted = self.level
        level, result = 2, b""
        error = Error.NONE
        try:
            match instruction:
                case Instruction.PING:
                    level = 0
                    result = self._table.read(0, 2) + self._table.read(6, 1)  # model number, firmware
                case Instruction.READ:
                    level = 1
                    if len(parameters) != 4:
                        raise Refused(Error.LENGTH)
                    address, size = (int.from_bytes(parameters[i : i + 2], "little") for i in (0, 2))
                    result = self.read(address, size, time)
                case Instruction.WRITE:
                    self.write(*_addressed(parameters), time)
                case Instruction.REG_WRITE:
                    address, data = _addressed(parameters)
                    self._table.check(address, data)
                    self._registered = (address, data)
                    self._table.put(Name.REGISTERED_INSTRUCTION, 1)
                case Instruction.ACTION:
                    self._act(time)
                case Instruction.REBOOT:
                    self.reboot(time)
                case Instruction.FACTORY_RESET:
                    if self._memory.factory_reset(parameters, broadcast=broadcast):
                        self.reboot(time)
                case Instruction.CLEAR:
                    self._clear(parameters, time)
                case Instruction.BACKUP:
                    if self._memory.back_up(parameters):
                        self.reboot(time)
                case _:
                    raise Refused(Error.INSTRUCTION)
        except Refused as refusal:
            error = refusal.error
        return (self.alert(error), result) if level <= granted else None

    def alert(self, error: Error) -> int:
        """Return an ERR byte: the error, and the alert bit while Hardware Error Status(70) is not 0."""
        return error | (ALERT if self._table.get(Name.HARDWARE_ERROR_STATUS) else 0)

    def _power_on(self, time: float) -> None:
        """Give RAM its values at power-on."""
        self._memory.power_on()
        self._started = time - self._woke
        self._registered: tuple[int, bytes] | None = None
        self._guard.restart()
        seen = self._sense(time)
        self._motion.power_on(seen)
        if self._table.get(Name.STARTUP_CONFIGURATION) & _STARTUP_TORQUE:
            self._table.put(Name.TORQUE_ENABLE, 1)
            self._motion.torque_on(seen)

    def _watch(self, time: float) -> None:
        """Let it heat up, and shut it down where it must be."""
        self._guard.step(self._sense(time), time - self._guarded)
        self._guarded = time
        self._halt()

    def _halt(self) -> None:
        if self._guard.shut_down and self._table.get(Name.TORQUE_ENABLE):
            self.put(Name.TORQUE_ENABLE, 0)

    def _act(self, time: float) -> None:
        if self._registered is None:
            raise Refused(Error.INSTRUCTION)
        address, data = self._registered
        self._registered = None
        self._table.put(Name.REGISTERED_INSTRUCTION, 0)
        self.write(address, data, time)

    def _clear(self, parameters: bytes, time: float) -> None:
        if len(parameters) != len(_CLEAR_TURNS):
            raise Refused(Error.LENGTH)
        self._measure(time)
        if parameters != _CLEAR_TURNS or self._table.get(Name.MOVING):
            raise Refused(Error.RESULT)
        self._motion.clear(self._sense(time))

    def _measure(self, time: float) -> None:
        """Refresh the registers of what is measured."""
        seen = self._sense(time)
        self._motion.measure(seen)
        self._table.put(Name.REALTIME_TICK, int(max(time - self._started, 0.0) * 1000) % _TICKS)
        self._table.put(Name.PRESENT_INPUT_VOLTAGE, max(0, round(seen.voltage / VOLTAGE_UNIT)))
        self._table.put(Name.PRESENT_TEMPERATURE, max(0, min(255, round(seen.temperature + self._guard.rise))))


def _addressed(parameters: bytes) -> tuple[int, bytes]:
    """Return address and data of a write."""
    if len(parameters) < 2:
        raise Refused(Error.LENGTH)
    return int.from_bytes(parameters[:2], "little"), parameters[2:]
