"""stop, and what is said of a port that somebody else has open; over real pseudo-terminals."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from contract.backends import emulator
from dynamixel.responder import Responder

from robolamp.dynamixel.registers import Name
from robolamp.ports import Holder, holders

from .test_main import call

STRANGER = """
import fcntl, os, signal, sys, time
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
if "lock" in sys.argv:
    fcntl.flock(port, fcntl.LOCK_EX)
if "deaf" in sys.argv:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("up", flush=True)
time.sleep(60)
"""


@pytest.fixture
def line() -> Iterator[Responder]:
    with Responder() as responder:
        for servo in responder.servos.values():
            servo[Name.TORQUE_ENABLE] = 1
        yield responder


@contextmanager
def stranger(port: str, *how: str, **more: object) -> Iterator[subprocess.Popen[str]]:
    """A program that is not robolamp, with the port open."""
    command = [sys.executable, "-c", STRANGER, port, *how]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **more)  # type: ignore[call-overload]
    try:
        assert process.stdout
        assert process.stdout.readline() == "up\n"
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def monitor(port: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "robolamp", "monitor", "--port", port, "--foot-port", "none"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        end = time.monotonic() + 30.0
        while not holders(port):
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.05)
        yield process
    finally:
        process.kill()
        process.communicate()


def torques(line: Responder) -> list[int]:
    return [line.servos[i][Name.TORQUE_ENABLE] for i in (1, 2, 3)]


VERBS = {
    "deploy": ("deploy", "hop", "--goal", "0.1", "--json"),
    "monitor": ("monitor", "--foot-port", "none", "--json"),
    "setup check": ("setup", "check", "--foot-port", "/dev/nosuch", "--json"),
    "setup scan": ("setup", "scan", "--last-id", "1", "--json"),
    "setup zero": ("setup", "zero", "--keep-signs", "--yes", "--json"),
    "calibrate record": ("calibrate", "record", "--unattended", "--json"),
    "stop": ("stop", "--json"),
}


def test_every_verb_names_who_has_the_port(
    capsys: pytest.CaptureFixture[str], line: Responder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with monitor(line.name) as process:
        for verb, words in VERBS.items():
            more = ("-o", tmp_path / "new") if verb in {"deploy", "calibrate record"} else ()
            code, out, _ = call(capsys, *words, "--port", line.name, *more)
            said = json.loads(out)
            assert (code, said["where"]) == (2, line.name), verb
            named = f"in use by another program: process {process.pid} (robolamp monitor --port {line.name} "
            assert said["error"].startswith(named), verb
            assert "`robolamp stop --force`" in said["error"]
        assert process.poll() is None
    assert torques(line) == [1, 1, 1]


def test_who_has_the_foots_port_is_named(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    reading, writing = pty.openpty()
    name = os.ttyname(writing)
    with stranger(name, "lock") as process:
        code, out, _ = call(capsys, "monitor", "--port", line.name, "--foot-port", name, "--json")
        assert (code, json.loads(out)["where"]) == (2, name)
        assert f"in use by another program: process {process.pid} (" in json.loads(out)["error"]
        assert "--force" not in json.loads(out)["error"]  # that is for the servos' port
    os.close(reading)
    os.close(writing)


@pytest.mark.parametrize("number", [signal.SIGQUIT, signal.SIGHUP, signal.SIGTERM, signal.SIGINT])
def test_any_ending_signal_ends_a_monitor(line: Responder, number: signal.Signals) -> None:
    with monitor(line.name) as process:
        process.send_signal(number)
        assert process.wait(timeout=10) == 0


def test_a_port_in_use_is_not_touched(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    with stranger(line.name, "lock"):
        client = os.open(line.name, os.O_RDWR | os.O_NOCTTY)
        try:
            slow = termios.tcgetattr(client)
            slow[4] = slow[5] = termios.B9600
            termios.tcsetattr(client, termios.TCSANOW, slow)
            before = termios.tcgetattr(client)
            assert call(capsys, "stop", "--port", line.name)[0] == 2
            assert termios.tcgetattr(client) == before
        finally:
            os.close(client)


def test_force_ends_robolamp_without_asking(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    with monitor(line.name) as process:
        code, out, _ = call(capsys, "stop", "--force", "--port", line.name, "--json")
        assert process.wait(timeout=10) == 0  # asked to, not killed
    said = json.loads(out)
    assert (code, said["released"], torques(line)) == (0, ["ankle", "knee", "neck"], [0, 0, 0])
    assert [(row["pid"], row["killed"]) for row in said["ended"]] == [(process.pid, False)]
    assert said["ended"][0]["command"].startswith("robolamp monitor --port")


def test_force_lands_a_deploy(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with emulator() as (_, servo_port, foot_port):
        command = [sys.executable, "-m", "robolamp", "deploy", "hop", "--goal", "0.1", "--duration", "60", "--json",
                   "--port", servo_port, "--foot-port", foot_port, "-o", str(tmp_path / "run")]  # fmt: skip
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            while not holders(servo_port) and process.poll() is None:
                time.sleep(0.02)
            code, out, _ = call(capsys, "stop", "--force", "--port", servo_port, "--json")
            said, err = process.communicate(timeout=60)
    assert code == 0, out
    assert process.returncode in {1, 2}, err  # stopped, or refused by a preflight that a busy computer was too slow for
    if process.returncode == 1:
        assert json.loads(said)["ended"] in {"stopped", "cut"}
    assert [row["killed"] for row in json.loads(out)["ended"]] in ([False], [])


@pytest.mark.parametrize("how", [("lock",), ("lock", "deaf"), ()])
def test_force_asks_before_it_ends_another_program(
    capsys: pytest.CaptureFixture[str], line: Responder, monkeypatch: pytest.MonkeyPatch, how: tuple[str, ...]
) -> None:
    monkeypatch.setattr("robolamp.cli.stop._GRACE", 0.5)
    with stranger(line.name, *how) as process:
        code, out, _ = call(capsys, "stop", "--force", "--port", line.name, "--json")
        assert (code, json.loads(out)["where"]) == (2, line.name)
        assert f"process {process.pid} (" in json.loads(out)["error"]
        assert "is not robolamp, and there is no terminal to ask at; --yes ends it" in json.loads(out)["error"]
        assert (process.poll(), torques(line)) == (None, [1, 1, 1])
        code, out, _ = call(capsys, "stop", "--force", "--yes", "--port", line.name, "--json")
        assert process.wait(timeout=10) == (-signal.SIGKILL if "deaf" in how else -signal.SIGTERM)
    assert (code, torques(line)) == (0, [0, 0, 0])
    assert [(row["pid"], row["killed"]) for row in json.loads(out)["ended"]] == [(process.pid, "deaf" in how)]


def test_force_ends_nobody_where_the_path_is_no_port(capsys: pytest.CaptureFixture[str]) -> None:
    with stranger("/dev/full") as process:
        code, out, _ = call(capsys, "stop", "--force", "--yes", "--port", "/dev/full", "--json")
        assert (code, process.poll()) == (2, None)
    assert json.loads(out)["error"].startswith("not a serial port; give one with --port")


def test_force_wakes_who_is_suspended(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    with monitor(line.name) as process:
        process.send_signal(signal.SIGSTOP)
        code, out, _ = call(capsys, "stop", "--force", "--port", line.name, "--json")
        assert process.wait(timeout=10) == 0
    assert (code, torques(line)) == (0, [0, 0, 0])
    assert [row["killed"] for row in json.loads(out)["ended"]] == [False]


@pytest.mark.parametrize(("answer", "ends"), [("y", True), ("n", False), ("", False)])
def test_force_asks_in_a_terminal(line: Responder, answer: str, ends: bool) -> None:
    ours, theirs = pty.openpty()
    with stranger(line.name, "lock") as other:
        command = [sys.executable, "-m", "robolamp", "stop", "--force", "--port", line.name]
        with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=subprocess.PIPE, text=True) as process:
            os.close(theirs)
            os.write(ours, f"{answer}\n".encode())
            _, err = process.communicate(timeout=30)
        os.close(ours)
        assert f"uses {line.name}, and is not robolamp. End it? [y/N]" in err
        assert (process.returncode, other.poll() is None) == ((0, False) if ends else (2, True))
    assert torques(line) == ([0, 0, 0] if ends else [1, 1, 1])
    assert ends or "goes on; nothing was ended" in err


def test_who_shares_the_port_without_a_lock_is_named(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    with stranger(line.name) as process:
        code, out, err = call(capsys, "stop", "--port", line.name, "--json")
        assert (code, torques(line)) == (0, [0, 0, 0])
        assert [row["pid"] for row in json.loads(out)["also_open"]] == [process.pid]
        assert f"uses {line.name}, too, and may move the lamp; --force ends it" in err


@pytest.mark.skipif(os.getuid() != 0, reason="to start another user's process takes root")
def test_another_users_process_is_left_alone(capsys: pytest.CaptureFixture[str], line: Responder) -> None:
    port = os.open(line.name, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(port, fcntl.LOCK_EX)
    with subprocess.Popen(["sleep", "60"], pass_fds=[port], user=65534) as process:
        os.close(port)
        try:
            while not holders(line.name):
                time.sleep(0.02)
            code, out, _ = call(capsys, "stop", "--force", "--yes", "--port", line.name, "--json")
            assert (code, process.poll()) == (2, None)
            assert "is of another user; only yours are ended" in json.loads(out)["error"]
        finally:
            process.kill()


def test_an_emulator_behind_its_own_port_holds_nothing() -> None:
    with emulator() as (_, servo_port, foot_port):
        assert holders(servo_port) == holders(foot_port) == []
        with stranger(foot_port) as process:
            assert [holder.pid for holder in holders(foot_port)] == [process.pid]
            assert holders(servo_port) == []


@pytest.mark.parametrize("path", ["/dev/nosuch", "/dev", "", __file__])
def test_what_is_no_port_has_no_holders(path: str) -> None:
    assert holders(path) == []


def test_yes_is_for_force(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call(capsys, "stop", "--yes", "--port", "/dev/nosuch", "--json")
    assert (code, json.loads(out)["where"]) == (2, "--yes")


def test_a_long_command_is_cut_and_unprintable_letters_replaced() -> None:
    reading, writing = pty.openpty()
    name = os.ttyname(writing)
    command = [sys.executable, "-c", STRANGER, name, "\x1b[31m\n" + "x" * 500]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        process.stdout.readline()
        (found,) = holders(name)
        process.kill()
    os.close(reading)
    os.close(writing)
    assert isinstance(found, Holder)
    assert len(found.command) == 80
    assert found.command.isprintable()
