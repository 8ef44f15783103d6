"""The foot sensor's frames (README.md), for MicroPython: one buffer, filled anew for every sample.

Runs on a Raspberry Pi Pico; CPython runs it too, for the tests.
"""

import struct
from array import array

PERIOD = 2000
"""Time between two frames [us]: 500 a second."""

SATURATED = 1
DISCONNECTED = 2


def _table():
    """CRC-16/CCITT-FALSE of every byte: 0x1021, most significant bit first."""
    table = array("H", [0] * 256)
    for byte in range(256):
        value = byte << 8
        for _ in range(8):
            value = (value << 1) ^ 0x1021 if value & 0x8000 else value << 1
        table[byte] = value & 0xFFFF
    return table


class Frames:
    """Builds frames.

    Attributes:
        sequence: Number of the next frame; the caller adds what was skipped.
    """

    def __init__(self):
        self.sequence = 0
        self._crc = _table()
        self._frame = bytearray(16)
        self._frame[0:3] = b"\xaa\x55\x0b"

    def build(self, time, millinewtons, status):
        """Return a frame, valid until the next call.

        Args:
            time: When it was sampled [us]; wraps at 2^32.
            millinewtons: Force; clipped to 32 bits.
            status: Bits SATURATED and DISCONNECTED.
        """
        frame, crc = self._frame, self._crc
        force = max(-0x80000000, min(0x7FFFFFFF, millinewtons))
        struct.pack_into("<HIiB", frame, 3, self.sequence & 0xFFFF, time & 0xFFFFFFFF, force, status)
        self.sequence += 1
        value = 0xFFFF
        for index in range(2, 14):
            value = (value << 8) & 0xFFFF ^ crc[value >> 8 ^ frame[index]]
        frame[14] = value & 0xFF
        frame[15] = value >> 8
        return frame
