from __future__ import annotations

import pytest

from robolamp.dynamixel.registers import Name
from robolamp.emulator.line.line import Line

from .parts import Bench, Status, instruction, read, u16, write

BYTE = 10 / 1_000_000


def test_an_answer_arrives_after_both_packets_and_the_return_delay() -> None:
    bench = Bench(eeprom={Name.RETURN_DELAY_TIME: 250})
    request = read(1, 132, 4)
    (reply,) = bench.line.feed(request, 5.0)
    assert reply.due == pytest.approx(5.0 + len(request) * BYTE + 500e-6 + 15 * BYTE, abs=1e-12)
    assert bench.advanced == [pytest.approx(5.0 + len(request) * BYTE)]


def test_servos_answer_a_sync_read_in_turn() -> None:
    bench = Bench(ids=(1, 2, 3))
    request = instruction(0xFE, 0x82, u16(132) + u16(4) + bytes([3, 1, 2]))
    replies = bench.line.feed(request, 0.0)
    assert [Status.of(reply.data).id for reply in replies] == [3, 1, 2]
    ends = [len(request) * BYTE + 15 * BYTE * (turn + 1) for turn in range(3)]
    assert [reply.due for reply in replies] == pytest.approx(ends)


def test_the_turn_of_an_absent_servo_passes_in_silence() -> None:
    bench = Bench(ids=(1, 3))
    request = instruction(0xFE, 0x82, u16(132) + u16(4) + bytes([1, 2, 3]))
    replies = bench.line.feed(request, 0.0)
    assert [Status.of(reply.data).id for reply in replies] == [1, 3]
    assert replies[1].due == pytest.approx(len(request) * BYTE + 3 * 15 * BYTE)


def test_a_sync_read_refused_by_one_servo_is_answered_by_the_others() -> None:
    bench = Bench(ids=(1, 2))
    answers = bench.send(instruction(0xFE, 0x82, u16(140) + u16(200) + bytes([1, 2])))
    assert [(answer.error, answer.data) for answer in answers] == [(7, b""), (7, b"")]


def test_a_sync_write_reaches_each_servo_and_none_answers() -> None:
    bench = Bench(ids=(1, 2, 3))
    goals = b"".join(bytes([id]) + (1000 * id).to_bytes(4, "little") for id in (1, 2, 9))
    assert bench.send(instruction(0xFE, 0x83, u16(116) + u16(4) + goals)) == []
    before = bench.value(116, 4, id=3)
    assert [bench.value(116, 4, id=id) for id in (1, 2, 3)] == [1000, 2000, before]


def test_a_sync_write_that_needs_stuffing() -> None:
    bench = Bench(ids=(1,))
    data = b"\x01" + (0x00FDFFFF).to_bytes(4, "little")  # out of range, but it must be parsed
    assert bench.send(instruction(0xFE, 0x83, u16(104) + u16(4) + data)) == []
    assert bench.value(104, 4) == 445
    data = b"\x01" + bytes([0xFF, 0x00, 0x00, 0x00])
    assert bench.send(instruction(0xFE, 0x83, u16(104) + u16(4) + data)) == []
    assert bench.value(104, 4) == 255


@pytest.mark.parametrize("length", [0, 3, 4, 8, 12])
def test_a_malformed_sync_write_changes_nothing(length: int) -> None:
    bench = Bench()
    before = bench.value(116, 4)
    parameters = (u16(116) + u16(4) + b"\x01\x00\x04\x00\x00\x01\x00\x08")[:length]
    assert bench.send(instruction(0xFE, 0x83, parameters)) == []
    assert bench.value(116, 4) == before


def test_a_broadcast_ping_is_answered_by_all_in_order_of_id() -> None:
    assert [answer.id for answer in Bench(ids=(7, 2, 5)).send(instruction(0xFE, 0x01))] == [2, 5, 7]


def test_other_broadcasts_are_obeyed_without_an_answer() -> None:
    bench = Bench(ids=(1, 2))
    assert bench.send(write(0xFE, 65, 1, 1)) == []
    assert bench.send(read(0xFE, 65, 1)) == []
    assert [bench.value(65, 1, id=id) for id in (1, 2)] == [1, 1]


def test_a_damaged_packet_gets_a_crc_error_and_does_nothing() -> None:
    bench = Bench()
    damaged = bytearray(write(1, 65, 1, 1))
    damaged[-1] ^= 1
    assert bench.ask(bytes(damaged)).error == 3
    assert bench.value(65, 1) == 0


def test_a_status_packet_on_the_line_is_nobodys_instruction() -> None:
    assert Bench().send(instruction(1, 0x55, b"\x00")) == []


def test_another_rate_is_noise() -> None:
    bench = Bench(baud=57600)
    assert bench.send(instruction(1, 0x01)) == []
    bench.line.baud = 1_000_000
    assert bench.ask(write(1, 8, 1, 1)).error == 0
    assert bench.send(instruction(1, 0x01)) == []
    bench.line.baud = 57600
    assert bench.ask(instruction(1, 0x01)).error == 0


def test_a_gap_inside_a_packet_ends_it() -> None:
    bench = Bench()
    raw = instruction(1, 0x01)
    assert bench.line.feed(raw[:6], 1.0) == []
    assert bench.line.feed(raw[6:], 1.0014) != []
    assert bench.line.feed(raw[:6], 2.0) == []
    assert bench.line.feed(raw[6:], 2.0016) == []
    assert bench.line.feed(raw, 3.0) != []


def test_packets_in_one_chunk_are_answered_one_after_another() -> None:
    bench = Bench(ids=(1, 2))
    both = instruction(1, 0x01) + instruction(2, 0x01)
    first, second = bench.line.feed(both, 0.0)
    assert first.due == pytest.approx((10 + 14) * BYTE)
    assert second.due == pytest.approx((10 + 14 + 14) * BYTE)


def test_a_late_line_delays_what_it_carries() -> None:
    bench = Bench()
    line = Line(bench.servos, bench.baud, bench.advanced.append, latency=lambda: 0.003)
    (reply,) = line.feed(instruction(1, 0x01), 1.0)
    assert reply.due == pytest.approx(1.003 + 24 * BYTE)
