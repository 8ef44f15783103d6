"""A servo's control table: bytes that are read and written as registers, under the e-manual's rules of access.

The addresses, ranges and factory values are the data of `robolamp.dynamixel.registers`; the rules for using them are
here, from the e-manual's protocol 2.0 page ("Error") and its control table pages.
"""

from __future__ import annotations

from collections.abc import Mapping

from robolamp.dynamixel.registers import Model, Name, Register
from robolamp.emulator.packet import Error

TRIPPED = -1
"""Bus Watchdog(98) after nothing was heard for too long: goals are refused until 0 is written to it."""

_GOALS = (Name.GOAL_PWM, Name.GOAL_CURRENT, Name.GOAL_VELOCITY, Name.GOAL_POSITION)
_EMULATED = {Name.OPERATING_MODE: (3,), Name.DRIVE_MODE: (0,), Name.PROTOCOL_TYPE: (2,)}


class Refused(Exception):
    """An instruction that a servo refuses.

    Args:
        error: What its status packet says.
    """

    def __init__(self, error: Error) -> None:
        super().__init__(error.name)
        self.error = error


class ControlTable:
    """The registers of one servo.

    Args:
        model: Which registers there are.
        eeprom: Values that differ from the factory's, by register.
    """

    def __init__(self, model: Model, eeprom: Mapping[Name, int]) -> None:
        self._model = model
        self._registers = {register.address: register for register in model.registers.values()}
        self._memory = bytearray(max(register.address + register.size for register in self._registers.values()))
        for register in self._registers.values():
            if register.eeprom and register.initial is not None:
                self.put(register.name, register.initial)
        for name, value in eeprom.items():
            self.put(name, value)

    def __contains__(self, name: Name) -> bool:
        return name in self._model.registers

    def get(self, name: Name) -> int:
        """Return a register's value."""
        register = self._model[name]
        raw = self._memory[register.address : register.address + register.size]
        return int.from_bytes(raw, "little", signed=register.signed)

    def put(self, name: Name, value: int) -> None:
        """Set a register, whatever its access."""
        register = self._model[name]
        raw = value.to_bytes(register.size, "little", signed=register.signed)
        self._memory[register.address : register.address + register.size] = raw

    def power_on(self) -> None:
        """Give RAM its values at power-on; 0 where the servo decides them."""
        for register in self._registers.values():
            if not register.eeprom:
                self.put(register.name, register.initial or 0)

    def read(self, address: int, size: int) -> bytes:
        """Return a stretch of the table; bytes between registers read as 0.

        Args:
            address: Of the first byte.
            size: How many bytes.

        Raises:
            Refused: LENGTH: the stretch is empty; ACCESS: it leaves the table.
        """
        if size == 0:
            raise Refused(Error.LENGTH)
        if address + size > len(self._memory):
            raise Refused(Error.ACCESS)
        return bytes(self._memory[address : address + size])

    def write(self, address: int, data: bytes) -> dict[Name, int]:
        """Write whole registers, all or none.

        Args:
            address: Of the first register.
            data: One or more registers' bytes.

        Returns:
            What was written, by register.

        Raises:
            Refused: ACCESS: no such register, read-only, or EEPROM with torque on; LENGTH: part of a register;
                RANGE: not a legal value, or a goal after the Bus Watchdog tripped; LIMIT: beyond a limit register.
        """
        if not data:
            raise Refused(Error.LENGTH)
        locked = bool(self.get(Name.TORQUE_ENABLE))
        changes: dict[Name, int] = {}
        while data:
            register = self._registers.get(address)
            if register is None or not register.writable or (register.eeprom and locked):
                raise Refused(Error.ACCESS)
            if len(data) < register.size:
                raise Refused(Error.LENGTH)
            value = int.from_bytes(data[: register.size], "little", signed=register.signed)
            self._check(register, value, changes)
            changes[register.name] = value
            address, data = address + register.size, data[register.size :]
        for name, value in changes.items():
            self.put(name, value)
        return changes

    def _check(self, register: Register, value: int, changes: Mapping[Name, int]) -> None:
        """Refuse a value that is not legal, in the light of the same instruction's other changes."""
        legal = _EMULATED.get(register.name, register.choices)
        too_low = register.low is not None and value < register.low
        if too_low or (register.high is not None and value > register.high) or (legal and value not in legal):
            raise Refused(Error.RANGE)
        if register.name in _GOALS and self.get(Name.BUS_WATCHDOG) == TRIPPED:
            raise Refused(Error.RANGE)
        if register.bounds:
            limits = [changes.get(name, self.get(name)) for name in register.bounds]
            low, high = limits if len(limits) == 2 else (-limits[0], limits[0])
            if not low <= value <= high:
                raise Refused(Error.LIMIT)
