"""Emulated servos in real time, behind pseudo-terminals: what `robolamp emulate` runs, in a process of its own.

One thread, one select loop: bytes in, physics up to the present, answers out when the wire would have delivered them.
"""

from __future__ import annotations

import math
import select
import sys
import time
from collections.abc import Callable
from heapq import heappop, heappush
from pathlib import Path

from robolamp.emulator.foot_sensor import FRAME_SIZE
from robolamp.emulator.line.line import BITS
from robolamp.emulator.line.traffic import Traffic
from robolamp.emulator.ports.emulated import Emulated
from robolamp.emulator.ports.pseudo_terminal import PseudoTerminal
from robolamp.lateness import Lateness

REAL_TIME_GAP = 0.05
"""Silence inside a packet that ends it, on a pseudo-terminal [s]: a servo's 1.5 ms drown in the scheduler's jitter."""

CATCH_UP = 1.0
"""Longest time that physics makes up for after the process was held up [s]; the rest is skipped."""

_PIECE = 62  # bytes: a long answer arrives as it goes, in pieces like those of a USB adapter (FTDI: 64 less 2)
_SPIN = 0.00015  # s: a sleeper is woken 0.05 to 0.1 ms late, the time of ten bytes; answers wait awake that long

_AHEAD = 0.005
"""How far bytes are taken from the client ahead of what the line has carried [s]: long enough for a packet, short
enough that a flood of them keeps nothing else waiting. The rest stays in the terminal, as in an adapter's buffer."""

_LATE = 0.05  # longest time that waiting bytes are reckoned to have gone on leaving while the process was held up [s]
_MOST = 4096  # bytes taken at a time

_UNREAD = 125 * FRAME_SIZE  # a sensor keeps no frames for a client that does not read: 0.25 s of them at most
_SWITCH_INTERVAL = 0.0005  # longest time that the truth log's thread keeps the interpreter from the line [s]


class Process:
    """What is emulated, on its ports.

    Args:
        world: The lamp or the servos, at time 0.
        start: The monotonic clock at the world's time 0 [s].
        skipped: Called with the time [s] by which the world's clock was stopped when the process was held up.
        links: A folder for links "servo" and "foot" to the ports, which survive that a port is unplugged.
        foot: Whether there is a foot sensor.
        traffic: Told of every packet.

    Attributes:
        servo_port: What a Dynamixel client opens.
        foot_port: What a reader of the foot sensor opens; None without one.
        late: When the host let the ports be served late, on the monotonic clock.

    Raises:
        FileError: A link cannot be made.
    """

    def __init__(
        self,
        world: Emulated,
        start: float,
        skipped: Callable[[float], None] | None = None,
        *,
        links: Path | None = None,
        foot: bool = True,
        traffic: Traffic | None = None,
    ) -> None:
        self._world = world
        self._start = start
        self._skipped = skipped
        self._traffic = traffic
        self._bus = PseudoTerminal(links / "servo" if links else None)
        try:
            self._foot = PseudoTerminal(links / "foot" if links else None) if foot else None
        except BaseException:
            self._bus.close()
            raise
        self._due: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._waiting = False  # whether the client had written more than was taken
        self.servo_port = self._bus.name
        self.foot_port = self._foot.name if self._foot else None
        self.late = Lateness()

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
        if self._foot:
            self._foot.close()

    def _now(self) -> float:
        return time.monotonic() - self._start

    def _turn(self) -> None:
        """Wait for bytes or for the next thing that is due, and do it."""
        world = self._world
        wake = world.time + world.timestep
        answer = self._due[0][0] if self._due else math.inf
        room = world.line.busy - _AHEAD  # when the line takes more
        listening = [self._bus.descriptor] if self._bus.descriptor >= 0 and room < self._now() else []
        if not listening and self._bus.descriptor >= 0:
            wake = min(wake, room)
        ready, _, _ = select.select(listening, [], [], max(0.0, min(wake, answer - _SPIN) - self._now()))
        now = self._now()
        while answer - _SPIN < now < answer:
            now = self._now()
        while self._due and self._due[0][0] <= now:  # before anything that takes time
            self._bus.write(heappop(self._due)[2])
        self.late.note(self._start + wake, self._start + now)
        behind = now - world.time
        if behind > CATCH_UP:
            self._start += behind
            if self._skipped:
                self._skipped(behind)
            now = world.time
        if ready:
            self._hear(now)
        world.advance_to(now)
        self._plug(now)
        frames = world.frames(now)
        if frames and self._foot and self._foot.descriptor >= 0:
            if self._foot.unread >= _UNREAD:
                self._foot.forget()
            self._foot.write(frames)

    def _plug(self, now: float) -> None:
        """Unplug the ports that a fault script unplugs by now [s], and plug them in again."""
        for port, name in ((self._bus, "servo"), (self._foot, "foot")):
            if port is not None:
                if self._world.injector.unplugged(name, now):
                    port.unplug()
                else:
                    port.plug()

    def _hear(self, now: float) -> None:
        baud, busy = self._bus.baud, self._world.line.busy
        # What has waited left the client without a pause, as soon as what was before it.
        time = min(max(busy, now - _LATE), now) if self._waiting else now
        most = min(max(int((now + _AHEAD - max(busy, time)) * baud / BITS), 1), _MOST) if baud else _MOST
        data = self._bus.read(most)
        self._waiting = len(data) == most
        if data and baud:
            self._world.line.baud = baud
            if self._traffic:
                self._traffic.sent(data, time)
            before = -math.inf
            for reply in self._world.receive(data, time):
                for begin in range(0, len(reply.data), _PIECE):
                    piece = reply.data[begin : begin + _PIECE]
                    left = len(reply.data) - begin - len(piece)
                    self._count += 1
                    heappush(self._due, (max(reply.due - left * reply.byte, before), self._count, piece))
                before = reply.due  # a packet that comes twice comes after itself
                if self._traffic:
                    self._traffic.answered(reply.data, reply.due)
