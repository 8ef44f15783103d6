"""A servo's control table: bytes that are read and written as registers, under the e-manual's rules of access.

The addresses, ranges and factory values are the data of `robolamp.dynamixel.registers`; the rules for using them are
here, from the e-manual's protocol 2.0 page ("Error") and its control table pages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from robolamp.dynamixel.registers import IndirectBlock, Model, Name, OperatingMode, Register
from robolamp.emulator.packet import Error

TRIPPED = -1
"""Bus Watchdog(98) after nothing was heard for too long: goals are refused until 0 is written to it."""

_GOALS = (Name.GOAL_PWM, Name.GOAL_CURRENT, Name.GOAL_VELOCITY, Name.GOAL_POSITION)

_EXTENDED_RANGE = 1_048_575  # largest Goal Position(116), either way, in the modes of many turns [counts]
_EXTENDED = (OperatingMode.EXTENDED_POSITION, OperatingMode.CURRENT_BASED_POSITION)
_EMULATED = {Name.DRIVE_MODE: (0, 1, 4, 5, 8, 9, 12, 13), Name.PROTOCOL_TYPE: (2,)}  # bits 0, 2, 3; protocol 2.0 alone


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
        ends = [register.address + register.size for register in self._registers.values()]
        self._memory = bytearray(max(ends + [block.data + block.count for block in model.indirect]))
        self.factory_reset()
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

    def initial(self, name: Name) -> int:
        """Return a register's value at power-on, or from the factory; 0 where the servo decides it."""
        return self._model[name].initial or 0

    def eeprom(self) -> dict[Name, int]:
        """Return what a client may write and power loss does not erase, by register."""
        return {
            register.name: self.get(register.name)
            for register in self._registers.values()
            if register.eeprom and register.writable
        }

    def indirect(self) -> tuple[int, ...]:
        """Return every Indirect Address, in order."""
        return tuple(
            int.from_bytes(self._memory[block.address + 2 * index : block.address + 2 * index + 2], "little")
            for block in self._model.indirect
            for index in range(block.count)
        )

    def point(self, addresses: Iterable[int]) -> None:
        """Set every Indirect Address, in order."""
        places = [block.address + 2 * index for block in self._model.indirect for index in range(block.count)]
        for place, address in zip(places, addresses, strict=True):
            self._poke(place, address.to_bytes(2, "little"))

    def factory_reset(self, *, keep: Iterable[Name] = ()) -> None:
        """Give EEPROM its factory values.

        Args:
            keep: Registers to leave alone.
        """
        kept = set(keep)
        for register in self._registers.values():
            if register.eeprom and register.initial is not None and register.name not in kept:
                self.put(register.name, register.initial)

    def power_on(self) -> None:
        """Give RAM its values at power-on; 0 where the servo decides them, and indirect addresses their own data."""
        for register in self._registers.values():
            if not register.eeprom:
                self.put(register.name, register.initial or 0)
        for block in self._model.indirect:
            for index in range(block.count):
                self._poke(block.address + 2 * index, (block.data + index).to_bytes(2, "little"))
            self._poke(block.data, bytes(block.count))

    def touches(self, address: int, size: int, first: int, end: int) -> bool:
        """Return whether a stretch reaches, itself or by indirect data, into the addresses from first to end."""
        if address < end and address + size > first:
            return True
        return any(
            address < block.data + block.count and address + size > block.data for block in self._model.indirect
        ) and any(first <= place < end for place in self._places(address, size))

    def read(self, address: int, size: int) -> bytes:
        """Return a stretch of the table; bytes between registers read as 0, indirect data as what it is mapped to.

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
        return bytes(self._memory[place] for place in self._places(address, size))

    def check(self, address: int, data: bytes) -> dict[Name, int]:
        """Return what `write` would, and write nothing.

        Raises:
            Refused: See `write`.
        """
        return self._plan(address, data)[0]

    def write(self, address: int, data: bytes) -> dict[Name, int]:
        """Write whole registers, directly or through indirect data, all or none.

        Args:
            address: Of the first register.
            data: One or more registers' bytes.

        Returns:
            What was written, by register; not the indirect ones.

        Raises:
            Refused: ACCESS: no such register, read-only, or EEPROM with torque on; LENGTH: part of a register;
                RANGE: not a legal value, or a goal after the Bus Watchdog tripped; LIMIT: beyond a limit register.
        """
        changes, pokes = self._plan(address, data)
        for name, value in changes.items():
            self.put(name, value)
        for place, raw in pokes:
            self._poke(place, raw)
        return changes

    def _plan(self, address: int, data: bytes) -> tuple[dict[Name, int], list[tuple[int, bytes]]]:
        """Return what a write changes: registers, and bytes of indirect addresses and data."""
        if not data:
            raise Refused(Error.LENGTH)
        if address + len(data) > len(self._memory):
            raise Refused(Error.ACCESS)
        locked = bool(self.get(Name.TORQUE_ENABLE))
        changes: dict[Name, int] = {}
        pokes: list[tuple[int, bytes]] = []
        places = self._places(address, len(data))
        at = 0
        while at < len(data):
            place = places[at]
            register, block = self._registers.get(place), self._block(place)
            if block is not None:
                size = 1 if place >= block.data else 2
                self._check_indirect(block, place, data[at : at + size])
                pokes.append((place, data[at : at + size]))
            elif register is None or not register.writable or (register.eeprom and locked):
                raise Refused(Error.ACCESS)
            else:
                size = register.size
                if places[at : at + size] != list(range(place, place + size)):
                    raise Refused(Error.LENGTH)
                value = int.from_bytes(data[at : at + size], "little", signed=register.signed)
                self._check(register, value, changes)
                changes[register.name] = value
            at += size
        return changes, pokes

    def _places(self, address: int, size: int) -> list[int]:
        """Return where each byte of a stretch really is: indirect data is where its address says."""
        places = list(range(address, address + size))
        for block in self._model.indirect:
            first = max(address, block.data)
            for place in range(first, min(address + size, block.data + block.count)):
                entry = block.address + 2 * (place - block.data)
                places[place - address] = int.from_bytes(self._memory[entry : entry + 2], "little")
        return places

    def _block(self, place: int) -> IndirectBlock | None:
        """Return the indirect block that an address belongs to, as address or as data."""
        for block in self._model.indirect:
            if block.data <= place < block.data + block.count or (
                block.address <= place < block.address + 2 * block.count
            ):
                return block
        return None

    def _check_indirect(self, block: IndirectBlock, place: int, raw: bytes) -> None:
        """Refuse half an indirect address, or one that points where it may not."""
        if place >= block.data:
            return
        if (place - block.address) % 2:
            raise Refused(Error.ACCESS)
        if len(raw) < 2:
            raise Refused(Error.LENGTH)
        if not block.low <= int.from_bytes(raw, "little") <= block.high:
            raise Refused(Error.RANGE)

    def _poke(self, place: int, raw: bytes) -> None:
        self._memory[place : place + len(raw)] = raw

    def _check(self, register: Register, value: int, changes: Mapping[Name, int]) -> None:
        """Refuse a value that is not legal, in the light of the same instruction's other changes."""
        legal = _EMULATED.get(register.name, register.choices)
        too_low = register.low is not None and value < register.low
        if too_low or (register.high is not None and value > register.high) or (legal and value not in legal):
            raise Refused(Error.RANGE)
        if register.name in _GOALS and self.get(Name.BUS_WATCHDOG) == TRIPPED:
            raise Refused(Error.RANGE)
        if register.name is Name.GOAL_POSITION and self.get(Name.OPERATING_MODE) in _EXTENDED:
            if abs(value) > _EXTENDED_RANGE:
                raise Refused(Error.RANGE)
        elif register.bounds:
            limits = [changes.get(name, self.get(name)) for name in register.bounds]
            low, high = limits if len(limits) == 2 else (-limits[0], limits[0])
            if not low <= value <= high:
                raise Refused(Error.LIMIT)
