"""What a client receives when several servos answer at once: a bit is low if any of them pulls the line low.

Servos with one id answer together. Each byte is ten bits: a start bit (low), eight data bits, the least significant
first, and a stop bit (high); the line rests high. The receiver waits for the line to fall, samples each bit in its
middle and takes what it finds for a byte, as a UART does. Servos that say the very same at the very same time are heard
as one.
"""

from __future__ import annotations

from collections.abc import Sequence

_BITS = 10
_SAMPLES = 4  # a bit; servos' clocks agree to a quarter of one
_FRAME = _BITS * _SAMPLES


def collide(answers: Sequence[tuple[float, bytes]], byte: float) -> list[tuple[float, bytes]]:
    """Return what a client receives of the answers to one instruction.

    Args:
        answers: Of each servo, how long after the instruction it begins [s], and its bytes.
        byte: Time of a byte on the line [s].

    Returns:
        Runs of bytes and the silence before each [s], as `turns.answers` yields them; those that touch nobody are left
        as they are.
    """
    if len(answers) < 2:
        return list(answers)
    heard: list[tuple[float, bytes]] = []
    over = 0.0  # when the line was free again
    for group in _overlapping(sorted(answers, key=lambda answer: answer[0]), byte):
        begin = group[0][0]
        data = group[0][1] if len(group) == 1 else _garbled([(at - begin, raw) for at, raw in group], byte)
        heard.append((max(begin - over, 0.0), data))
        over = begin + len(data) * byte
    return heard


def _overlapping(answers: Sequence[tuple[float, bytes]], byte: float) -> list[list[tuple[float, bytes]]]:
    """Return answers in groups that share the line at some moment."""
    groups: list[list[tuple[float, bytes]]] = []
    until = 0.0
    for begin, data in answers:
        if groups and begin < until:
            groups[-1].append((begin, data))
        else:
            groups.append([(begin, data)])
        until = max(until, begin + len(data) * byte)
    return groups


def _garbled(answers: Sequence[tuple[float, bytes]], byte: float) -> bytes:
    """Return the bytes that a receiver makes of overlapping answers."""
    starts = [round(begin / byte * _FRAME) for begin, _ in answers]
    high = bytearray(b"\1") * (max(at + len(data) * _FRAME for at, (_, data) in zip(starts, answers, strict=True)))
    for start, (_, data) in zip(starts, answers, strict=True):
        for index, value in enumerate(data):
            for bit, level in enumerate([0, *(value >> bit & 1 for bit in range(8))]):
                if not level:
                    at = start + index * _FRAME + bit * _SAMPLES
                    high[at : at + _SAMPLES] = bytes(_SAMPLES)
    heard = bytearray()
    at = high.find(0)
    while at >= 0:
        middles = [at + bit * _SAMPLES + _SAMPLES // 2 for bit in range(1, 9)]
        heard.append(sum((high[m] if m < len(high) else 1) << bit for bit, m in enumerate(middles)))
        stop = at + 9 * _SAMPLES + _SAMPLES // 2
        while stop < len(high) and not high[stop]:  # no stop bit: it waits for the line to rise
            stop += 1
        at = high.find(0, stop)
    return bytes(heard)
