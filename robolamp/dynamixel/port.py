"""The port under the bus: what dynamixel-sdk needs of one, and the SDK's serial port on our clock."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
from collections.abc import Sequence
from typing import Any, Literal, Protocol

import serial
from dynamixel_sdk import PortHandler

from robolamp.signals import Clock

_MOST_BYTES = 1024  # more than all answers to one instruction: a line that babbles must not hold the loop
_WRITE_TIMEOUT = 0.05  # s: a port that takes no bytes any more
_BITS = 10.0  # of a byte: 8 data, start, stop
_SPIN = 0.0002  # s, before and after bytes are due: a sleeper is woken 0.05 to 0.1 ms late, the time of ten bytes


def line_time(count: float, baud: int) -> float:
    """Return how long bytes are on a line [s].

    Args:
        count: How many.
        baud: Of the line [1/s].
    """
    return count * _BITS / baud


class Port(Protocol):
    """What the SDK's packet handler needs of a port: the SDK's own PortHandler, or an emulated line."""

    is_using: bool

    def openPort(self) -> bool:
        """Open it."""
        ...

    def closePort(self) -> None:
        """Close it."""
        ...

    def setBaudRate(self, baudrate: int) -> bool:
        """Set its rate [1/s]; return whether it has it."""
        ...

    def getBytesAvailable(self) -> int:
        """Return how many bytes were received and not read."""
        ...

    def clearPort(self) -> None:
        """Throw away what was received and not read."""
        ...

    def readPort(self, length: int) -> bytes:
        """Return at most that many received bytes."""
        ...

    def writePort(self, packet: Sequence[int]) -> int:
        """Send bytes; return how many."""
        ...

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start waiting for an answer [ms]."""
        ...

    def isPacketTimeout(self) -> bool:
        """Whether that time is over."""
        ...


class SerialPort(PortHandler):
    """The SDK's serial port, on our clock, sleeping while it waits instead of polling, but for the moment of arrival.

    Args:
        path: Device path.
        baud: Baud rate [1/s].
        clock: Measures timeouts; the SDK's own use of the wall clock breaks when that is set.

    Attributes:
        low_latency: Whether its driver was told not to wait for more bytes before it hands over some.
    """

    ser: Any  # serial.Serial once open

    def __init__(self, path: str, baud: int, clock: Clock) -> None:
        super().__init__(path)
        self.baudrate = baud
        self._clock = clock
        self._received = 0
        self._quiet = -math.inf  # when all that was sent has left, by the line's rate, or the last byte came [s]
        self.low_latency = False

    def setupPort(self, cflag_baud: int) -> Literal[True]:
        """Open the device for this program alone, with the shortest latency its driver has."""
        if self.is_open:
            self.closePort()
        # Locked before anything of it is changed: another program may be driving a lamp through it.
        self.ser = serial.Serial(self.port_name, self.baudrate, timeout=0, write_timeout=_WRITE_TIMEOUT, exclusive=True)
        self.is_open = True
        self.ser.reset_input_buffer()
        self.tx_time_per_byte = line_time(1, self.baudrate) * 1000.0  # ms, as the SDK has it
        with contextlib.suppress(Exception):  # FTDI: latency timer 16 ms -> 1 ms; other drivers do not know it
            self.ser.set_low_latency_mode(True)
            self.low_latency = True
        return True

    def getCurrentTime(self) -> float:
        """Return the time [ms]."""
        return self._clock.now() * 1000.0

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start waiting for an answer [ms]."""
        self._received = 0
        super().setPacketTimeoutMillis(msec)

    def writePort(self, packet: Sequence[int]) -> int:
        """Send bytes; return how many."""
        data = bytes(packet)
        try:
            written = os.write(self.ser.fileno(), data)
        except BlockingIOError:
            written = 0
        if written < len(data):  # its buffer is full: wait, as pyserial does
            written += self.ser.write(data[written:])
        self._quiet = max(self._quiet, self._clock.now()) + written * self.tx_time_per_byte / 1000.0
        return written

    def readPort(self, length: int) -> bytes:
        """Return received bytes, waiting until there are some or the packet timeout is over."""
        if self._received >= _MOST_BYTES or not self._arrived(length):
            return b""
        data = os.read(self.ser.fileno(), length)
        if not data:
            raise OSError(errno.EIO, os.strerror(errno.EIO))  # readable and empty: the device went away
        self._received += len(data)
        self._quiet = self._clock.now()
        return data

    def _arrived(self, length: int) -> bool:
        """Wait for the first of so many bytes: asleep, but awake around the time when the last of them is due."""
        device = [self.ser.fileno()]
        due = self._quiet + length * self.tx_time_per_byte / 1000.0
        now = self._clock.now()
        end = now + max(self.packet_timeout - self.getTimeSinceStart(), 0.0) / 1000.0
        if select.select(device, [], [], max(min(due - _SPIN, end) - now, 0.0))[0]:
            return True
        while self._clock.now() < min(due + _SPIN, end):
            if select.select(device, [], [], 0.0)[0]:
                return True
        return bool(select.select(device, [], [], max(end - self._clock.now(), 0.0))[0])
