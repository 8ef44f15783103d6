"""The traffic on the servo port in words, a line a packet: `robolamp emulate --traffic`."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from robolamp.dynamixel.registers import Model, Register
from robolamp.emulator.packet import ALERT, BROADCAST, Error, Instruction, Packet, Parser

_ADDRESSED = frozenset({0x02, 0x03, 0x04, 0x82, 0x83, 0x8A})
"""Instructions whose parameters begin with an address: read, write, reg write, sync read and write, fast sync read."""

_READS = frozenset({0x02, 0x82, 0x8A})
_SYNC_WRITE = 0x83


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
        self._asked = (-1, 0)  # address and length of the last read

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
        if code not in _ADDRESSED or len(parameters) < 2:
            return f"{name} {parameters.hex(' ')}".rstrip()
        address, rest = int.from_bytes(parameters[:2], "little"), parameters[2:]
        if code in _READS:
            length = int.from_bytes(rest[:2], "little")
            self._asked = (address, length)
            servos = f" of {', '.join(map(str, rest[2:]))}" if rest[2:] else ""
            return f"{name} {self._place(address)}, {length} bytes{servos}"
        if code == _SYNC_WRITE:
            step = int.from_bytes(rest[:2], "little") + 1
            blocks = [rest[start : start + step] for start in range(2, len(rest), step)]
            values = ", ".join(f"{block[0]}: {self._value(address, block[1:])}" for block in blocks)
            return f"{name} {self._place(address)} {values}"
        return f"{name} {self._place(address)} {self._value(address, rest)}"

    def _status(self, packet: Packet) -> str:
        if not packet.intact or not packet.parameters:
            return "damaged answer"
        code, data = packet.parameters[0], packet.parameters[1:]
        error = code & ~ALERT
        words = "ok" if not error else f"error {Error(error).name.lower() if error in list(Error) else error}"
        if code & ALERT:
            words += ", hardware alert"
        if data and len(data) == self._asked[1]:
            return f"{words} {self._place(self._asked[0])} {self._value(self._asked[0], data)}"
        return f"{words} {data.hex(' ')}".rstrip()

    def _place(self, address: int) -> str:
        register = self._registers.get(address)
        return f"{register.name}({address})" if register else str(address)

    def _value(self, address: int, data: bytes) -> str:
        register = self._registers.get(address)
        if register and register.size == len(data):
            return str(int.from_bytes(data, "little", signed=register.signed))
        return data.hex(" ")


def _name(id: int) -> str:
    return "all" if id == BROADCAST else f"{id:3d}"
