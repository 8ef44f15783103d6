"""The emulator as strangers meet it: a process behind real ports, spoken to by the servo maker's SDK and pyserial."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import serial
from dynamixel_sdk import (
    COMM_SUCCESS,
    GroupSyncRead,
    GroupSyncWrite,
    PortHandler,
    Protocol2PacketHandler,
)
from mcap.exceptions import EndOfFile
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from sleeper import bears, eventually, undisturbed

from robolamp.emulator.foot_sensor import crc16_ccitt

from .parts import PatientHandler, Status, read

COMMAND = [sys.executable, "-c", "from robolamp.cli.main import main; main()", "emulate"]


@contextmanager
def emulator(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], dict[str, object]]]:
    process = subprocess.Popen([*COMMAND, "--json", *arguments], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process, json.loads(process.stdout.readline())
    finally:
        process.kill()
        process.communicate(timeout=60)


@pytest.fixture(scope="module")
def ports() -> Iterator[dict[str, str]]:
    with emulator("--reality", "none") as (process, ready):
        yield {key: str(value) for key, value in ready.items() if key.endswith("_port")}
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0


@contextmanager
def sdk(port: str, baud: int = 1_000_000) -> Iterator[tuple[PortHandler, Protocol2PacketHandler]]:
    handler = PortHandler(port)
    assert handler.openPort()
    try:
        assert handler.setBaudRate(baud)
        yield handler, PatientHandler()
    finally:
        handler.closePort()


def test_ready_line() -> None:
    with emulator() as (process, ready):
        assert ready["pid"] == process.pid
        assert Path(str(ready["servo_port"])).is_char_device()
        assert [servo["id"] for servo in ready["servos"]] == [1, 2, 3]  # type: ignore[index,union-attr]
        process.terminate()
        assert process.wait(timeout=60) == 0
        assert process.stdout.read() == ""  # type: ignore[union-attr]


@pytest.mark.realtime
@bears(0.005)  # the SDK takes an answer that comes late for that to its next question
def test_the_sdk_finds_reads_and_writes_servos(ports: dict[str, str]) -> None:
    with sdk(ports["servo_port"]) as (port, packets):
        found, result = packets.broadcastPing(port)
        assert result == COMM_SUCCESS
        assert {id: model for id, (model, _) in found.items()} == {1: 1200, 2: 1200, 3: 1200}
        assert packets.ping(port, 2)[1:] == (COMM_SUCCESS, 0)
        position, result, error = packets.read4ByteTxRx(port, 1, 132)
        assert (result, error) == (COMM_SUCCESS, 0)
        assert abs(position - 2048) <= 2
        assert packets.write2ByteTxRx(port, 1, 84, 800) == (COMM_SUCCESS, 0)
        assert packets.read2ByteTxRx(port, 1, 84) == (800, COMM_SUCCESS, 0)
        assert packets.write1ByteTxRx(port, 1, 7, 253) == (COMM_SUCCESS, 4)


@pytest.mark.realtime
def test_the_sdk_moves_the_lamp(ports: dict[str, str]) -> None:
    with sdk(ports["servo_port"]) as (port, packets):
        reader, writer = GroupSyncRead(port, packets, 126, 10), GroupSyncWrite(port, packets, 116, 4)
        for id in (1, 2, 3):
            assert packets.write2ByteTxRx(port, id, 84, 800) == (COMM_SUCCESS, 0)
            assert packets.write1ByteTxRx(port, id, 64, 1) == (COMM_SUCCESS, 0)
            reader.addParam(id)
        try:
            goals = {1: 2048, 2: 2048, 3: 2348}
            for id, goal in goals.items():
                writer.addParam(id, goal.to_bytes(4, "little"))
            assert writer.txPacket() == COMM_SUCCESS
            assert eventually(
                lambda: reader.txRxPacket() == COMM_SUCCESS and abs(reader.getData(3, 132, 4) - 2348) < 60
            )
            assert all(reader.isAvailable(id, 132, 4) for id in goals)
            assert packets.write1ByteTxRx(port, 1, 9, 1) == (COMM_SUCCESS, 7)
        finally:
            for id in (1, 2, 3):
                packets.write1ByteTxRx(port, id, 64, 0)


@pytest.mark.realtime
def test_a_client_may_close_and_come_back(ports: dict[str, str]) -> None:
    for _ in range(3):
        with sdk(ports["servo_port"]) as (port, packets):
            assert packets.ping(port, 1)[1] == COMM_SUCCESS


@pytest.mark.realtime
def test_a_client_at_the_wrong_rate_hears_nothing(ports: dict[str, str]) -> None:
    with sdk(ports["servo_port"], 57_600) as (port, packets):
        assert packets.ping(port, 1)[1] != COMM_SUCCESS
    with sdk(ports["servo_port"]) as (port, packets):
        assert packets.ping(port, 1)[1] == COMM_SUCCESS


@pytest.mark.realtime
def test_rubbish_on_the_line_does_no_harm(ports: dict[str, str]) -> None:
    with sdk(ports["servo_port"]) as (port, packets):
        port.writePort(os.urandom(300) + b"\xff\xff\xfd\x00\x01\xff")
        time.sleep(0.1)
        port.clearPort()
        assert packets.ping(port, 1)[1] == COMM_SUCCESS


def frames(data: bytes) -> list[tuple[int, int]]:
    """Sequence numbers and forces [mN] of whole frames."""
    found, at = [], data.find(b"\xaa\x55\x0b")
    while 0 <= at <= len(data) - 16:
        raw = data[at : at + 16]
        assert int.from_bytes(raw[14:], "little") == crc16_ccitt(raw[2:14])
        found.append((int.from_bytes(raw[3:5], "little"), int.from_bytes(raw[9:13], "little", signed=True)))
        at = data.find(b"\xaa\x55\x0b", at + 16)
    return found


@pytest.mark.realtime
def test_the_foot_sends_fresh_frames_without_gaps(ports: dict[str, str]) -> None:
    def attempt() -> None:
        with serial.Serial(ports["foot_port"], 115_200, timeout=0.05) as port:
            stale = port.read(100_000)
            assert len(stale) < 16 * 200  # none were kept while nobody listened
            data, begun = b"", time.monotonic()
            while time.monotonic() < begun + 0.5:
                data += port.read(64)
            seen = frames(data)
        assert 200 <= len(seen) <= 300
        assert all((later - earlier) % 65536 == 1 for (earlier, _), (later, _) in pairwise(seen))
        assert all(0 <= force < 20_000 for _, force in seen)

    undisturbed(attempt, 0.02)


def messages(path: Path) -> dict[str, list[tuple[int, Any]]]:
    found: dict[str, list[tuple[int, Any]]] = {}
    factory, schemas, channels = DecoderFactory(), {}, {}
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                kind = type(record).__name__
                if kind == "Schema":
                    schemas[record.id] = record
                elif kind == "Channel":
                    channels[record.id] = record
                elif kind == "Message":
                    channel = channels[record.channel_id]
                    decode = factory.decoder_for("cdr", schemas[channel.schema_id])
                    assert decode is not None
                    found.setdefault(channel.topic, []).append((record.log_time, decode(record.data)))
        except EndOfFile:
            pass
    return found


@pytest.mark.realtime
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGQUIT, signal.SIGKILL])
def test_truth_is_logged_until_the_end(tmp_path: Path, number: int) -> None:
    path = tmp_path / "truth.mcap"

    def attempt() -> dict[str, list[tuple[int, Any]]]:
        with emulator("--truth", str(path)) as (process, _):
            began = time.time()
            time.sleep(1.5)
            process.send_signal(number)
            process.wait(timeout=60)
        seen = messages(path)
        assert set(seen) == {"/truth/joints", "/truth/base"}
        log_time, _ = seen["/truth/base"][-1]
        expected = 1.3 if number != signal.SIGKILL else 0.6  # a killed writer loses what it had not flushed
        assert log_time / 1e9 - began > expected
        steps = [second - first for (first, _), (second, _) in pairwise(seen["/truth/base"])]
        assert max(steps) < 6_000_000
        return seen

    seen = undisturbed(attempt, 0.02)
    _, base = seen["/truth/base"][-1]
    assert base.fallen is False
    assert 2.2 < base.force < 2.5
    joints = seen["/truth/joints"][-1][1]
    assert joints.name == ["ankle", "knee", "neck"]
    assert max(map(abs, joints.position)) < 1e-3


def test_it_ends_with_the_process_that_started_it() -> None:
    starter = (
        "import subprocess, sys\n"
        f"child = subprocess.Popen({[*COMMAND, '--json']!r}, stdout=subprocess.PIPE, text=True)\n"
        "print(child.stdout.readline(), end='', flush=True)\n"
    )
    output = subprocess.run([sys.executable, "-c", starter], capture_output=True, text=True, check=True, timeout=60)
    pid = json.loads(output.stdout)["pid"]
    deadline = time.monotonic() + 60
    while Path(f"/proc/{pid}").exists() and time.monotonic() < deadline:
        if "State:\tZ" in Path(f"/proc/{pid}/status").read_text():
            break
        time.sleep(0.05)
    else:
        assert not Path(f"/proc/{pid}").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--reality", "wrong"], "no such reality"),
        (["--calibration", "wrong"], "no such calibration"),
        (["--lamp", "/nowhere"], "is not a folder"),
        (["--truth", "/proc/none/truth.mcap"], "cannot be written"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_code_2(arguments: list[str], says: str) -> None:
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert says in done.stderr


def test_it_says_what_it_emulates() -> None:
    process = subprocess.Popen(COMMAND, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        lines: list[str] = []
        for line in process.stdout:
            lines.append(line)
            if "Ctrl-C" in line:
                break
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0
    finally:
        process.kill()
        process.communicate(timeout=60)
    text = "".join(lines)
    assert "/dev/pts/" in text
    assert "knee = XL330-M288-T id 2" in text
    assert "not modelled" in text


@pytest.mark.realtime
def test_a_long_answer_comes_in_pieces_and_one_that_comes_twice_after_itself(tmp_path: Path) -> None:
    script = tmp_path / "twice.toml"
    script.write_text('name = "twice"\n\n[status]\nduplicated = 1.0\n')
    size = 100  # of the control table: more than a piece
    with (
        emulator("--reality", "none", "--faults", str(script)) as (_, ready),
        serial.Serial(str(ready["servo_port"]), 1_000_000, timeout=30.0) as port,
    ):
        port.write(read(1, 0, size))
        once = port.read(11 + size)
        assert port.read(11 + size) == once
        assert len(Status.of(once).data) == size
