"""The one packet that several servos answer Fast Sync Read with, taken apart as it comes in.

    FF FF FD 00 | FE | LEN | 55 | ERR ID data CRC | ERR ID data CRC | ...

It is not stuffed; each block's CRC covers everything before it, the CRCs of earlier blocks included
(https://emanual.robotis.com/docs/en/dxl/protocol2/#fast-sync-read-0x8a).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

from robolamp.dynamixel.status_packet import Status


class FastReply:
    """A reply on its way: a block counts as soon as its own CRC is right.

    Args:
        servos: Their ids, in the order of the blocks.
        length: Data bytes of each.
        crc: Continues a CRC: (value, bytes, count) to value.

    Attributes:
        found: The good blocks so far, by id.
        complete: Whether nothing more can come: every block is there, or one was damaged.
    """

    HEAD: ClassVar[int] = 8
    """Bytes before the first block."""

    def __init__(self, servos: Sequence[int], length: int, crc: Callable[[int, bytes, int], int]) -> None:
        self.found: dict[int, Status] = {}
        self.complete = not servos
        self._servos = tuple(servos)
        self._length = length
        self._crc = crc
        size = 1 + len(self._servos) * self.block(length)
        self._head = b"\xff\xff\xfd\x00\xfe" + size.to_bytes(2, "little") + b"\x55"
        self._buffer = bytearray()
        self._value = 0
        self._at = -1  # start of the next block in the buffer; -1 until the head is found

    @staticmethod
    def block(length: int) -> int:
        """Return the bytes of a block: ERR, ID, data, CRC."""
        return 4 + length

    @property
    def expected(self) -> int:
        """How many bytes complete the packet, at least one: a port may wait for all that it is asked for."""
        left = len(self._servos) - len(self.found)
        return max(1, max(self._at, self.HEAD) + left * self.block(self._length) - len(self._buffer))

    def feed(self, data: bytes) -> None:
        """Take received bytes; what precedes the head is noise."""
        self._buffer += data
        if self._at < 0 and not self._begin():
            return
        block = self.block(self._length)
        while not self.complete and len(self._buffer) >= self._at + block:
            body = bytes(self._buffer[self._at : self._at + block - 2])
            check = bytes(self._buffer[self._at + block - 2 : self._at + block])
            self._value = self._crc(self._value, body, len(body))
            servo = self._servos[len(self.found)]
            if self._value != int.from_bytes(check, "little") or body[1] != servo:
                self.complete = True  # the CRCs of all later blocks cover the damage
                return
            self.found[servo] = Status(body[0], body[2:])
            self._value = self._crc(self._value, check, len(check))
            self._at += block
            self.complete = len(self.found) == len(self._servos)

    def _begin(self) -> bool:
        start = self._buffer.find(self._head)
        del self._buffer[: start if start >= 0 else max(0, len(self._buffer) - self.HEAD + 1)]
        if start < 0:
            return False
        self._value = self._crc(0, self._head, self.HEAD)
        self._at = self.HEAD
        return True
