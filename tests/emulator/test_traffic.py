"""Packets in words: what a person reads with `--traffic`."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.dynamixel.registers import MODELS
from robolamp.emulator.line.traffic import Traffic

from .parts import Bench, instruction, u16


def told(*packets: bytes) -> list[str]:
    """What is said of packets to servos 1 and 2, and of their answers."""
    bench, lines = Bench(ids=(1, 2)), list[str]()
    traffic = Traffic([MODELS["XL330-M288-T"]], lines.append)
    for number, packet in enumerate(packets):
        traffic.sent(packet, number)
        for reply in bench.line.feed(packet, number):
            traffic.answered(reply.data, reply.due)
    return [" ".join(line.split()[1:]) for line in lines]


@pytest.mark.parametrize(
    ("packet", "words"),
    [
        (
            instruction(0xFE, 0x82, u16(132) + u16(4) + b"\1\2"),
            [
                "> all sync read Present Position(132), 4 bytes of 1, 2",
                "< 1 ok Present Position(132) 1956",
                "< 2 ok Present Position(132) 1956",
            ],
        ),
        (
            instruction(0xFE, 0x8A, u16(132) + u16(4) + b"\2\1"),
            [
                "> all fast sync read Present Position(132), 4 bytes of 2, 1",
                "< all 2: ok Present Position(132) 1956, 1: ok Present Position(132) 1956",
            ],
        ),
        (
            instruction(0xFE, 0x92, b"\1" + u16(84) + u16(2) + b"\2" + u16(7) + u16(1)),
            [
                "> all bulk read Position P Gain(84), 2 bytes of 1; ID(7), 1 bytes of 2",
                "< 1 ok Position P Gain(84) 400",
                "< 2 ok ID(7) 2",
            ],
        ),
        (
            instruction(0xFE, 0x9A, b"\1" + u16(84) + u16(2) + b"\2" + u16(7) + u16(1)),
            [
                "> all fast bulk read Position P Gain(84), 2 bytes of 1; ID(7), 1 bytes of 2",
                "< all 1: ok Position P Gain(84) 400, 2: ok ID(7) 2",
            ],
        ),
        (
            instruction(0xFE, 0x93, b"\1" + u16(84) + u16(2) + u16(500) + b"\2" + u16(65) + u16(1) + b"\1"),
            ["> all bulk write 1: Position P Gain(84) 500, 2: LED(65) 1"],
        ),
        (
            instruction(0xFE, 0x83, u16(84) + u16(2) + b"\1" + u16(7) + b"\2" + u16(9)),
            ["> all sync write Position P Gain(84) 1: 7, 2: 9"],
        ),
        (instruction(1, 0x20, b"\x01CTRL"), ["> 1 backup 01 43 54 52 4c", "< 1 ok"]),
    ],
)
def test_instructions_to_several_servos_and_their_answers(packet: bytes, words: list[str]) -> None:
    assert told(packet) == words


@given(code=st.integers(0, 255), id=st.sampled_from([1, 2, 0xFE]), parameters=st.binary(max_size=40))
def test_it_says_something_of_everything(code: int, id: int, parameters: bytes) -> None:
    assert told(instruction(id, code, parameters))[0].startswith("> ")
