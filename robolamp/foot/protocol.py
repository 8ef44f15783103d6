"""The foot sensor's frames, as hardware/firmware/README.md specifies them: bytes in, frames out."""

from __future__ import annotations

import binascii
import struct
from dataclasses import dataclass

HEADER = b"\xaa\x55"
PAYLOAD = 11
"""Bytes of payload in this version, from sequence to status."""

FRAME = 16
"""Bytes of a frame."""

_BODY = struct.Struct("<BHIiB")  # length, sequence, time [us], force [mN], status
_SATURATED, _DISCONNECTED = 0x01, 0x02


@dataclass(frozen=True)
class Frame:
    """One sample of the foot sensor.

    Attributes:
        sequence: 0 to 65,535, +1 a frame, wraps.
        time: Microseconds since the microcontroller started, 0 to 2^32 - 1, wraps.
        force: Floor force, positive when the floor pushes up [N], to 0.001.
        saturated: The converter is at its end.
        disconnected: The sensor is not connected.
    """

    sequence: int
    time: int
    force: float
    saturated: bool = False
    disconnected: bool = False


def encode(frame: Frame) -> bytes:
    """Return a frame's 16 bytes.

    Raises:
        struct.error: A field is outside its range.
    """
    status = _SATURATED * frame.saturated | _DISCONNECTED * frame.disconnected
    body = _BODY.pack(PAYLOAD, frame.sequence, frame.time, round(frame.force * 1000), status)
    return HEADER + body + _crc(body).to_bytes(2, "little")


class Decoder:
    """Finds frames in a byte stream, however it is cut and whatever is between them.

    Attributes:
        frames: Good frames so far.
        discarded: Bytes thrown away because they belonged to no good frame.
        crc_errors: Frames whose CRC was wrong (chance headers in garbage included).
        lost: Frames that the sequence numbers say are missing.
        repeated: Frames that came twice in a row, byte for byte; they are handed out twice too.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.discarded = 0
        self.crc_errors = 0
        self.lost = 0
        self.repeated = 0
        self._buffer = bytearray()
        self._sequence: int | None = None
        self._last = b""

    def feed(self, data: bytes) -> list[Frame]:
        """Take received bytes.

        Returns:
            The frames they complete, oldest first.
        """
        buffer = self._buffer
        buffer += data
        found: list[Frame] = []
        start = 0  # of the bytes not yet judged
        while len(buffer) - start >= 3:
            header = buffer.find(HEADER, start)
            if header < 0:
                header = len(buffer) - (buffer[-1] == HEADER[0])  # its second byte may still come
            self.discarded += header - start
            start = header
            if len(buffer) - start < 3:
                break
            if buffer[start + 2] != PAYLOAD:
                start += 1
                self.discarded += 1
                continue
            if len(buffer) - start < FRAME:
                break
            body = bytes(buffer[start + 2 : start + FRAME - 2])
            if _crc(body) != int.from_bytes(buffer[start + FRAME - 2 : start + FRAME], "little"):
                self.crc_errors += 1
                start += 1
                self.discarded += 1
                continue
            found.append(self._frame(body))
            start += FRAME
        del buffer[:start]
        return found

    def _frame(self, body: bytes) -> Frame:
        _, sequence, time, force, status = _BODY.unpack(body)
        if body == self._last:
            self.repeated += 1
        elif self._sequence is not None:
            self.lost += (sequence - self._sequence - 1) % 65_536
        self._sequence, self._last = sequence, body
        self.frames += 1
        return Frame(sequence, time, force / 1000, bool(status & _SATURATED), bool(status & _DISCONNECTED))


def _crc(body: bytes) -> int:
    """CRC-16/CCITT-FALSE; binascii's is the same polynomial with the initial value as an argument."""
    return binascii.crc_hqx(body, 0xFFFF)
