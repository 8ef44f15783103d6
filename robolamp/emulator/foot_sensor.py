"""The emulated foot sensor: frames as hardware/firmware/README.md specifies them. Shares no code with their reader."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Callable

HEADER = b"\xaa\x55"
"""Every frame begins with it."""

PERIOD = 0.002
"""Time between samples [s]: 500 Hz."""

FRAME_SIZE = 16
"""Bytes of a frame."""

_PAYLOAD = 11
_MILLINEWTONS = 1000
_MICROSECONDS = 1_000_000
_LARGEST = 2**31 - 1


def crc16_ccitt(data: bytes) -> int:
    """Return CRC-16/CCITT-FALSE: polynomial 0x1021, initial 0xFFFF, most significant bit first.

    Args:
        data: A frame from its length byte to its status byte.
    """
    return crc_hqx(data, 0xFFFF)  # the same polynomial


def frame(sequence: int, time: float, force: float) -> bytes:
    """Return one frame.

    Args:
        sequence: Number of the frame; wraps at 65,536.
        time: When it was sampled, since the sensor started [s].
        force: As the sensor reads it, positive when the floor pushes up [N].
    """
    millinewtons = round(force * _MILLINEWTONS)
    saturated = not -_LARGEST <= millinewtons <= _LARGEST
    body = (
        bytes([_PAYLOAD])
        + (sequence & 0xFFFF).to_bytes(2, "little")
        + (round(time * _MICROSECONDS) & 0xFFFFFFFF).to_bytes(4, "little")
        + max(-_LARGEST, min(_LARGEST, millinewtons)).to_bytes(4, "little", signed=True)
        + bytes([saturated])
    )
    return HEADER + body + crc16_ccitt(body).to_bytes(2, "little")


class FootSensor:
    """Samples the floor's force at 500 Hz.

    Args:
        gain: Reading per true force.
        noise: Returns the next reading's error [N].

    Attributes:
        stuck: Whether it repeats its last reading.
    """

    def __init__(self, gain: float, noise: Callable[[], float]) -> None:
        self.stuck = False
        self._gain = gain
        self._noise = noise
        self._sequence = 0
        self._reading = 0.0

    def sample(self, force: float, time: float) -> list[tuple[float, bytes]]:
        """Return the frames that are due by now, each with its moment of sampling [s].

        Args:
            force: True force now [N].
            time: Now, since the sensor started [s].
        """
        frames = []
        while self._sequence * PERIOD <= time:
            moment = self._sequence * PERIOD
            if not self.stuck:
                self._reading = force * self._gain + self._noise()
            frames.append((moment, frame(self._sequence, moment, self._reading)))
            self._sequence += 1
        return frames
