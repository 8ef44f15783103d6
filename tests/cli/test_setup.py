"""setup, monitor and stop on scripted servos and an emulated lamp, over real pseudo-terminals."""

from __future__ import annotations

import io
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from contract.backends import emulator
from dynamixel.responder import Responder
from sleeper import bears

from robolamp.assets import Assets
from robolamp.dynamixel.registers import Name
from robolamp.foot.protocol import Frame, encode
from robolamp.lamp import load_lamp

from .test_main import call

pytestmark = pytest.mark.realtime

LAMP = load_lamp(Assets())


@pytest.fixture
def line() -> Iterator[Responder]:
    with Responder() as responder:
        yield responder


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A lamp's folder of one's own."""
    shutil.copytree(LAMP.path.parent, tmp_path / "own" / "hardware")
    return tmp_path / "own"


class Foot:
    """A foot sensor on a pseudo-terminal that sends the same force until the `with` ends."""

    def __init__(self, force: float) -> None:
        self.force = force
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.name = os.ttyname(self._slave)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._send)

    def __enter__(self) -> Foot:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def _send(self) -> None:
        sequence = 0
        while not self._stop.wait(0.01):
            sequence += 1
            try:
                os.write(self._master, encode(Frame(sequence, sequence * 10_000, self.force)))
            except BlockingIOError:
                continue


def test_scan_finds_servos_with_id_rate_model_and_firmware(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    code, out, _ = call(capsys, "setup", "scan", "--port", line.name, "--last-id", 3, "--json")
    assert code == 0
    servos = json.loads(out)["servos"]
    first = [servo for servo in servos if servo["baud"] == 1_000_000]  # this line hears every rate alike
    assert first == [{"id": i, "baud": 1_000_000, "model": "XL330-M288-T", "firmware": 52} for i in (1, 2, 3)]


def test_assign_wants_one_servo(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    words = ("setup", "assign", "--port", line.name, "--last-id", 3, "--json")
    code, out, _ = call(capsys, *words, "--joint", "knee")
    assert (code, json.loads(out)["error"][:41]) == (2, "expected one servo alone on the line, or ")
    code, out, _ = call(capsys, *words, "--joint", "elbow")
    assert (code, json.loads(out)["error"]) == (2, "'elbow' is not a joint; expected one of ankle, knee, neck")
    code, out, _ = call(capsys, *words)
    assert (code, json.loads(out)["error"]) == (2, "assign wants --joint; expected one of ankle, knee, neck")
    assert 0x03 not in {instruction for _, instruction, _ in line.heard}


def test_assign_looks_for_the_joints_own_ids_whatever_the_last_one(
    capsys: pytest.CaptureFixture[str], own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new servo must not be given the id of one that was not asked for."""
    path = own / "hardware" / "lamp.toml"
    path.write_text(path.read_text().replace("id = 2", "id = 30"))
    asked: list[int] = []

    def scan(*_: object, last: int) -> list[object]:
        asked.append(last)
        return []

    monkeypatch.setattr("robolamp.robot.setup.scan", scan)
    assert call(capsys, "setup", "assign", "--joint", "knee", "--last-id", 3, "--lamp", own)[0] == 2
    assert asked == [30]


