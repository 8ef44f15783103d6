"""Servos that answer at once."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robolamp.dynamixel.registers import MODELS, Name
from robolamp.emulator.line.collision import collide
from robolamp.emulator.line.line import Line
from robolamp.emulator.servo.servo import Sensed, Servo

from .parts import Status, instruction, read, u16

BYTE = 1e-5


def line(*servos: tuple[int, float, int]) -> Line:
    """Servos of (id, shaft angle, return delay)."""

    def sensed(angle: float) -> Sensed:
        return Sensed(angle=angle, velocity=0.0, current=0.0, duty=0.0, voltage=5.0, temperature=30.0)

    return Line(
        [
            Servo(
                MODELS["XL330-M288-T"],
                {Name.BAUD_RATE: 3, Name.ID: id, Name.RETURN_DELAY_TIME: delay},
                lambda _, angle=angle: sensed(angle),
            )
            for id, angle, delay in servos
        ],
        1_000_000,
        lambda _: None,
    )


def test_two_servos_with_one_id_garble_different_answers() -> None:
    (reply,) = line((1, 1.0, 0), (1, 2.0, 0)).feed(read(1, 132, 4), 0.0)
    with pytest.raises(AssertionError):
        Status.of(reply.data)
    low = int(1.0 * 4096 / 6.2832) & int(2.0 * 4096 / 6.2832)
    assert int.from_bytes(reply.data[9:13], "little") == pytest.approx(low, abs=8)


def test_two_servos_that_say_the_same_are_heard_as_one() -> None:
    (reply,) = line((1, 1.0, 0), (1, 1.0, 0)).feed(read(1, 132, 4), 0.0)
    assert Status.of(reply.data).error == 0


def test_a_later_servo_is_heard_whole() -> None:
    replies = line((1, 1.0, 0), (1, 2.0, 250)).feed(read(1, 132, 4), 0.0)
    first, second = (Status.of(reply.data) for reply in replies)
    assert first.data != second.data
    assert replies[1].due - replies[0].due == pytest.approx(500e-6)


@pytest.mark.parametrize("code", [0x82, 0x8A])
def test_a_sync_read_is_garbled_where_two_have_one_id(code: int) -> None:
    servos = line((1, 1.0, 0), (2, 1.0, 0), (2, 2.5, 0), (3, 1.0, 0))
    replies = servos.feed(instruction(0xFE, code, u16(132) + u16(4) + b"\1\2\3"), 0.0)
    sane = []
    for reply in replies:
        try:
            sane.append(Status.of(reply.data).id)
        except AssertionError:
            continue
    assert sane == ([1, 3] if code == 0x82 else [])


def test_both_obey_a_write() -> None:
    servos = line((1, 1.0, 0), (1, 1.0, 0))
    servos.feed(instruction(0xFE, 0x83, u16(65) + u16(1) + b"\1\1"), 0.0)
    (reply,) = servos.feed(read(1, 65, 1), 0.01)
    assert Status.of(reply.data).data == b"\1"


@given(
    answers=st.lists(st.tuples(st.floats(0.0, 1e-3), st.binary(min_size=1, max_size=20)), min_size=1, max_size=4),
)
@example(answers=[(1e-5, b"\x01"), (2e-6, b"\x00")])  # the tail of the later byte falls like a start bit
def test_what_is_heard_ends_within_a_byte_of_the_last_who_speaks(answers: list[tuple[float, bytes]]) -> None:
    heard = collide(answers, BYTE)
    assert heard
    assert all(silence >= 0.0 for silence, _ in heard)
    end = sum(silence + len(data) * BYTE for silence, data in heard)
    assert end <= max(at + len(data) * BYTE for at, data in answers) + BYTE


@given(data=st.binary(min_size=1, max_size=30), times=st.integers(1, 3))
def test_identical_answers_come_through(data: bytes, times: int) -> None:
    assert collide([(1e-4, data)] * times, BYTE) == [(1e-4, data)]
