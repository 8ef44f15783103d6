"""An emulated lamp in real time, behind two pseudo-terminals: what `robolamp emulate` runs, in a process of its own.

One thread, one select loop: bytes in, physics up to the present, answers out when the wire would have delivered them.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import struct
import sys
import termios
import time
import tty
from collections.abc import Callable
from heapq import heappop, heappush

from robolamp.emulator.foot import FRAME_SIZE
from robolamp.emulator.lamp import EmulatedLamp

REAL_TIME_GAP = 0.05
"""Silence inside a packet that ends it, on a pseudo-terminal [s]: a servo's 1.5 ms drown in the scheduler's jitter."""

CATCH_UP = 1.0
"""Longest time that physics makes up for after the process was held up [s]; the rest is skipped."""

_UNREAD = 125 * FRAME_SIZE  # a sensor keeps no frames for a client that does not read: 0.25 s of them at most
_SWITCH_INTERVAL = 0.0005  # longest time that the truth log's thread keeps the interpreter from the line [s]
_BAUD_OF_SPEED = {
    getattr(termios, f"B{rate}"): rate
    for rate in (9600, 57600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
    if hasattr(termios, f"B{rate}")
}


class PseudoTerminal:
    """One end of a pseudo-terminal in raw mode; the other has a name that a client opens like a serial port.

    Attributes:
        name: The client's end, as "/dev/pts/3".
        descriptor: Our end, not blocking.
    """

    def __init__(self) -> None:
        self.descriptor, self._client = os.openpty()  # the client's end stays open, or its first close would be our EIO
        tty.setraw(self._client)
        os.set_blocking(self.descriptor, False)
        self.name = os.ttyname(self._client)

    @property
    def baud(self) -> int:
        """The rate that the client set [1/s]; 0 for one that no servo has."""
        return _BAUD_OF_SPEED.get(termios.tcgetattr(self._client)[5], 0)

    @property
    def unread(self) -> int:
        """Bytes that the client has not read yet."""
        return struct.unpack("i", fcntl.ioctl(self._client, termios.FIONREAD, b"\0" * 4))[0]

    def forget(self) -> None:
        """Throw away what the client has not read."""
        termios.tcflush(self._client, termios.TCIFLUSH)

    def read(self) -> bytes:
        """Return what the client has written."""
        try:
            return os.read(self.descriptor, 4096)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Send to the client; what its buffer cannot take is lost, as on a line that nobody reads."""
        with contextlib.suppress(BlockingIOError):
            os.write(self.descriptor, data)

    def close(self) -> None:
        """Close both ends."""
        os.close(self.descriptor)
        os.close(self._client)


class Process:
    """The emulated lamp on its two ports.

    Args:
        lamp: The lamp, at its time 0.
        start: The monotonic clock at the lamp's time 0 [s].
        skipped: Called with the time [s] by which the lamp's clock was stopped when the process was held up.

    Attributes:
        servo_port: What a Dynamixel client opens.
        foot_port: What a reader of the foot sensor opens.
    """

    def __init__(self, lamp: EmulatedLamp, start: float, skipped: Callable[[float], None] | None = None) -> None:
        self._lamp = lamp
        self._start = start
        self._skipped = skipped
        self._bus = PseudoTerminal()
        self._foot = PseudoTerminal()
        self._due: list[tuple[float, int, bytes]] = []
        self._count = 0
        self.servo_port = self._bus.name
        self.foot_port = self._foot.name

    def run(self, stop: Callable[[], bool]) -> None:
        """Serve until told to stop.

        Args:
            stop: Asked at least every physics step.
        """
        interval = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH_INTERVAL)
        try:
            while not stop():
                self._turn()
        finally:
            sys.setswitchinterval(interval)

    def close(self) -> None:
        """Close the ports."""
        self._bus.close()
        self._foot.close()

    def _now(self) -> float:
        return time.monotonic() - self._start

    def _turn(self) -> None:
        """Wait for bytes or for the next thing that is due, and do it."""
        lamp = self._lamp
        wake = lamp.time + lamp.plant.timestep
        if self._due:
            wake = min(wake, self._due[0][0])
        ready, _, _ = select.select([self._bus.descriptor], [], [], max(0.0, wake - self._now()))
        now = self._now()
        behind = now - lamp.time
        if behind > CATCH_UP:
            self._start += behind
            if self._skipped:
                self._skipped(behind)
            now = lamp.time
        if ready:
            self._hear(now)
        lamp.advance_to(now)
        while self._due and self._due[0][0] <= now:
            self._bus.write(heappop(self._due)[2])
        frames = lamp.frames(now)
        if frames:
            if self._foot.unread >= _UNREAD:
                self._foot.forget()
            self._foot.write(frames)

    def _hear(self, now: float) -> None:
        data, baud = self._bus.read(), self._bus.baud
        if data and baud:
            self._lamp.line.baud = baud
            for reply in self._lamp.receive(data, now):
                self._count += 1
                heappush(self._due, (reply.due, self._count, reply.data))
