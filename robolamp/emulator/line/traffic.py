"""The traffic on the servo port in words, a line a packet: `robolamp emulate --traffic`."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from robolamp.dynamixel.registers import Model, Register
from robolamp.emulator.packet import ALERT, BROADCAST, Error, Instruction, Packet, Parser

_ADDRESSED = frozenset({0x02, 0x03, 0x04})
"""Instructions to one servo whose parameters begin with an address: read, write, reg write."""

_SYNC_READS = frozenset({0x82, 0x8A})
_BULK_READS = frozenset({0x92, 0x9A})
_SYNC_WRITE, _BULK_WRITE = 0x83, 0x93
_BULK_HEAD = 5  # id, address, length


class Traffic:
    """Puts packets into words.

    Args:
        models: Models of the servos on the line: name the registers.
        write: Called with each line.
    """

    def __init__(self, models: Iterable[Model], write: Callable[[str], None]) -> None:
        self._registers: dict[int, Register] = {}
        for model in models:
            for register in model.registers.values():
                self._registers.setdefault(register.address, register)
        self._write = write
        self._to, self._from = Parser(), Parser()
        self._asked: dict[int, tuple[int, int]] = {}  # address and length of the last read, by id, in order

    def sent(self, data: bytes, time: float) -> None:
        """Take bytes that the client sent.

        Args:
            data: The bytes.
            time: When [s].
        """
        known = self._to.discarded
        for packet in self._to.feed(data):
            self._write(f"{time:12.6f} > {_name(packet.id)} {self._instruction(packet)}")
        if self._to.discarded > known:
            self._write(f"{time:12.6f} > {self._to.discarded - known} bytes that belong to no packet")

    def answered(self, data: bytes, time: float) -> None:
        """Take bytes that a servo sent.

        Args:
            data: The bytes.
            time: When the last of them arrived [s].
        """
        self._from.reset()
        found = self._from.feed(data)
        for packet in found:
            self._write(f"{time:12.6f} < {_name(packet.id)} {self._status(packet)}")
        if not found:
            self._write(f"{time:12.6f} < {len(data)} bytes that are no packet: {data.hex(' ')}")

    def _instruction(self, packet: Packet) -> str:
        if not packet.intact:
            return "damaged packet (wrong CRC)"
        code, parameters = packet.instruction, packet.parameters
        try:
            name = Instruction(code).name.lower().replace("_", " ")
        except ValueError:
            name = f"instruction {code:#04x}"
        words = self._of_one(code, parameters, packet.id) or self._of_many(code, parameters)
        return f"{name} {words if words is not None else parameters.hex(' ')}".rstrip()

    def _of_one(self, code: int, parameters: bytes, id: int) -> str | None:
        """Put a read or write of one servo into words; None: it is none."""
        if code not in _ADDRESSED or len(parameters) < 2:
            return None
        address, rest = _u16(parameters), parameters[2:]
        if code == Instruction.READ:
            self._asked = {id: (address, _u16(rest))}
            return f"{self._place(address)}, {_u16(rest)} bytes"
        return f"{self._place(address)} {self._value(address, rest)}"

    def _of_many(self, code: int, parameters: bytes) -> str | None:
        """Put a sync or bulk instruction into words; None: it is none, or malformed."""
        if code in _SYNC_READS and len(parameters) > 4:
            address, length, ids = _u16(parameters), _u16(parameters[2:]), parameters[4:]
            self._asked = dict.fromkeys(ids, (address, length))
            return f"{self._place(address)}, {length} bytes of {', '.join(map(str, ids))}"
        if code in _BULK_READS and parameters and len(parameters) % _BULK_HEAD == 0:
            rows = [parameters[at : at + _BULK_HEAD] for at in range(0, len(parameters), _BULK_HEAD)]
            self._asked = {row[0]: (_u16(row[1:]), _u16(row[3:])) for row in rows}
            return "; ".join(
                f"{self._place(address)}, {length} bytes of {id}" for id, (address, length) in self._asked.items()
            )
        if code == _SYNC_WRITE and len(parameters) > 4:
            address, step = _u16(parameters), _u16(parameters[2:]) + 1
            blocks = [parameters[at : at + step] for at in range(4, len(parameters), step)]
            values = ", ".join(f"{block[0]}: {self._value(address, block[1:])}" for block in blocks)
            return f"{self._place(address)} {values}"
        if code == _BULK_WRITE:
            written, at = [], 0
            while at + _BULK_HEAD <= len(parameters):
                id, address, length = parameters[at], _u16(parameters[at + 1 :]), _u16(parameters[at + 3 :])
                data = parameters[at + _BULK_HEAD : at + _BULK_HEAD + length]
                written.append(f"{id}: {self._place(address)} {self._value(address, data)}")
                at += _BULK_HEAD + length
            return ", ".join(written) or None
        return None

    def _status(self, packet: Packet) -> str:
        if not packet.intact or not packet.parameters:
            return "damaged answer"
        if packet.id == BROADCAST:
            return self._together(packet.parameters)
        code, data = packet.parameters[0], packet.parameters[1:]
        return f"{_error(code)} {self._block(packet.id, data)}".rstrip()

    def _together(self, raw: bytes) -> str:
        """Put the one answer of several servos into words: of each, ERR byte, id, data, CRC (but for the last)."""
        words, at = [], 0
        for id, (_, length) in self._asked.items():
            block = raw[at : at + 2 + length]
            if len(block) < 2 + length or block[1] != id:
                return raw.hex(" ")
            words.append(f"{id}: {_error(block[0])} {self._block(id, block[2:])}")
            at += 4 + length
        return ", ".join(words)

    def _block(self, id: int, data: bytes) -> str:
        address, length = self._asked.get(id, (-1, 0))
        if data and len(data) == length:
            return f"{self._place(address)} {self._value(address, data)}"
        return data.hex(" ")

    def _place(self, address: int) -> str:
        register = self._registers.get(address)
        return f"{register.name}({address})" if register else str(address)

    def _value(self, address: int, data: bytes) -> str:
        register = self._registers.get(address)
        if register and register.size == len(data):
            return str(int.from_bytes(data, "little", signed=register.signed))
        return data.hex(" ")


def _u16(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")


def _error(code: int) -> str:
    """Return an ERR byte in words."""
    error = code & ~ALERT
    words = "ok" if not error else f"error {Error(error).name.lower() if error in list(Error) else error}"
    return f"{words}, hardware alert" if code & ALERT else words


def _name(id: int) -> str:
    return "all" if id == BROADCAST else f"{id:3d}"
