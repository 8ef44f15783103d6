"""The line that servos share: bytes in, answers out, each at the moment its last byte would have arrived.

It holds no file descriptor and reads no clock: times are given to it. A byte takes ten bit times (start, 8 data, stop).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from robolamp.emulator.packet import BROADCAST, Error, Instruction, Packet, Parser, status
from robolamp.emulator.servo import Servo
from robolamp.emulator.table import Refused

GAP = 0.0015
"""Silence inside a packet after which a servo throws it away [s] (e-manual "Response Policy")."""

_BITS = 10
_STATUS_SIZE = 11  # header, id, length, INST, ERR, CRC


class Reply(NamedTuple):
    """Bytes that servos send.

    Attributes:
        due: When the last of them has arrived [s].
        data: A status packet.
    """

    due: float
    data: bytes


class Line:
    """Servos on one half-duplex line.

    Args:
        servos: The servos.
        baud: The rate that the client's port is set to [1/s].
        advance: Called with each packet's end [s] before a servo sees it: brings the plant to that time.
        latency: Returns how late the next bytes reach the line [s]; None: never late.
        gap: Silence inside a packet that ends it [s]; infinite where the clock is too coarse to tell.

    Attributes:
        baud: As given; may be changed at any time. A servo set to another rate hears noise.
    """

    def __init__(
        self,
        servos: Sequence[Servo],
        baud: int,
        advance: Callable[[float], None],
        latency: Callable[[], float] | None = None,
        gap: float = GAP,
    ) -> None:
        self.baud = baud
        self._servos = servos
        self._advance = advance
        self._latency = latency
        self._gap = gap
        self._parser = Parser()
        self._free = -math.inf

    def feed(self, data: bytes, time: float) -> list[Reply]:
        """Put bytes on the line and return what the servos answer, in the order of arrival.

        Args:
            data: Bytes that the client sends.
            time: When the first of them leaves the client [s].
        """
        begin = time + (self._latency() if self._latency else 0.0)
        if self._parser.pending and begin - self._free > self._gap:
            self._parser.reset()
        begin = max(begin, self._free)
        byte = _BITS / self.baud
        self._free = begin + len(data) * byte
        replies: list[Reply] = []
        for packet in self._parser.feed(data):
            end = begin + packet.end * byte
            self._advance(end)
            listeners = [servo for servo in self._servos if servo.hears(self.baud, end)]
            for servo in listeners:
                servo.heard(end)
            for delay, answer in self._answers(packet, listeners, end):
                begins = max(end if not replies else replies[-1].due, end) + delay
                replies.append(Reply(begins + len(answer) * byte, answer))
        if replies:
            self._free = max(self._free, replies[-1].due)
        return [reply for reply in replies if reply.data]

    def _answers(self, packet: Packet, listeners: Sequence[Servo], time: float) -> Iterator[tuple[float, bytes]]:
        """Yield each answer with the silence before it [s]; an empty one is a silence alone."""
        if packet.instruction == Instruction.STATUS:
            return
        if not packet.intact:
            for servo in listeners:
                if servo.id == packet.id:
                    yield servo.return_delay, status(servo.id, servo.alert(Error.CRC))
        elif packet.instruction == Instruction.SYNC_READ and packet.id == BROADCAST:
            yield from self._sync_read(packet.parameters, listeners, time)
        elif packet.instruction == Instruction.SYNC_WRITE and packet.id == BROADCAST:
            self._sync_write(packet.parameters, listeners)
        elif packet.id == BROADCAST:
            for servo in sorted(listeners, key=lambda servo: servo.id):
                answer = servo.answer(packet.instruction, packet.parameters, time)
                if packet.instruction == Instruction.PING and answer:
                    yield servo.return_delay, status(servo.id, *answer)
        else:
            for servo in listeners:
                id, delay = servo.id, servo.return_delay  # a written id or delay is in force from the next packet
                if id == packet.id:
                    answer = servo.answer(packet.instruction, packet.parameters, time)
                    if answer:
                        yield delay, status(id, *answer)
                elif servo.shadow_id == packet.id and packet.instruction == Instruction.WRITE:
                    servo.answer(packet.instruction, packet.parameters, time)

    def _sync_read(self, parameters: bytes, listeners: Sequence[Servo], time: float) -> Iterator[tuple[float, bytes]]:
        """Each servo answers after the one named before it; the turn of one that is absent passes in silence."""
        if len(parameters) < 5:
            return
        address, size = (int.from_bytes(parameters[i : i + 2], "little") for i in (0, 2))
        present = {servo.id: servo for servo in listeners}
        for id in parameters[4:]:
            servo = present.get(id)
            if servo is None:
                yield (_STATUS_SIZE + size) * _BITS / self.baud, b""
                continue
            try:
                data, error = servo.read(address, size, time), Error.NONE
            except Refused as refusal:
                data, error = b"", refusal.error
            if servo.level:
                yield servo.return_delay, status(id, servo.alert(error), data)

    def _sync_write(self, parameters: bytes, listeners: Sequence[Servo]) -> None:
        """Each named servo takes its own bytes; none answers, not even to refuse."""
        if len(parameters) < 4:
            return
        address, size = (int.from_bytes(parameters[i : i + 2], "little") for i in (0, 2))
        blocks = parameters[4:]
        if len(blocks) % (size + 1):
            return
        present = {servo.id: servo for servo in listeners}
        for start in range(0, len(blocks), size + 1):
            servo = present.get(blocks[start])
            if servo is not None:
                try:
                    servo.write(address, blocks[start + 1 : start + 1 + size])
                except Refused:
                    continue
