from __future__ import annotations

import gc
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from dynamixel_sdk import Protocol2PacketHandler
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sleeper import Sleeper

from robolamp.dynamixel.bus import ATTEMPTS, Bus, Identity
from robolamp.dynamixel.fast_sync_read import FastReply
from robolamp.dynamixel.registers import MODELS, Name
from robolamp.errors import BusError

from .responder import Responder, crc

pytestmark = pytest.mark.realtime

MODEL = MODELS["XL330-M288-T"]
PATIENCE = 0.2  # a test machine may be busy


class Clock:
    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, time: float) -> None:
        raise AssertionError("the bus never sleeps on the clock")


@pytest.fixture
def line() -> Iterator[Responder]:
    with Responder() as responder:
        yield responder


@pytest.fixture
def bus(line: Responder) -> Iterator[Bus]:
    bus = Bus(line.name, 1_000_000, Clock(), labels={1: "ankle", 2: "knee", 3: "neck"}, patience=PATIENCE)
    bus.open()
    yield bus
    bus.close()


def test_ping(bus: Bus) -> None:
    assert bus.ping(2) == Identity(1200, 52)
    assert bus.ping(9) is None


def test_instruction_packets_are_the_manuals(line: Responder, bus: Bus) -> None:
    """The e-manual's own examples: the responder checked header, length and CRC of each."""
    bus.ping(1)
    bus.sync_read([1, 2], 132, 4)
    assert line.heard == [(1, 0x01, b""), (0xFE, 0x82, bytes([0x84, 0, 4, 0, 1, 2]))]


@pytest.mark.parametrize(
    ("name", "value"), [(Name.GOAL_POSITION, 3000), (Name.GOAL_PWM, -885), (Name.BUS_WATCHDOG, 10)]
)
def test_write_then_read(bus: Bus, name: Name, value: int) -> None:
    bus.write(2, MODEL[name], value)
    assert bus.read(2, MODEL[name]) == value
    assert bus.read(1, MODEL[name]) == 0


def test_sync_write_reaches_each_servo(line: Responder, bus: Bus) -> None:
    bus.sync_write(MODEL[Name.GOAL_POSITION], {1: 0, 3: 4095})
    assert bus.read(1, MODEL[Name.GOAL_POSITION]) == 0
    assert bus.read(3, MODEL[Name.GOAL_POSITION]) == 4095
    assert line.servos[2][Name.GOAL_POSITION] == 0


def test_sync_read_keeps_the_error_byte(line: Responder, bus: Bus) -> None:
    line.servos[2].error = 0x80
    found = bus.sync_read([1, 2, 3], 132, 4)
    assert [found[i].alert for i in (1, 2, 3)] == [False, True, False]
    assert found[2].data == (2048).to_bytes(4, "little")
    assert found[2].refusal == ""


@pytest.mark.parametrize("absent", [1, 2, 3])
def test_a_silent_servo_costs_its_own_data_only(line: Responder, bus: Bus, absent: int) -> None:
    line.servos[absent].silent = True
    assert bus.sync_read([1, 2, 3], 132, 4).keys() == {1, 2, 3} - {absent}


def test_a_dead_bus_costs_the_patience_once(line: Responder, bus: Bus) -> None:
    for servo in line.servos.values():
        servo.silent = True
    with Sleeper() as sleeper:
        began = time.monotonic()
        assert bus.sync_read([1, 2, 3], 132, 4) == {}
        took = time.monotonic() - began
        assert PATIENCE <= took < 2 * PATIENCE + sleeper.lost(began)


def test_damaged_answers_are_gaps(line: Responder, bus: Bus) -> None:
    line.servos[2].damage = 0x10
    assert bus.sync_read([1, 2, 3], 132, 4).keys() == {1, 3}


def test_noise_between_answers_is_skipped(line: Responder, bus: Bus) -> None:
    line.noise = b"\xff\xff\x00\xfd\x17"
    assert bus.sync_read([1, 2, 3], 132, 4).keys() == {1, 2, 3}


def test_stuffed_answers_are_unstuffed(line: Responder, bus: Bus) -> None:
    line.servos[1].memory[132:136] = b"\xff\xff\xfd\x00"
    assert bus.sync_read([1, 2], 132, 4)[1].data == b"\xff\xff\xfd\x00"


def test_bytes_that_look_like_a_header_are_stuffed(line: Responder, bus: Bus) -> None:
    """The SDK's own txPacket (4.1.0) sends this one unstuffed, and servos drop it."""
    bus.write(1, MODEL[Name.HOMING_OFFSET], -131_073)
    assert line.heard == [(1, 0x03, b"\x14\x00\xff\xff\xfd\xfd\xff")]
    line.heard.clear()
    bus.sync_write(MODEL[Name.GOAL_POSITION], {1: -131_073, 2: 5})
    assert bus.ping(1) is not None
    assert line.heard[0][2].startswith(b"\x74\x00\x04\x00\x01\xff\xff\xfd\xfd\xff\x02\x05")


