"""Lockstep: emulated servos and foot sensor in the client's own process, in a time that passes as the client waits.

The ports are objects like dynamixel-sdk's PortHandler and pyserial's Serial; the bytes, the codec, the servos and the
physics are those behind the pseudo-terminals. A client's own computing takes no time, so that a run repeats exactly
and faster than real time. Byte times, return delays and the 1.5 ms gap are exact.
"""

from __future__ import annotations

import errno
import math
import os
from collections import deque
from collections.abc import Sequence
from itertools import pairwise

from robolamp.emulator.line.line import BITS
from robolamp.emulator.ports.emulated import Emulated

_LATENCY_TIMER = 16.0  # ms: what dynamixel-sdk's PortHandler reckons with
_SLACK = 1e-12  # s: times that differ by rounding are the same


class LockstepClock:
    """A clock that stands until somebody waits on it; the emulated world moves with it.

    Args:
        world: What moves.
    """

    def __init__(self, world: Emulated) -> None:
        self._world = world
        self._time = 0.0

    def now(self) -> float:
        """Return the time since the start [s]."""
        return self._time

    def sleep_until(self, time: float) -> None:
        """Let time pass up to a moment, at once where it has passed.

        Args:
            time: On this clock [s].
        """
        if time > self._time:
            self._time = time
            self._world.advance_to(time)


class LockstepPort:
    """The servo port: what dynamixel-sdk's packet handlers and group reads need of a PortHandler.

    Args:
        world: What is behind it.
        clock: Its clock.
        baud: Rate of the port [1/s].

    Attributes:
        is_open: Whether it is open.
        is_using: Set by the SDK while an instruction waits for its answer.
        baudrate: Rate of the port [1/s].
    """

    def __init__(self, world: Emulated, clock: LockstepClock, baud: int) -> None:
        self.is_open = False
        self.is_using = False
        self.baudrate = baud
        self._world = world
        self._clock = clock
        self._arriving: deque[tuple[float, int]] = deque()  # when [s], which byte
        self._since = 0.0
        self._timeout = 0.0

    def openPort(self) -> bool:
        """Open it; False while it is unplugged."""
        self.is_open = not self._world.injector.unplugged("servo", self._clock.now())
        self._arriving.clear()
        return self.is_open

    def closePort(self) -> None:
        """Close it."""
        self.is_open = False

    def setBaudRate(self, baudrate: int) -> bool:
        """Set the port's rate [1/s] and open it, as the SDK does."""
        self.baudrate = baudrate
        return self.openPort()

    def getBaudRate(self) -> int:
        """Return the port's rate [1/s]."""
        return self.baudrate

    def getPortName(self) -> str:
        """Return what to call it."""
        return "lockstep"

    def clearPort(self) -> None:
        """Throw away what has arrived and was not read."""
        self._check()
        while self._arriving and self._arriving[0][0] <= self._clock.now() + _SLACK:
            self._arriving.popleft()

    def getBytesAvailable(self) -> int:
        """Return how many bytes have arrived and were not read."""
        self._check()
        return sum(when <= self._clock.now() + _SLACK for when, _ in self._arriving)

    def readPort(self, length: int) -> bytes:
        """Return that many bytes, or what has come when the packet timeout is over; time passes until then.

        Args:
            length: How many.

        Raises:
            OSError: The port is unplugged.
        """
        self._check()
        end = self._since + self._timeout
        if length:
            whole = self._arriving[length - 1][0] if len(self._arriving) >= length else end
            self._clock.sleep_until(min(whole, end))
            self._check()
        data = bytearray()
        while self._arriving and len(data) < length and self._arriving[0][0] <= self._clock.now() + _SLACK:
            data.append(self._arriving.popleft()[1])
        return bytes(data)

    def writePort(self, packet: Sequence[int]) -> int:
        """Send bytes; they leave one after another while the caller goes on.

        Args:
            packet: The bytes.

        Returns:
            How many.

        Raises:
            OSError: The port is unplugged.
        """
        self._check()
        data = bytes(packet)
        self._world.line.baud = self.baudrate
        before = -math.inf
        for reply in self._world.receive(data, self._clock.now()):
            # A packet that comes twice comes after itself; one that is late is overtaken by those of later questions.
            first = max(reply.due - (len(reply.data) - 1) * reply.byte, before)
            self._arriving.extend((first + index * reply.byte, value) for index, value in enumerate(reply.data))
            before = first + (len(reply.data) - 1) * reply.byte
        if any(later < earlier for (earlier, _), (later, _) in pairwise(self._arriving)):
            self._arriving = deque(sorted(self._arriving, key=lambda byte: byte[0]))
        return len(data)

    def setPacketTimeout(self, packet_length: int) -> None:
        """Start waiting for that many bytes, with the SDK's own allowance: its latency timer twice, and 2 ms."""
        self.setPacketTimeoutMillis(packet_length * BITS * 1000.0 / self.baudrate + _LATENCY_TIMER * 2.0 + 2.0)

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start waiting for an answer [ms]."""
        self._since = self._clock.now()
        self._timeout = msec / 1000.0

    def isPacketTimeout(self) -> bool:
        """Whether that time is over."""
        return self._clock.now() >= self._since + self._timeout - _SLACK

    def getCurrentTime(self) -> float:
        """Return the time [ms]."""
        return self._clock.now() * 1000.0

    def getTimeSinceStart(self) -> float:
        """Return the time since the wait began [ms]."""
        return (self._clock.now() - self._since) * 1000.0

    def _check(self) -> None:
        if self._world.injector.unplugged("servo", self._clock.now()):
            self.is_open = False
            raise OSError(errno.EIO, os.strerror(errno.EIO))


class LockstepFoot:
    """The foot sensor's port: what a reader needs of pyserial's Serial with timeout 0.

    Args:
        world: What is behind it.
        clock: Its clock.
    """

    def __init__(self, world: Emulated, clock: LockstepClock) -> None:
        self._world = world
        self._clock = clock
        self._buffer = bytearray()

    def read(self, size: int) -> bytes:
        """Return at most that many received bytes, without waiting.

        Raises:
            OSError: The port is unplugged.
        """
        if self._world.injector.unplugged("foot", self._clock.now()):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        self._buffer += self._world.frames(self._clock.now())
        data = bytes(self._buffer[:size])
        del self._buffer[:size]
        return data

    def close(self) -> None:
        """Close it: what was not read is gone."""
        self._buffer.clear()


class Lockstep:
    """An emulated lamp (or bare servos) with ports and clock for a client in the same process.

    Args:
        world: What is emulated, at its time 0.
        baud: Rate that the servo port starts with [1/s].

    Attributes:
        clock: What the client must wait on.
        servo_port: The servo bus.
        foot_port: The foot sensor.
    """

    def __init__(self, world: Emulated, baud: int) -> None:
        self.clock = LockstepClock(world)
        self.servo_port = LockstepPort(world, self.clock, baud)
        self.foot_port = LockstepFoot(world, self.clock)
