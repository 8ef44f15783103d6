"""Dynamixel protocol 2.0 framing, servo side: instruction packets from a byte stream, status packets into one.

Written from the e-manual (https://emanual.robotis.com/docs/en/dxl/protocol2/) and shared with no driver:

    FF FF FD 00 | ID | LEN_L LEN_H | INST | parameters | CRC_L CRC_H      instruction, LEN = parameters + 3
    FF FF FD 00 | ID | LEN_L LEN_H | 55 | ERR | parameters | CRC_L CRC_H  status, LEN = parameters + 4
    FF FF FD 00 | FE | LEN_L LEN_H | 55 | [ERR | ID | data | CRC_L CRC_H] x n  status of a fast read, not stuffed

`FF FF FD` inside INST to parameters is sent as `FF FF FD FD`; LEN and CRC are computed after that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

HEADER = b"\xff\xff\xfd\x00"
"""Every packet begins with it (e-manual "Header", "Reserved")."""

BROADCAST = 0xFE
"""The id that every servo obeys and, but for a ping, none answers (e-manual "Packet ID")."""

MAX_LENGTH = 4096
"""Largest LEN taken for a packet's; more is a damaged length. Ours: the e-manual states no limit."""

_CHECKS = 8 * MAX_LENGTH
"""Bytes of damaged packets that are looked through once more for packets inside them, without an intact one between:
else a stream made of headers would take as many checks of its bytes as it has headers."""

_FIXED = 7  # header, id and length
_MIN_LENGTH = 3  # instruction and CRC
_RUN = b"\xff\xff\xfd"


class Instruction(IntEnum):
    """Instructions that the emulator knows (e-manual "Instruction")."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    BACKUP = 0x20
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error(IntEnum):
    """Low seven bits of a status packet's ERR byte (e-manual "Error"); bit 7 is the hardware alert."""

    NONE = 0
    RESULT = 1
    INSTRUCTION = 2
    CRC = 3
    RANGE = 4
    LENGTH = 5
    LIMIT = 6
    ACCESS = 7


ALERT = 0x80
"""ERR bit that every reply carries while a hardware error lasts."""


@dataclass(frozen=True, slots=True)
class Packet:
    """An instruction packet as it came off the line.

    Attributes:
        id: Whom it is for; 254 for all.
        instruction: The INST byte, known or not.
        parameters: Parameters, unstuffed.
        end: How many bytes of the chunk given to `Parser.feed` had gone by when it was complete.
        intact: Whether its CRC was right.
    """

    id: int
    instruction: int
    parameters: bytes
    end: int
    intact: bool = True


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        value = byte << 8
        for _ in range(8):
            value = (value << 1) ^ 0x8005 if value & 0x8000 else value << 1
        table.append(value & 0xFFFF)
    return tuple(table)


_TABLE = _crc_table()


def crc16(data: bytes, before: int = 0) -> int:
    """Return protocol 2.0's CRC: polynomial 0x8005, initial 0, most significant bit first (e-manual "CRC").

    Args:
        data: The packet from its header to its last parameter.
        before: CRC of what precedes `data`, to go on from.
    """
    value = before
    for byte in data:
        value = ((value << 8) & 0xFFFF) ^ _TABLE[(value >> 8) ^ byte]
    return value


def stuff(body: bytes) -> bytes:
    """Return INST to parameters with `FF FF FD` made `FF FF FD FD` (e-manual "Byte Stuffing")."""
    return body.replace(_RUN, _RUN + b"\xfd")


def unstuff(body: bytes) -> bytes:
    """Return what `stuff` was given."""
    return body.replace(_RUN + b"\xfd", _RUN)


