"""The foot sensor's reader: takes what has arrived, never waits, and knows how old its newest force is."""

from __future__ import annotations

import contextlib
import math
import os
import termios
from typing import Protocol

import serial

from robolamp.errors import BusError
from robolamp.foot.protocol import Decoder, Frame
from robolamp.ports import open_error, said_by
from robolamp.signals import Clock

_PORT_ERRORS = (OSError, termios.error)
_CHUNK = 4096  # bytes: what a pseudo-terminal or USB driver buffers; 0.5 s of frames
_MOST_CHUNKS = 8  # a line that babbles must not hold the loop
_DRIFT = 200e-6  # the two crystals together, each within 100 ppm
_WRAP = 2**32  # microseconds
_JUMP = 1.0  # s: a sensor clock that runs off the host's by more than this was restarted


class ByteSource(Protocol):
    """What the sensor needs of a port: pyserial's Serial with timeout 0, or an emulated line."""

    def read(self, size: int) -> bytes:
        """Return at most that many received bytes, without waiting."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


class _Line:
    """A serial port with a quick way to what has arrived: pyserial asks before and after each read."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._descriptor: int = port.fileno()

    def read(self, size: int) -> bytes:
        """Return at most that many received bytes, without waiting."""
        return os.read(self._descriptor, size) or self._port.read(size)  # nothing: pyserial tells whether it is gone

    def close(self) -> None:
        """Close it."""
        self._port.close()


class FootSensor:
    """The floor force under the foot.

    The age counts from when the force was sampled, not from when it was read: the sensor's clock is laid on the host's
    by the quickest frame so far (as long as the line's shortest delay stays the same, the age is short by that delay).

    Args:
        port: Device path, or an already open source of bytes.
        baud: Baud rate [1/s].
        clock: Measures ages.
        tare: What the sensor shows with the foot in the air [N].
        scale: Newtons a newton that it shows beyond that.

    Attributes:
        name: The port's path.
        decoder: Counts frames, damage and losses.
        gone: Whether the port went away since it was opened.
    """

    def __init__(
        self, port: str | ByteSource, baud: int, clock: Clock, *, tare: float = 0.0, scale: float = 1.0
    ) -> None:
        self.name = port if isinstance(port, str) else type(port).__name__
        self.decoder = Decoder()
        self.gone = False
        self._path = port if isinstance(port, str) else None
        self._given: ByteSource | None = None if isinstance(port, str) else port
        self._source = self._given
        self._baud = baud
        self._clock = clock
        self._tare = tare
        self._scale = scale
        self._newest: Frame | None = None
        self._sampled = -math.inf  # newest sample's time on the host's clock [s]
        self._sensor_time = 0.0  # the same on the sensor's clock, unwrapped [s]
        self._offset = math.inf  # host's clock minus sensor's [s]
        self._heard = -math.inf  # when a frame last arrived [s]

    def open(self) -> None:
        """Open the port and forget what it had stored.

        Raises:
            BusError: The port does not exist or may not be used.
        """
        if self._source is not None:
            return
        if self._path is None:
            self._source, self.gone = self._given, False
            return
        try:
            port = serial.Serial(self._path, self._baud, timeout=0, exclusive=True)
        except (*_PORT_ERRORS, ValueError) as error:
            raise open_error(self._path, error, "--foot-port, or foot.port in hardware/lamp.toml") from None
        with contextlib.suppress(*_PORT_ERRORS):
            port.reset_input_buffer()
        self._source, self.gone = _Line(port), False  # not before: where it cannot be opened yet, it is still gone

    def close(self) -> None:
        """Close the port; may be called twice."""
        if self._source is not None:
            with contextlib.suppress(*_PORT_ERRORS):
                self._source.close()
            self._source = None

    def poll(self) -> list[Frame]:
        """Take what has arrived.

        Returns:
            The new frames, oldest first.

        Raises:
            BusError: The port is not open, or gone.
        """
        if self._source is None:
            raise BusError("the port is not open", self.name)
        frames: list[Frame] = []
        try:
            for _ in range(_MOST_CHUNKS):
                data = self._source.read(_CHUNK)
                frames += self.decoder.feed(data)
                if len(data) < _CHUNK:
                    break
        except _PORT_ERRORS as error:
            self.gone = True
            raise BusError(f"the port is gone ({said_by(error)})", self.name) from None
        if frames:
            self._take(frames[-1], self._clock.now())
        return frames

    @property
    def newest(self) -> Frame | None:
        """The newest frame, or None before the first."""
        return self._newest

    @property
    def force(self) -> float:
        """The newest force, tared and scaled [N]; NaN before the first frame."""
        return math.nan if self._newest is None else self.newtons(self._newest)

    def newtons(self, frame: Frame) -> float:
        """Return a frame's force, tared and scaled [N]."""
        return (frame.force - self._tare) * self._scale

    @property
    def age(self) -> float:
        """Time since the newest force was sampled [s]; infinite before the first frame."""
        return max(0.0, self._clock.now() - self._sampled)

    def _take(self, frame: Frame, now: float) -> None:
        elapsed = now - self._heard
        step = 0.0 if self._newest is None else _forward(frame.time - self._newest.time) * 1e-6
        if self._newest is None or step < 0.0 or abs(step - elapsed) > _JUMP:
            self._sensor_time, self._offset = frame.time * 1e-6, now - frame.time * 1e-6
        else:
            self._sensor_time += step
            self._offset = min(now - self._sensor_time, self._offset + _DRIFT * elapsed)
        self._newest = frame
        self._heard = now
        self._sampled = self._sensor_time + self._offset


def _forward(microseconds: int) -> int:
    """Return a difference of two wrapping times as -2^31 .. 2^31 - 1 [us]."""
    return (microseconds + _WRAP // 2) % _WRAP - _WRAP // 2
