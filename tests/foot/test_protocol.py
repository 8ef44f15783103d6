from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.foot.protocol import FRAME, Decoder, Frame, encode

frames = st.builds(
    Frame,
    sequence=st.integers(0, 65_535),
    time=st.integers(0, 2**32 - 1),
    force=st.integers(-(2**31), 2**31 - 1).map(lambda millinewtons: millinewtons / 1000),
    saturated=st.booleans(),
    disconnected=st.booleans(),
)


def crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE, bit by bit."""
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return value


def fed(decoder: Decoder, data: bytes, cuts: list[int]) -> list[Frame]:
    """Feed data cut at those places."""
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [frame for a, b in pairwise(places) for frame in decoder.feed(data[a:b])]


def test_the_specifications_example() -> None:
    body = bytes.fromhex("0B 01 00 D0 07 00 00 0C 08 00 00 00")
    assert crc(b"123456789") == 0x29B1
    raw = b"\xaa\x55" + body + crc(body).to_bytes(2, "little")
    assert encode(Frame(1, 2000, 2.060)) == raw
    assert Decoder().feed(raw) == [Frame(1, 2000, 2.060)]
    assert len(raw) == FRAME


def test_status_bits_and_negative_force() -> None:
    body = struct.pack("<BHIiB", 11, 7, 1, -1500, 3)
    raw = b"\xaa\x55" + body + crc(body).to_bytes(2, "little")
    assert Decoder().feed(raw) == [Frame(7, 1, -1.5, saturated=True, disconnected=True)]


@given(sent=st.lists(frames, max_size=20), cuts=st.lists(st.integers(0, 400)))
def test_frames_survive_any_cutting(sent: list[Frame], cuts: list[int]) -> None:
    decoder = Decoder()
    assert fed(decoder, b"".join(map(encode, sent)), cuts) == sent
    assert (decoder.frames, decoder.discarded, decoder.crc_errors) == (len(sent), 0, 0)


@given(
    sent=st.lists(st.tuples(frames, st.binary(max_size=30)), max_size=12),
    cuts=st.lists(st.integers(0, 600)),
)
def test_garbage_between_frames_costs_no_frame(sent: list[tuple[Frame, bytes]], cuts: list[int]) -> None:
    """Garbage is skipped byte by byte, so it can hide no frame that follows it, unless it is a frame's beginning."""
    stream = b"".join(garbage + encode(frame) for frame, garbage in sent) + bytes(FRAME)
    decoder = Decoder()
    found = fed(decoder, stream, cuts)
    assert found == [frame for frame, _ in sent]
    assert decoder.discarded + FRAME * decoder.frames >= len(stream) - 2


@given(
    sent=st.lists(frames, min_size=1, max_size=10, unique_by=lambda frame: frame.sequence),
    flips=st.lists(st.tuples(st.integers(0, 200), st.integers(1, 255)), max_size=4),
    cuts=st.lists(st.integers(0, 200)),
)
def test_corruption_costs_what_it_hits(sent: list[Frame], flips: list[tuple[int, int]], cuts: list[int]) -> None:
    stream = bytearray(b"".join(map(encode, sent)))
    hit = set()
    for place, flip in flips:
        stream[place % len(stream)] ^= flip
        hit.add(place % len(stream) // FRAME)
    decoder = Decoder()
    found = fed(decoder, bytes(stream) + bytes(FRAME), cuts)
    intact = [frame for index, frame in enumerate(sent) if index not in hit]
    assert [frame for frame in found if frame in intact] == intact
    assert len(found) <= len(sent)


@given(data=st.binary(max_size=500), cuts=st.lists(st.integers(0, 500)))
def test_any_bytes_are_survived_and_counted(data: bytes, cuts: list[int]) -> None:
    decoder = Decoder()
    found = fed(decoder, data, cuts)
    kept = len(data) - decoder.discarded - FRAME * len(found)
    assert 0 <= kept < FRAME


def test_a_header_inside_a_damaged_frame_may_be_a_real_one() -> None:
    good = Frame(5, 10, 1.0)
    decoder = Decoder()
    assert decoder.feed(b"\xaa\x55\x0b\x00" + encode(good) + bytes(8)) == [good]
    assert (decoder.crc_errors, decoder.discarded) == (1, 4 + 8)


@pytest.mark.parametrize(("first", "second", "lost"), [(1, 2, 0), (1, 5, 3), (65_534, 1, 2), (65_535, 0, 0)])
def test_lost_frames_are_counted_over_the_wrap(first: int, second: int, lost: int) -> None:
    decoder = Decoder()
    decoder.feed(encode(Frame(first, 0, 0.0)) + encode(Frame(second, 0, 0.0)))
    assert decoder.lost == lost


def test_a_frame_that_comes_twice_is_no_loss() -> None:
    decoder = Decoder()
    frames = [encode(Frame(sequence, sequence * 2000, 1.0)) for sequence in (7, 7, 8, 10)]
    decoder.feed(b"".join(frames))
    assert (decoder.frames, decoder.repeated, decoder.lost) == (4, 1, 1)