def test_fast_sync_read_keeps_the_error_byte(line: Responder, bus: Bus) -> None:
    line.servos[2].error = 0x80
    found = bus.fast_sync_read([1, 2, 3], 132, 4)
    assert [found[i].error for i in (1, 2, 3)] == [0, 0x80, 0]
    assert found[3].data == (2048).to_bytes(4, "little")
    assert line.heard[-1] == (0xFE, 0x8A, bytes([0x84, 0, 4, 0, 1, 2, 3]))


def test_a_fast_answer_ends_at_the_silent_or_damaged_servo(line: Responder, bus: Bus) -> None:
    line.servos[2].silent = True
    assert bus.fast_sync_read([1, 2, 3], 132, 4).keys() == {1}
    line.servos[2].silent, line.servos[2].damage = False, 0x01
    assert bus.fast_sync_read([1, 2, 3], 132, 4).keys() == {1}
    assert bus.fast_sync_read([1, 3, 2], 132, 4).keys() == {1, 3}


def test_noise_before_a_fast_answer_is_skipped(line: Responder, bus: Bus) -> None:
    line.noise = b"\xff\xff\xfd\x00\xfe\x01"
    assert bus.fast_sync_read([1, 2, 3], 132, 4).keys() == {1, 2, 3}


def test_an_answer_that_comes_too_late_is_thrown_away(line: Responder, bus: Bus) -> None:
    line.servos[1].late = bytes(23)
    line.servos[1].memory[124:148] = bytes(range(24))
    assert bus.sync_read([1], 124, 24)[1].data == bytes(range(24))


@settings(deadline=None, max_examples=200)
@given(st.binary(max_size=60), st.lists(st.binary(min_size=6, max_size=6), min_size=1, max_size=4), st.integers(1, 40))
def test_a_fast_answer_is_read_however_it_is_cut(noise: bytes, blocks: list[bytes], cut: int) -> None:
    ids = list(range(10, 10 + len(blocks)))
    raw = b"\xff\xff\xfd\x00\xfe" + (1 + len(ids) * 10).to_bytes(2, "little") + b"\x55"
    for servo, data in zip(ids, blocks, strict=True):
        raw += bytes([0, servo]) + data
        raw += crc(raw).to_bytes(2, "little")
    reply = FastReply(ids, 6, Protocol2PacketHandler().updateCRC)
    stream = noise + raw
    for start in range(0, len(stream), cut):
        reply.feed(stream[start : start + cut])
    assert reply.complete
    if b"\xff\xff\xfd" not in noise:
        assert [reply.found[servo].data for servo in ids] == blocks