def test_zeros_and_signs_from_poses(
    capsys: pytest.CaptureFixture[str], line: Responder, own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    neutral, pushed = {1: 2000, 2: 2100, 3: 1900}, {1: 2300, 2: 1800, 3: 2200}
    for servo, counts in neutral.items():
        line.servos[servo][Name.PRESENT_POSITION] = counts
    asked = []

    class Hands(io.StringIO):
        def readline(self, *_: object) -> str:
            if asked:
                line.servos[len(asked)][Name.PRESENT_POSITION] = pushed[len(asked)]
            asked.append(1)
            return "\n"

    monkeypatch.setattr("sys.stdin", Hands())
    code, out, err = call(capsys, "setup", "zero", "--port", line.name, "--lamp", own, "--json")
    assert code == 0, out
    lamp = load_lamp(Assets.of(own))
    assert [joint.sign for joint in lamp.joints] == [1, -1, 1]
    assert [joint.zero for joint in lamp.joints] == pytest.approx([c * math.tau / 4096 for c in (2000, 2100, 1900)])
    assert len(asked) == 4
    assert "Push knee forward" in err
    assert "# rad: the servo's reading" in lamp.path.read_text()  # comments stay
    assert LAMP.joints[0].zero == load_lamp(Assets()).joints[0].zero


def test_a_range_across_the_seam_is_refused_and_nothing_is_written(
    capsys: pytest.CaptureFixture[str], line: Responder, own: Path
) -> None:
    line.servos[2][Name.PRESENT_POSITION] = 4000
    before = (own / "hardware" / "lamp.toml").read_text()
    code, out, _ = call(capsys, "setup", "zero", "--keep-signs", "--yes", "--port", line.name, "--lamp", own, "--json")
    assert code == 2
    assert "knee would turn from 5.36 to 7.14 rad, across the end" in json.loads(out)["error"]
    assert (own / "hardware" / "lamp.toml").read_text() == before


def test_zero_wants_torque_off_and_an_answer(
    capsys: pytest.CaptureFixture[str], line: Responder, own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("setup", "zero", "--port", line.name, "--lamp", own, "--json")
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert "ended without an answer" in json.loads(call(capsys, *words)[1])["error"]
    assert "--keep-signs" in json.loads(call(capsys, *words, "--yes")[1])["error"]
    line.servos[1][Name.TORQUE_ENABLE] = 1
    assert "torque is on" in json.loads(call(capsys, *words, "--yes", "--keep-signs")[1])["error"]


@bears(0.01)
def test_the_foot_is_tared_and_scaled(capsys: pytest.CaptureFixture[str], own: Path) -> None:
    words = ("setup", "foot", "--yes", "--lamp", own, "--json")
    with Foot(-0.25) as foot:
        code, out, _ = call(capsys, *words, "--foot-port", foot.name)
        assert (code, json.loads(out)["tare_n"]) == (0, pytest.approx(-0.25))
        foot.force = 3.75
        time.sleep(0.05)
        code, out, _ = call(capsys, *words, "--foot-port", foot.name, "--weight", "0.5")
        assert code == 0
        foot.force = -0.25
        time.sleep(0.05)
        code, out, _ = call(capsys, *words, "--foot-port", foot.name, "--weight", "0.5")
        assert code == 2
        assert "0.5 kg raise it by" in json.loads(out)["error"]
    lamp = load_lamp(Assets.of(own))
    assert lamp.foot_tare == pytest.approx(-0.25)
    assert lamp.foot_scale == pytest.approx(0.5 * 9.80665 / 4.0, rel=1e-3)


@pytest.mark.parametrize(("baud", "code"), [(57_600, 0), (9600, 2)])
def test_check_says_where_the_bus_is_too_slow(
    capsys: pytest.CaptureFixture[str], line: Responder, own: Path, baud: int, code: int
) -> None:
    path = own / "hardware" / "lamp.toml"
    path.write_text(path.read_text().replace("baud = 1_000_000", f"baud = {baud}"))
    with Foot(2.1) as foot:
        words = ("setup", "check", "--port", line.name, "--foot-port", foot.name, "--lamp", own)
        found, out, err = call(capsys, *words)
    assert found == code, err
    expected = "deploy refuses controllers with a control_period below 0.048 s" if code == 0 else "a tick takes"
    assert expected in (out if code == 0 else err)


def test_check_names_and_mends(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    line.servos[3][Name.RETURN_DELAY_TIME] = 250
    with Foot(2.0) as foot:
        words = ("setup", "check", "--port", line.name, "--foot-port", foot.name, "--json")
        code, out, _ = call(capsys, *words)
        assert code == 2
        assert "neck (id 3): Return Delay Time(9) is 250" in json.loads(out)["error"]
        code, out, _ = call(capsys, *words, "--fix")
        assert code == 0
    said = json.loads(out)
    assert said["transport"] == "fast sync read of the health block"
    assert len(said["mended"]) == 1
    assert line.servos[3][Name.RETURN_DELAY_TIME] == 0


def test_stop_releases_each_servo_on_its_own(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    for servo in line.servos.values():
        servo[Name.TORQUE_ENABLE] = 1
        servo[Name.BUS_WATCHDOG] = -1
    line.servos[1].silent = True
    line.servos[2].error = 0x80
    line.servos[2][Name.HARDWARE_ERROR_STATUS] = 0x20
    code, out, _ = call(capsys, "stop", "--port", line.name, "--json")
    said = json.loads(out)
    assert code == 1
    assert (said["released"], said["not_confirmed"]) == (["knee", "neck"], ["ankle"])
    assert said["hardware_errors"] == {"knee": "overload"}
    assert [line.servos[i][Name.TORQUE_ENABLE] for i in (1, 2, 3)] == [1, 0, 0]
    assert [line.servos[i][Name.BUS_WATCHDOG] for i in (1, 2, 3)] == [-1, 0, 0]
    assert 0x08 not in {instruction for _, instruction, _ in line.heard}
    call(capsys, "stop", "--port", line.name, "--reboot", "--json")
    assert [i for i, instruction, _ in line.heard if instruction == 0x08] == [2]
    for servo in line.servos.values():
        servo.silent = True
    code, out, _ = call(capsys, "stop", "--port", line.name, "--json")
    assert code == 2
    assert "no servo confirms" in json.loads(out)["error"]


def test_monitor_tells_what_is_there(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    line.servos[2].silent = True
    line.servos[3][Name.PRESENT_POSITION] = 2148
    with Foot(1.5) as foot:
        code, out, _ = call(capsys, "monitor", "--port", line.name, "--foot-port", foot.name, "--json")
        assert code == 0
        said = json.loads(out)
        code, out, _ = call(capsys, "monitor", "--port", line.name, "--foot-port", foot.name, "--duration", "0.3")
    assert said["foot_force_n"] == pytest.approx(1.5)
    ankle, knee, neck = said["servos"]
    assert (knee["angle_rad"], knee["torque"], knee["hardware_error"]) == (None, None, None)
    assert (ankle["torque"], ankle["hardware_error"], ankle["voltage_v"]) == (False, "", 5.0)
    assert neck["angle_rad"] == pytest.approx(100 * math.tau / 4096, abs=1e-5)
    assert code == 0
    assert "no answer" in out
    assert 0x03 not in {instruction for _, instruction, _ in line.heard}


@bears(0.01)
def test_new_servos_are_numbered_as_they_are_plugged_in(capsys: pytest.CaptureFixture[str]) -> None:
    command = [sys.executable, "-m", "robolamp", "emulate", "--factory", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            port = json.loads(process.stdout.readline())["servo_port"]
            words = ("--port", port, "--last-id", 3, "--json")
            for joint in ("ankle", "knee", "neck"):
                for _ in range(5):  # a busy machine may miss an answer, or not have plugged it in yet
                    code, out, _ = call(capsys, "setup", "assign", "--joint", joint, *words)
                    if code == 0:
                        break
                assert code == 0, out
                assert (json.loads(out)["was"]["id"], json.loads(out)["was"]["baud"]) == (1, 57_600)
                process.send_signal(signal.SIGUSR1)
                time.sleep(0.3)
            code, out, _ = call(capsys, "setup", "scan", *words)
        finally:
            process.terminate()
            process.communicate(timeout=60)
    found = [(servo["id"], servo["baud"]) for servo in json.loads(out)["servos"]]
    assert found == [(1, 1_000_000), (2, 1_000_000), (3, 1_000_000)]


@bears(0.01)
def test_a_frozen_emulated_lamp_is_released(capsys: pytest.CaptureFixture[str]) -> None:
    with emulator() as (_, servo_port, foot_port):
        ports = ("--port", servo_port, "--foot-port", foot_port)
        assert call(capsys, "setup", "check", *ports, "--json")[0] == 0
        code, out, _ = call(capsys, "stop", "--port", servo_port, "--json")
        assert (code, json.loads(out)["released"]) == (0, ["ankle", "knee", "neck"])
        said = json.loads(call(capsys, "monitor", *ports, "--json")[1])
    assert [row["torque"] for row in said["servos"]] == [False] * 3


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("scan", "--fix"), "--fix"),
        (("check", "--yes"), "--yes"),
        (("foot", "--joint", "knee"), "--joint"),
        (("zero", "--last-id", "3"), "--last-id"),
    ],
)
def test_an_option_of_another_step_is_refused(
    capsys: pytest.CaptureFixture[str], words: tuple[str, ...], option: str
) -> None:
    code, out, _ = call(capsys, "setup", *words, "--port", "/dev/nosuch", "--json")
    assert code == 2
    assert json.loads(out)["where"] == option
    assert json.loads(out)["error"].endswith(f"not for {words[0]}")


def test_one_look_takes_no_duration(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call(capsys, "monitor", "--port", "/dev/nosuch", "--json", "--duration", 2)
    assert (code, json.loads(out)["where"]) == (2, "--duration")
