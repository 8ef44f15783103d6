"""The line that servos share: bytes in, answers out, each at the moment its last byte would have arrived.

It holds no file descriptor and reads no clock: times are given to it. A byte takes ten bit times (start, 8 data, stop).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from robolamp.emulator.faults.injector import Injector
from robolamp.emulator.line.turns import answers
from robolamp.emulator.packet import Packet, Parser
from robolamp.emulator.packet import packet as framed
from robolamp.emulator.servo.servo import Servo

GAP = 0.0015
"""Silence inside a packet after which a servo throws it away [s] (e-manual "Response Policy")."""

BITS = 10
"""Bits of a byte on the line: start, 8 data, stop."""


class Reply(NamedTuple):
    """Bytes that servos send.

    Attributes:
        due: When the last of them has arrived [s].
        data: A status packet, or what damage left of it.
        byte: Time between two of them [s].
    """

    due: float
    data: bytes
    byte: float


class Line:
    """Servos on one half-duplex line.

    Args:
        servos: The servos.
        baud: The rate that the client's port is set to [1/s].
        advance: Called with each packet's end [s] before a servo sees it: brings the plant to that time.
        latency: Returns how late the next bytes reach the line [s]; None: never late.
        gap: Silence inside a packet that ends it [s]; infinite where the clock is too coarse to tell.
        injector: Damages packets and silences servos; None: nothing does.

    Attributes:
        baud: As given; may be changed at any time. A servo set to another rate hears noise.
        busy: Until when what was fed, and its answers, take; how late the bytes reached the line is not counted [s].
        unplugged: Indices of servos that are not connected.
    """

    def __init__(
        self,
        servos: Sequence[Servo],
        baud: int,
        advance: Callable[[float], None],
        latency: Callable[[], float] | None = None,
        gap: float = GAP,
        injector: Injector | None = None,
    ) -> None:
        self.baud = baud
        self.busy = -math.inf
        self.unplugged: set[int] = set()
        self._servos = servos
        self._advance = advance
        self._latency = latency
        self._gap = gap
        self._injector = injector
        self._parser = Parser()
        self._free = -math.inf

    def feed(self, data: bytes, time: float) -> list[Reply]:
        """Put bytes on the line and return what the servos answer, in the order of arrival.

        Args:
            data: Bytes that the client sends.
            time: When the first of them leaves the client [s].
        """
        latency = self._latency() if self._latency else 0.0
        begin = time + latency
        if self._parser.pending and self._cut_off(data, begin - self._free):
            self._parser.reset()
        begin = max(begin, self._free)
        byte = BITS / self.baud
        self._free = begin + len(data) * byte
        replies: list[Reply] = []
        late = 0.0  # what is held up holds up all that is behind it
        for packet in self._parser.feed(data):
            for delay, heard in self._damaged(packet, begin + packet.end * byte + late):
                late += delay
                end = begin + packet.end * byte + late
                self._free = max(self._free, end)
                replies += self._answered(heard, end, replies[-1].due if replies else end)
        if replies:
            self._free = max(self._free, replies[-1].due)
        self.busy = self._free - latency
        return [reply for reply in replies if reply.data]

    def _cut_off(self, data: bytes, silence: float) -> bool:
        """Whether an unfinished packet has ended with a silence [s]: it was too long, or a whole packet follows it."""
        return silence > self._gap or (silence > GAP and any(packet.intact for packet in Parser().feed(data)))

    def plug_next(self) -> int | None:
        """Plug in the first servo that is not connected; return its index, None where all are."""
        index = min(self.unplugged, default=None)
        self.unplugged.discard(-1 if index is None else index)
        return index

    def _answered(self, packet: Packet, end: float, free: float) -> list[Reply]:
        """Let the servos hear a packet; the first answer begins no earlier than the line is free [s]."""
        self._advance(end)
        byte = BITS / self.baud
        injector = self._injector
        listeners = [
            servo
            for index, servo in enumerate(self._servos)
            if servo.hears(self.baud, end)
            and index not in self.unplugged
            and not (injector and injector.silent(index, end))
        ]
        for servo in listeners:
            servo.heard(end)
        replies: list[Reply] = []
        ends = max(end, free)
        for silence, answer in answers(packet, listeners, end, byte):
            ends += silence + len(answer) * byte
            replies.append(Reply(ends, b"", byte))  # the turn passes, whatever arrives of the answer
            if answer:
                for delay, arriving in injector.packet("status", answer, ends) if injector else [(0.0, answer)]:
                    ends += delay
                    replies.append(Reply(ends, arriving, byte))
        return replies

    def _damaged(self, packet: Packet, end: float) -> Iterator[tuple[float, Packet]]:
        """Yield what the servos hear of a packet, each with how much later than it should [s]."""
        if self._injector is None or not packet.intact:
            yield 0.0, packet
            return
        raw = framed(packet.id, bytes([packet.instruction]) + packet.parameters)
        for delay, data in self._injector.packet("instruction", raw, end):
            if data == raw:
                yield delay, packet
                continue
            for remains in Parser().feed(data):
                yield delay, Packet(remains.id, remains.instruction, remains.parameters, packet.end, remains.intact)