def packet(id: int, body: bytes) -> bytes:
    """Return a whole packet.

    Args:
        id: The packet's id.
        body: INST to parameters, unstuffed.
    """
    stuffed = stuff(body)
    data = HEADER + bytes([id]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return data + crc16(data).to_bytes(2, "little")


def status(id: int, error: int, parameters: bytes = b"") -> bytes:
    """Return a status packet.

    Args:
        id: The servo that answers.
        error: ERR byte: an Error, with ALERT while a hardware error lasts.
        parameters: What was asked for.
    """
    return packet(id, bytes([Instruction.STATUS, error]) + parameters)


def fits(sizes: Sequence[int]) -> bool:
    """Return whether the answer to a fast read can be one packet: LEN has two bytes.

    Args:
        sizes: Bytes asked of each servo.
    """
    return _fast_length(sizes) <= 0xFFFF


def _fast_length(sizes: Sequence[int]) -> int:
    return 1 + sum(size + 4 for size in sizes)


def fast_status(sizes: Sequence[int], blocks: Sequence[tuple[int, int, bytes]]) -> bytes:
    """Return the one packet that servos write together in answer to a fast read (e-manual "Fast Sync Read").

    Each servo appends its block and the CRC of all bytes so far, earlier CRCs included; nothing is stuffed. LEN counts
    everyone who was asked, so that a packet whose chain broke off is cut short.

    Args:
        sizes: Bytes asked of each servo.
        blocks: Id, ERR byte and data of each servo that answers, from the first on.
    """
    length = _fast_length(sizes).to_bytes(2, "little")
    data = bytearray(HEADER + bytes([BROADCAST]) + length + bytes([Instruction.STATUS]))
    crc = crc16(bytes(data))
    for id, error, values in blocks:
        block = bytes([error, id]) + values
        sent = crc16(block, crc).to_bytes(2, "little")
        data += block + sent
        crc = crc16(block + sent, crc)
    return bytes(data)


class Parser:
    """Finds packets in a stream of bytes that may begin anywhere and hold anything.

    A packet with a wrong CRC is handed out as not intact; then only its header is thrown away, because a header inside
    a damaged packet may be a real one. Where that went wrong many times in a row, the whole packet goes.

    Attributes:
        discarded: Bytes that belonged to no packet so far.
    """

    def __init__(self) -> None:
        self.discarded = 0
        self._buffer = bytearray()
        self._damaged = 0  # bytes of damaged packets since an intact one

    @property
    def pending(self) -> int:
        """Bytes of a packet that is not complete yet."""
        return len(self._buffer)

    def reset(self) -> None:
        """Throw away an unfinished packet, as a servo does after a gap in the stream."""
        self._discard(len(self._buffer))

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that these bytes complete, in order.

        Args:
            data: The next bytes of the stream, any number.
        """
        start = -len(self._buffer)
        self._buffer += data
        found: list[Packet] = []
        while True:
            skip = self._buffer.find(HEADER)
            if skip < 0:
                skip = self._without_header()
                self._discard(skip)
                return found
            self._discard(skip)
            start += skip
            if len(self._buffer) < _FIXED:
                return found
            length = int.from_bytes(self._buffer[5:7], "little")
            if not _MIN_LENGTH <= length <= MAX_LENGTH:
                self._discard(len(HEADER))
                start += len(HEADER)
                continue
            total = _FIXED + length
            if len(self._buffer) < total:
                return found
            raw = bytes(self._buffer[:total])
            body = unstuff(raw[_FIXED:-2])
            intact = crc16(raw[:-2]) == int.from_bytes(raw[-2:], "little")
            found.append(Packet(raw[4], body[0], body[1:], max(start + total, 0), intact))
            if intact:
                self._damaged = 0
                del self._buffer[:total]
                start += total
                continue
            self._damaged += total
            lost = len(HEADER) if self._damaged <= _CHECKS else total
            if lost == total:
                self._damaged = 0
            self._discard(lost)
            start += lost

    def _without_header(self) -> int:
        """Return how many bytes can be no part of a header yet to be completed."""
        for keep in range(min(len(HEADER) - 1, len(self._buffer)), 0, -1):
            if self._buffer.endswith(HEADER[:keep]):
                return len(self._buffer) - keep
        return len(self._buffer)

    def _discard(self, count: int) -> None:
        self.discarded += count
        del self._buffer[:count]
