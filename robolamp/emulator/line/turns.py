"""Turns on the line: what the servos answer to an instruction, in order, with the silences between.

From the e-manual's protocol 2.0 page (https://emanual.robotis.com/docs/en/dxl/protocol2/).
"""

from __future__ import annotations

import contextlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from robolamp.emulator.line.collision import collide
from robolamp.emulator.packet import BROADCAST, Error, Instruction, Packet, fast_status, fits, status
from robolamp.emulator.servo.control_table import Refused
from robolamp.emulator.servo.servo import Servo

_STATUS_SIZE = 11  # header, id, length, INST, ERR, CRC
_READS = (Instruction.SYNC_READ, Instruction.BULK_READ)
_FAST_READS = (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
_WRITES = (Instruction.SYNC_WRITE, Instruction.BULK_WRITE)
_TO_ALL = (*_READS, *_FAST_READS, *_WRITES)


def answers(packet: Packet, listeners: Sequence[Servo], time: float, byte: float) -> Iterator[tuple[float, bytes]]:
    """Carry out an instruction and yield each answer with the silence before it [s]; an empty one is silence alone.

    Args:
        packet: What was heard.
        listeners: The servos that heard it.
        time: When it was complete [s].
        byte: Time of a byte on the line [s]: the turn of an absent servo lasts as long as its answer would.
    """
    if packet.instruction == Instruction.STATUS:
        return
    if not packet.intact:
        refusals = [
            (servo.return_delay, status(servo.id, servo.alert(Error.CRC)))
            for servo in listeners
            if servo.id == packet.id
        ]
        yield from collide(refusals, byte)
    elif packet.instruction in _TO_ALL and packet.id == BROADCAST:
        present = _by_id(listeners)
        if packet.instruction in _READS:
            yield from _in_turn(_asked(packet), present, time, byte)
        elif packet.instruction in _FAST_READS:
            yield from _together(_asked(packet), present, time, byte)
        else:
            _write_each(packet, present, time)
    elif packet.id == BROADCAST:
        for id, servos in sorted(_by_id(listeners).items()):
            spoken: list[tuple[float, bytes]] = []
            for servo in servos:
                answer = servo.answer(packet.instruction, packet.parameters, time, broadcast=True)
                if packet.instruction == Instruction.PING and answer:
                    spoken.append((servo.return_delay, status(id, *answer)))
            yield from collide(spoken, byte)
    else:
        spoken = []
        for servo in listeners:
            id, delay = servo.id, servo.return_delay  # a written id or delay is in force from the next packet
            if id == packet.id:
                answer = servo.answer(packet.instruction, packet.parameters, time)
                if answer:
                    spoken.append((delay, status(id, *answer)))
            elif servo.shadow_id == packet.id and packet.instruction in (Instruction.WRITE, Instruction.REG_WRITE):
                servo.answer(packet.instruction, packet.parameters, time)
        yield from collide(spoken, byte)


def _by_id(servos: Sequence[Servo]) -> dict[int, list[Servo]]:
    """Return servos by id; several may have the same."""
    found: dict[int, list[Servo]] = defaultdict(list)
    for servo in servos:
        found[servo.id].append(servo)
    return dict(found)


def _asked(packet: Packet) -> list[tuple[int, int, int]]:
    """Return id, address and size of each read that a sync or bulk read asks for; nothing where it is malformed."""
    raw = packet.parameters
    if packet.instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        if len(raw) < 5:
            return []
        address, size = _u16(raw, 0), _u16(raw, 2)
        return [(id, address, size) for id in raw[4:]]
    if len(raw) % 5:
        return []
    return [(raw[i], _u16(raw, i + 1), _u16(raw, i + 3)) for i in range(0, len(raw), 5)]


def _u16(raw: bytes, at: int) -> int:
    return int.from_bytes(raw[at : at + 2], "little")


def _read(servo: Servo, address: int, size: int, time: float) -> tuple[bytes, Error]:
    try:
        return servo.read(address, size, time), Error.NONE
    except Refused as refusal:
        return b"", refusal.error


def _in_turn(
    asked: Sequence[tuple[int, int, int]], present: Mapping[int, Sequence[Servo]], time: float, byte: float
) -> Iterator[tuple[float, bytes]]:
    """Each servo answers after the one named before it; the turn of one that is absent passes in silence."""
    for id, address, size in asked:
        if id not in present:
            yield (_STATUS_SIZE + size) * byte, b""
            continue
        spoken = []
        for servo in present[id]:
            if servo.level:
                data, error = _read(servo, address, size, time)
                spoken.append((servo.return_delay, status(id, servo.alert(error), data)))
        yield from collide(spoken, byte)


def _together(
    asked: Sequence[tuple[int, int, int]], present: Mapping[int, Sequence[Servo]], time: float, byte: float
) -> Iterator[tuple[float, bytes]]:
    """One packet for all: each block follows the one before, so that nothing follows a servo that is absent.

    Servos with one id write their blocks over each other: what is heard is as if each had written a packet of its own.
    Nobody answers where more is asked for than a packet's LEN can say.
    """
    if not fits([size for _, _, size in asked]):
        return
    rivals = max((len(present.get(id, ())) for id, _, _ in asked), default=0)
    spoken: list[tuple[float, bytes]] = []
    for rival in range(rivals):
        blocks: list[tuple[int, int, bytes]] = []
        delay = 0.0
        for id, address, size in asked:
            servos = present.get(id, ())
            servo = servos[min(rival, len(servos) - 1)] if servos else None
            if servo is None or not servo.level:
                break
            delay = delay if blocks else servo.return_delay
            data, error = _read(servo, address, size, time)
            blocks.append((id, servo.alert(error), data.ljust(size, b"\0")))  # a refused block keeps its length
        if blocks:
            spoken.append((delay, fast_status([size for _, _, size in asked], blocks)))
    yield from collide(spoken, byte)


def _write_each(packet: Packet, present: Mapping[int, Sequence[Servo]], time: float) -> None:
    """Each named servo takes its own bytes; none answers, not even to refuse. A malformed packet does nothing."""
    raw = packet.parameters
    writes: list[tuple[int, int, bytes]] = []
    if packet.instruction == Instruction.SYNC_WRITE:
        if len(raw) < 4:
            return
        address, size, at = _u16(raw, 0), _u16(raw, 2), 4
        if (len(raw) - at) % (size + 1):
            return
        writes = [(raw[i], address, raw[i + 1 : i + 1 + size]) for i in range(at, len(raw), size + 1)]
    else:
        at = 0
        while at < len(raw):
            end = at + 5 + _u16(raw, at + 3)
            if at + 5 > len(raw) or end > len(raw):
                return
            writes.append((raw[at], _u16(raw, at + 1), raw[at + 5 : end]))
            at = end
    for id, address, data in writes:
        for servo in present.get(id, ()):
            with contextlib.suppress(Refused):
                servo.write(address, data, time)