@settings(deadline=None, max_examples=300)
@given(st.binary(max_size=80), st.integers(0, 37), st.integers(1, 255))
def test_a_damaged_fast_answer_gives_only_what_is_right(tail: bytes, at: int, flip: int) -> None:
    raw = b"\xff\xff\xfd\x00\xfe" + (31).to_bytes(2, "little") + b"\x55"
    for servo in (1, 2, 3):
        raw += bytes([0, servo]) + bytes([servo] * 6)
        raw += crc(raw).to_bytes(2, "little")
    reply = FastReply([1, 2, 3], 6, Protocol2PacketHandler().updateCRC)
    reply.feed(raw[:at] + bytes([raw[at] ^ flip]) + raw[at + 1 :] + tail)
    good = max(0, (at - 8) // 10)
    assert list(reply.found) == [1, 2, 3][:good]
    assert all(status.data == bytes([servo] * 6) for servo, status in reply.found.items())


def test_an_instruction_damaged_on_its_way_is_sent_again(line: Responder, bus: Bus) -> None:
    line.servos[2].garbled = ATTEMPTS - 1
    assert bus.ping(2) is not None
    line.servos[2].garbled = ATTEMPTS - 1
    bus.write(2, MODEL[Name.TORQUE_ENABLE], 1)
    assert line.servos[2][Name.TORQUE_ENABLE] == 1
    line.servos[2].garbled = ATTEMPTS
    with pytest.raises(BusError, match=r"knee \(id 2\) refuses the ping: it received a wrong CRC"):
        bus.ping(2)
    line.servos[2].garbled = ATTEMPTS
    with pytest.raises(BusError, match=r"refuses 1 for .*wrong CRC"):
        bus.write(2, MODEL[Name.TORQUE_ENABLE], 1)


def test_a_refused_ping_is_named(line: Responder, bus: Bus) -> None:
    line.servos[2].error = 1
    with pytest.raises(BusError, match=r"knee \(id 2\) refuses the ping: it failed to process"):
        bus.ping(2)


def test_a_refusal_is_named(line: Responder, bus: Bus) -> None:
    line.servos[2].refuse[116] = 0x86  # with the alert bit
    with pytest.raises(BusError, match=r"knee \(id 2\) refuses 5000 for Goal Position\(116\): .*own limits"):
        bus.write(2, MODEL[Name.GOAL_POSITION], 5000)


def test_an_alert_is_not_an_error(line: Responder, bus: Bus) -> None:
    line.servos[1].error = 0x80
    line.servos[1][Name.HARDWARE_ERROR_STATUS] = 0x20
    bus.write(1, MODEL[Name.TORQUE_ENABLE], 0)
    assert bus.read(1, MODEL[Name.HARDWARE_ERROR_STATUS]) == 0x20


def test_no_answer_is_named_after_a_few_attempts(line: Responder, bus: Bus) -> None:
    line.servos[3].silent = True
    with pytest.raises(BusError, match=r"neck \(id 3\) does not answer to the read of Torque Enable\(64\)") as caught:
        bus.read(3, MODEL[Name.TORQUE_ENABLE])
    assert caught.value.where == line.name
    assert len(line.heard) == ATTEMPTS


def test_a_port_that_goes_away(line: Responder, bus: Bus) -> None:
    line.unplug()
    with pytest.raises(BusError, match="the port is gone"):
        bus.sync_read([1, 2, 3], 132, 4)
    bus.close()


def test_a_closed_port_is_an_error(bus: Bus) -> None:
    bus.close()
    bus.close()
    with pytest.raises(BusError, match="not open"):
        bus.ping(1)


@pytest.mark.parametrize(
    ("path", "said"), [("/dev/no-such-port", "no such serial port"), ("", "not a serial port|no such serial port")]
)
def test_a_port_that_cannot_be_opened(tmp_path: Path, path: str, said: str) -> None:
    if not path:
        (tmp_path / "file").write_text("x")
        path = str(tmp_path / "file")
    with pytest.raises(BusError, match=said) as caught:
        Bus(path, 1_000_000, Clock()).open()
    assert caught.value.where == path
    assert "\n" not in str(caught.value)


def test_a_port_in_use(line: Responder, bus: Bus) -> None:
    with pytest.raises(BusError, match="in use by another program"):
        Bus(line.name, 1_000_000, Clock()).open()
    assert bus.ping(1) is not None


def test_a_baud_rate_that_no_servo_has(line: Responder) -> None:
    with pytest.raises(BusError, match="123456 is not a baud rate of the servos"):
        Bus(line.name, 123_456, Clock()).open()


def test_a_baud_rate_that_the_port_cannot_do(line: Responder, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(BusError, match="this port cannot do 4500000 baud"):  # the XL430 can, dynamixel-sdk cannot
        Bus(line.name, 4_500_000, Clock()).open()

    def refuse(*_: object) -> None:
        raise ValueError("Failed to set custom baud rate (1000000): [Errno 22] Invalid argument")

    monkeypatch.setattr("serial.Serial.open", refuse)
    with pytest.raises(BusError, match="this port cannot do 1000000 baud"):
        Bus(line.name, 1_000_000, Clock()).open()


def test_what_termios_says_of_a_lost_port(line: Responder, bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*_: object) -> None:
        raise termios.error(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr("serial.Serial.reset_input_buffer", lost)
        patch.setattr("serial.Serial.flush", lost)
        patch.setattr("serial.Serial.write", lost)
        with pytest.raises(BusError, match=r"the port is gone \(Input/output error\)"):
            bus.ping(1)


def test_no_descriptor_is_left_open(line: Responder) -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(3):
        bus = Bus(line.name, 1_000_000, Clock())
        bus.open()
        bus.close()
    with pytest.raises(BusError):
        Bus("/dev/null", 1_000_000, Clock()).open()
    gc.collect()
    assert len(list(Path("/proc/self/fd").iterdir())) == before


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(noise=st.binary(max_size=40), data=st.binary(min_size=23, max_size=23))
def test_any_noise_and_any_data(line: Responder, bus: Bus, noise: bytes, data: bytes) -> None:
    """Whatever precedes an answer: it is read as it was sent, or it is a gap, and soon."""
    line.noise = noise
    line.servos[1].memory[124:147] = data
    found = bus.sync_read([1], 124, 23)
    assert all(status.data == data for status in found.values())
    line.noise = b""
    assert bus.sync_read([1], 124, 23)[1].data == data


def test_a_babbling_line_does_not_hold_the_loop(line: Responder, bus: Bus) -> None:
    line.noise = b"\x00\xff\xff\xfd" * 600
    with Sleeper() as sleeper:
        began = time.monotonic()
        bus.sync_read([1, 2, 3], 124, 23)
        assert time.monotonic() - began < 10 * PATIENCE + sleeper.lost(began)
