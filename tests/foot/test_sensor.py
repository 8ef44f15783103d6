from __future__ import annotations

import math
import os
import termios
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.errors import BusError
from robolamp.foot.protocol import Frame, encode
from robolamp.foot.sensor import FootSensor


class Clock:
    def __init__(self) -> None:
        self.time = 100.0

    def now(self) -> float:
        return self.time

    def sleep_until(self, time: float) -> None:
        self.time = max(self.time, time)


class Source:
    """An emulated line."""

    def __init__(self) -> None:
        self.data = b""

    def read(self, size: int) -> bytes:
        taken, self.data = self.data[:size], self.data[size:]
        return taken

    def close(self) -> None:
        self.data = b""


class Line:
    """A real pseudo-terminal."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)

    def send(self, data: bytes) -> None:
        os.write(self.master, data)

    def unplug(self) -> None:
        if self.master >= 0:
            os.close(self.master)
            os.close(self.slave)
            self.master = -1


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line()
    yield line
    line.unplug()


def test_reads_what_has_arrived_and_never_waits(line: Line) -> None:
    clock = Clock()
    sensor = FootSensor(line.name, 115_200, clock)
    line.send(encode(Frame(1, 0, 9.9)))  # stale: from before it was opened
    sensor.open()
    assert sensor.poll() == []
    assert math.isnan(sensor.force)
    assert sensor.age == math.inf
    raw = encode(Frame(2, 2000, 1.25)) + encode(Frame(3, 4000, 1.5))
    line.send(raw[:20])
    assert [frame.sequence for frame in sensor.poll()] == [2]
    line.send(raw[20:])
    assert [frame.sequence for frame in sensor.poll()] == [3]
    assert sensor.force == 1.5
    clock.time += 0.03
    assert sensor.poll() == []
    assert sensor.age == pytest.approx(0.03)
    sensor.close()
    sensor.close()


def test_what_termios_says_of_a_lost_port() -> None:
    class Lost:
        def read(self, size: int) -> bytes:
            raise termios.error(5, "Input/output error")

        def close(self) -> None:
            pass

    with pytest.raises(BusError, match=r"the port is gone \(Input/output error\)$"):
        FootSensor(Lost(), 115_200, Clock()).poll()


def test_a_port_that_goes_away(line: Line) -> None:
    sensor = FootSensor(line.name, 115_200, Clock())
    sensor.open()
    line.unplug()
    with pytest.raises(BusError, match="the port is gone") as caught:
        sensor.poll()
    assert caught.value.where == line.name
    sensor.close()


def test_a_port_that_does_not_exist() -> None:
    with pytest.raises(BusError, match=r"no such serial port.*--foot-port") as caught:
        FootSensor("/dev/no-such-foot", 115_200, Clock()).open()
    assert caught.value.where == "/dev/no-such-foot"


def test_not_open() -> None:
    with pytest.raises(BusError, match="not open"):
        FootSensor("/dev/x", 115_200, Clock()).poll()
    assert not FootSensor("/dev/x", 115_200, Clock()).gone


def test_what_has_piled_up_is_taken_at_once() -> None:
    clock, source = Clock(), Source()
    sensor = FootSensor(source, 115_200, clock)
    source.data = b"".join(encode(Frame(number, 2000 * number, 1.0)) for number in range(1000))  # 2 s, 16,000 bytes
    assert len(sensor.poll()) == 1000


def stream(clock: Clock, source: Source, sensor: FootSensor, ticks: int, *, start: int = 0, delay: float = 0.0) -> None:
    """Ten frames a tick of 20 ms, each sent at its time and arriving `delay` later."""
    for tick in range(ticks):
        clock.time += 0.02
        newest = start + tick * 20_000 + 20_000 - round(delay * 1e6)
        source.data += b"".join(encode(Frame(0, (newest - 2000 * i) % 2**32, 1.0)) for i in reversed(range(10)))
        sensor.poll()


def test_frames_that_arrive_late_are_old() -> None:
    clock, source = Clock(), Source()
    sensor = FootSensor(source, 115_200, clock)
    stream(clock, source, sensor, 50)
    assert sensor.age == pytest.approx(0.0, abs=1e-4)
    stream(clock, source, sensor, 1, start=1_000_000, delay=0.015)
    assert sensor.age == pytest.approx(0.015, abs=1e-4)


def test_the_age_survives_the_wrap_of_the_sensors_clock() -> None:
    clock, source = Clock(), Source()
    sensor = FootSensor(source, 115_200, clock)
    stream(clock, source, sensor, 20, start=2**32 - 200_000)
    assert sensor.age == pytest.approx(0.0, abs=1e-4)


def test_frames_that_arrive_late_after_the_wrap_are_old() -> None:
    clock, source = Clock(), Source()
    sensor = FootSensor(source, 115_200, clock)
    stream(clock, source, sensor, 20, start=2**32 - 410_000)
    stream(clock, source, sensor, 2, start=2**32 - 10_000, delay=0.015)  # 5 ms before the wrap, 15 ms after
    assert sensor.age == pytest.approx(0.015, abs=1e-4)


def test_a_restarted_sensor_is_young_again() -> None:
    clock, source = Clock(), Source()
    sensor = FootSensor(source, 115_200, clock)
    stream(clock, source, sensor, 20, start=3_000_000_000)
    stream(clock, source, sensor, 2, start=0)
    assert sensor.age == pytest.approx(0.0, abs=1e-3)


def test_a_sensor_that_repeats_one_sample_grows_old() -> None:
    clock, source = Clock(), Source()
    sensor = FootSensor(source, 115_200, clock)
    stream(clock, source, sensor, 5)
    for _ in range(10):
        clock.time += 0.02
        source.data += encode(Frame(0, 100_000, 1.0))
        sensor.poll()
    assert sensor.age == pytest.approx(0.2, abs=1e-3)


@given(drift=st.floats(-100e-6, 100e-6), seconds=st.integers(60, 600))
def test_crystals_that_disagree_do_not_age_the_force(drift: float, seconds: int) -> None:
    clock, source = Clock(), Source()
    sensor = FootSensor(source, 115_200, clock)
    for second in range(seconds):
        clock.time = 100.0 + second * (1 + drift)
        source.data += encode(Frame(0, second * 1_000_000 % 2**32, 1.0))
        sensor.poll()
    assert 0.0 <= sensor.age < 1e-3


def test_a_babbling_line_does_not_hold_the_loop() -> None:
    class Babble(Source):
        def read(self, size: int) -> bytes:
            return b"\x00" * size

    assert FootSensor(Babble(), 115_200, Clock()).poll() == []


def test_a_port_that_is_not_back_yet_is_still_gone(tmp_path: Path) -> None:
    link = tmp_path / "foot"
    ends = os.openpty()
    link.symlink_to(os.ttyname(ends[1]))
    sensor = FootSensor(str(link), 115_200, Clock())
    sensor.open()
    for end in ends:
        os.close(end)
    link.unlink()
    with pytest.raises(BusError, match="gone"):
        sensor.poll()
    sensor.close()
    with pytest.raises(BusError, match="no such serial port"):
        sensor.open()
    assert sensor.gone
    ends = os.openpty()
    link.symlink_to(os.ttyname(ends[1]))
    sensor.open()
    assert not sensor.gone
    assert sensor.poll() == []
    sensor.close()
    for end in ends:
        os.close(end)
