from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.emulator.packet import HEADER, MAX_LENGTH, Parser, crc16, status

from .parts import Status, instruction, sdk_crc

BODIES = st.one_of(st.binary(max_size=40), st.lists(st.sampled_from([0xFF, 0xFD, 0x00]), max_size=40).map(bytes))


@pytest.mark.parametrize(
    ("raw", "id", "code", "parameters"),
    [
        ("FF FF FD 00 01 03 00 01 19 4E", 1, 0x01, ""),
        ("FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA", 0xFE, 0x82, "84 00 04 00 01 02"),
        ("FF FF FD 00 FE 03 00 01 31 42", 0xFE, 0x01, ""),
        ("FF FF FD 00 01 07 00 02 84 00 04 00 1D 15", 1, 0x02, "84 00 04 00"),
        ("FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89", 1, 0x03, "74 00 00 02 00 00"),
        ("FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E", 1, 0x04, "68 00 C8 00 00 00"),
        ("FF FF FD 00 01 03 00 05 02 CE", 1, 0x05, ""),
        ("FF FF FD 00 01 04 00 06 01 A1 E6", 1, 0x06, "01"),
        ("FF FF FD 00 01 03 00 08 2F 4E", 1, 0x08, ""),
        ("FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC", 1, 0x10, "01 44 58 4C 22"),
        (
            "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
            0xFE,
            0x83,
            "74 00 04 00 01 96 00 00 00 02 AA 00 00 00",
        ),
        (
            "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
            0xFE,
            0x92,
            "01 90 00 02 00 02 92 00 01 00",
        ),
        ("FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2", 0xFE, 0x8A, "84 00 04 00 03 07 04"),
    ],
)
def test_packets_printed_in_the_e_manual(raw: str, id: int, code: int, parameters: str) -> None:
    (packet,) = Parser().feed(bytes.fromhex(raw))
    assert (packet.id, packet.instruction, packet.parameters, packet.intact) == (
        id,
        code,
        bytes.fromhex(parameters),
        True,
    )


@pytest.mark.parametrize(
    ("raw", "id", "parameters"),
    [
        ("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D", 1, "06 04 26"),  # ping
        ("FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D", 2, "06 04 26"),
        ("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0", 1, "A6 00 00 00"),  # read
        ("FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE", 2, "1F 08 00 00"),  # sync read
        ("FF FF FD 00 01 06 00 55 00 77 00 C3 69", 1, "77 00"),  # bulk read
        ("FF FF FD 00 02 05 00 55 00 24 8B A9", 2, "24"),
        ("FF FF FD 00 01 04 00 55 00 A1 0C", 1, ""),  # write, reg write, action, factory reset, reboot, clear
    ],
)
def test_status_packets_printed_in_the_e_manual(raw: str, id: int, parameters: str) -> None:
    assert status(id, 0, bytes.fromhex(parameters)) == bytes.fromhex(raw)


@given(st.binary(max_size=200))
def test_crc_is_the_makers(data: bytes) -> None:
    assert crc16(data).to_bytes(2, "little") == sdk_crc(data)


@given(st.integers(0, 255), st.integers(0, 255), BODIES, st.data())
def test_any_packet_in_any_chunks(id: int, code: int, parameters: bytes, data: st.DataObject) -> None:
    raw = instruction(id, code, parameters)
    parser, found = Parser(), []
    while raw:
        size = data.draw(st.integers(1, len(raw)))
        found += parser.feed(raw[:size])
        raw = raw[size:]
    (packet,) = found
    assert (packet.id, packet.instruction, packet.parameters, packet.intact) == (id, code, parameters, True)
    assert parser.pending == 0
    assert parser.discarded == 0


@given(st.binary(max_size=60).filter(lambda noise: HEADER not in noise), BODIES)
def test_garbage_before_a_packet_is_thrown_away(noise: bytes, parameters: bytes) -> None:
    parser = Parser()
    (packet,) = parser.feed(noise + instruction(9, 0x02, parameters))[-1:]
    assert packet.intact
    assert packet.parameters == parameters
    assert packet.end == len(noise) + len(instruction(9, 0x02, parameters))


@given(st.lists(st.binary(max_size=30), max_size=20))
def test_no_bytes_break_it(chunks: list[bytes]) -> None:
    parser = Parser()
    for chunk in chunks:
        parser.feed(chunk)
        assert parser.pending <= MAX_LENGTH + 7


@given(st.integers(0, 255), st.integers(0, 255), BODIES)
def test_a_status_packet_is_read_back(id: int, error: int, parameters: bytes) -> None:
    assert Status.of(status(id, error, parameters)) == Status(id, error, parameters)


def test_a_damaged_packet_is_reported_and_the_next_one_found() -> None:
    damaged = bytearray(instruction(1, 0x02, b"\x84\x00\x04\x00"))
    damaged[9] ^= 0x10
    broken, whole = Parser().feed(bytes(damaged) + instruction(2, 0x01))
    assert not broken.intact
    assert (whole.id, whole.intact) == (2, True)


def test_a_packet_inside_one_with_a_damaged_length_is_found() -> None:
    damaged = bytearray(instruction(1, 0x02, b"\x84\x00\x04\x00"))
    damaged[5] = 30
    parser = Parser()
    found = parser.feed(bytes(damaged) + instruction(2, 0x01))
    assert found == []
    found = parser.feed(instruction(3, 0x01) + instruction(4, 0x01))
    assert [packet.id for packet in found if packet.intact] == [2, 3, 4]


def test_an_absurd_length_does_not_swallow_what_follows() -> None:
    (packet,) = Parser().feed(HEADER + b"\x01\xff\xff" + instruction(2, 0x01))
    assert packet.id == 2
