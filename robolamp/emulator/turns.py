"""Whose turn it is: what servos on one line answer to an instruction, in order, with the silences between.

From the e-manual's protocol 2.0 page (https://emanual.robotis.com/docs/en/dxl/protocol2/).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from robolamp.emulator.packet import BROADCAST, Error, Instruction, Packet, fast_status, status
from robolamp.emulator.servo import Servo
from robolamp.emulator.table import Refused

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
        for servo in listeners:
            if servo.id == packet.id:
                yield servo.return_delay, status(servo.id, servo.alert(Error.CRC))
    elif packet.instruction in _TO_ALL and packet.id == BROADCAST:
        present = {servo.id: servo for servo in listeners}
        if packet.instruction in _READS:
            yield from _in_turn(_asked(packet), present, time, byte)
        elif packet.instruction in _FAST_READS:
            yield from _together(_asked(packet), present, time)
        else:
            _write_each(packet, present, time)
    elif packet.id == BROADCAST:
        for servo in sorted(listeners, key=lambda servo: servo.id):
            answer = servo.answer(packet.instruction, packet.parameters, time, broadcast=True)
            if packet.instruction == Instruction.PING and answer:
                yield servo.return_delay, status(servo.id, *answer)
    else:
        for servo in listeners:
            id, delay = servo.id, servo.return_delay  # a written id or delay is in force from the next packet
            if id == packet.id:
                answer = servo.answer(packet.instruction, packet.parameters, time)
                if answer:
                    yield delay, status(id, *answer)
            elif servo.shadow_id == packet.id and packet.instruction in (Instruction.WRITE, Instruction.REG_WRITE):
                servo.answer(packet.instruction, packet.parameters, time)


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
    asked: Sequence[tuple[int, int, int]], present: Mapping[int, Servo], time: float, byte: float
) -> Iterator[tuple[float, bytes]]:
    """Each servo answers after the one named before it; the turn of one that is absent passes in silence."""
    for id, address, size in asked:
        servo = present.get(id)
        if servo is None:
            yield (_STATUS_SIZE + size) * byte, b""
        elif servo.level:
            data, error = _read(servo, address, size, time)
            yield servo.return_delay, status(id, servo.alert(error), data)


def _together(
    asked: Sequence[tuple[int, int, int]], present: Mapping[int, Servo], time: float
) -> Iterator[tuple[float, bytes]]:
    """One packet for all: each block follows the one before, so that nothing follows a servo that is absent."""
    blocks = []
    for id, address, size in asked:
        servo = present.get(id)
        if servo is None or not servo.level:
            break
        data, error = _read(servo, address, size, time)
        blocks.append((id, servo.alert(error), data.ljust(size, b"\0")))  # a refused block keeps its length
    if blocks:
        yield present[blocks[0][0]].return_delay, fast_status([size for _, _, size in asked], blocks)


def _write_each(packet: Packet, present: Mapping[int, Servo], time: float) -> None:
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
        servo = present.get(id)
        if servo is not None:
            try:
                servo.write(address, data, time)
            except Refused:
                continue
