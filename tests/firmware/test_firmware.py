"""The foot's firmware, run as it is, speaking to the reader through a pseudo-terminal."""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
import os
import shutil
import subprocess
import sys
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.foot.protocol import Decoder, Frame
from robolamp.foot.sensor import FootSensor
from robolamp.runtime.clock import MonotonicClock

HERE = Path(__file__).parent
FIRMWARE = HERE.parents[1] / "hardware" / "firmware"
MICROPYTHON = shutil.which("micropython")
NODE = shutil.which("node")
WEB = Path(sys.prefix, "node/node_modules/@micropython/micropython-webassembly-pyscript")  # see the Makefile

INTERPRETERS = [
    pytest.param("cpython", id="CPython"),
    pytest.param(
        "micropython",
        id="MicroPython",
        marks=pytest.mark.skipif(
            not MICROPYTHON and not (NODE and WEB.is_dir()), reason="no MicroPython; `make micropython` fetches one"
        ),
    ),
]


@contextlib.contextmanager
def firmware(interpreter: str, folder: Path, adc: tuple[int, int, int]) -> Iterator[FootSensor]:
    """The firmware in a process of its own, and its reader."""
    (folder / "adc.txt").write_text("\n".join(map(str, adc)))
    paths = {"PATH": os.environ["PATH"]}
    if interpreter == "micropython" and not MICROPYTHON:
        files = [FIRMWARE / "main.py", FIRMWARE / "frames.py", FIRMWARE / "sensor.py", HERE / "stubs/machine.py"]
        command = [str(NODE), str(HERE / "on_node.mjs"), str(WEB), *map(str, files)]
    elif interpreter == "micropython":
        command = [str(MICROPYTHON), str(FIRMWARE / "main.py")]
        paths["MICROPYPATH"] = f"{HERE / 'stubs'}:{FIRMWARE}:.frozen"
    else:
        command = [sys.executable, str(HERE / "on_cpython.py"), str(FIRMWARE / "main.py")]
        paths["PYTHONPATH"] = f"{HERE / 'stubs'}:{FIRMWARE}"
        paths["PYTHONDONTWRITEBYTECODE"] = "1"
    master, slave = os.openpty()
    tty.setraw(slave)
    sensor = FootSensor(os.ttyname(slave), 115_200, MonotonicClock())
    process = subprocess.Popen(command, stdout=master, cwd=folder, env=paths)
    try:
        sensor.open()
        yield sensor
    finally:
        process.kill()
        process.wait()
        sensor.close()
        os.close(master)
        os.close(slave)


def listen(sensor: FootSensor, count: int) -> list[Frame]:
    frames: list[Frame] = []
    deadline = time.monotonic() + 20.0
    while len(frames) < count and time.monotonic() < deadline:
        frames += sensor.poll()
        time.sleep(0.005)
    return frames


@pytest.mark.parametrize("interpreter", INTERPRETERS)
def test_the_reader_understands_the_firmware(interpreter: str, tmp_path: Path) -> None:
    adc = (6000, 9000, 3000)
    with firmware(interpreter, tmp_path, adc) as sensor:
        frames = listen(sensor, 500)
    assert len(frames) >= 500
    assert sensor.decoder.crc_errors == 0
    conductance = sum(3.3 * value / 65535 / (3300 * (3.3 - 3.3 * value / 65535)) for value in adc)
    assert len({frame.force for frame in frames}) == 1
    assert frames[0].force == pytest.approx(1e4 * conductance, abs=0.002)
    assert not any(frame.saturated or frame.disconnected for frame in frames)
    numbers = [frame.sequence for frame in frames]
    assert all(b > a for a, b in itertools.pairwise(numbers))
    first, last = frames[0], frames[-1]
    period = (last.time - first.time) / (last.sequence - first.sequence)
    assert period == pytest.approx(2000, rel=0.1)  # 500 a second, counting those that a busy machine skipped
    assert sensor.age < 5.0


@pytest.mark.parametrize("interpreter", INTERPRETERS)
@pytest.mark.parametrize(
    ("adc", "saturated", "disconnected"), [((65535, 900, 900), True, False), ((900, 3, 900), False, True)]
)
def test_the_ends_of_the_converter_are_told(
    interpreter: str, tmp_path: Path, adc: tuple[int, int, int], saturated: bool, disconnected: bool
) -> None:
    with firmware(interpreter, tmp_path, adc) as sensor:
        frames = listen(sensor, 20)
    assert {(frame.saturated, frame.disconnected) for frame in frames} == {(saturated, disconnected)}


def module(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, FIRMWARE / f"{name}.py")
    assert spec
    assert spec.loader
    found = importlib.util.module_from_spec(spec)
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # hardware/ holds no caches
    try:
        spec.loader.exec_module(found)
    finally:
        sys.dont_write_bytecode = before
    return found


@given(st.integers(0, 2**40), st.integers(-(2**40), 2**40), st.integers(0, 3), st.integers(0, 70_000))
def test_any_sample_is_a_good_frame(when: int, force: int, status: int, sequence: int) -> None:
    builder = FRAMES.Frames()
    builder.sequence = sequence
    (frame,) = Decoder().feed(bytes(builder.build(when, force, status)))
    assert (frame.sequence, frame.time) == (sequence % 65_536, when % 2**32)
    assert frame.force == pytest.approx(max(-(2**31), min(2**31 - 1, force)) / 1000)
    assert (frame.saturated, frame.disconnected) == (bool(status & 1), bool(status & 2))


FRAMES = module("frames")


def test_a_load_cell_is_a_straight_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "frames", FRAMES)
    sensor = module("sensor")

    class Channel:
        value = 0

        def read_u16(self) -> int:
            return self.value

    channel = Channel()
    cell = sensor.Cell(channel, zero=3000, newtons=65.535)
    found = []
    for value in (3000, 4000, 13_000):
        channel.value = value
        found.append(cell.sample())
    assert found == [(0, 0), (1000, 0), (10_000, 0)]
