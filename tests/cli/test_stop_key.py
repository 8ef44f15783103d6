"""The stop key, in a real pseudo-terminal."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from robolamp.cli.screen.stop_key import StopKeys

RUN = """
import fcntl, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)  # its own terminal, as from a shell
from robolamp.cli.main import main
main(sys.argv[1:])
"""


class Terminal:
    """A terminal with a program in its foreground."""

    def __init__(self, folder: Path) -> None:
        self.master, self.slave = pty.openpty()
        self.before = termios.tcgetattr(self.slave)
        words = ["dry-run", "hop", "--goal", "0.3", "--lockstep", "--duration", "300", "-o", str(folder), "--json"]
        self.process = subprocess.Popen(
            [sys.executable, "-c", RUN, *words],
            stdin=self.slave,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )

    @property
    def raw(self) -> bool:
        """Whether keys are read one at a time."""
        return not termios.tcgetattr(self.slave)[3] & termios.ICANON

    def wait(self, log: Path) -> None:
        """Wait until the lamp is moving."""
        end = time.monotonic() + 200.0
        while not (self.raw and log.exists() and log.stat().st_size > 80_000):  # with ticks, behind the odometer
            assert self.process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.02)

    def close(self) -> None:
        with suppress(ProcessLookupError):
            self.process.kill()
        self.process.communicate()
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path / "run")
    yield terminal
    terminal.close()


@pytest.mark.parametrize("key", [b"q", b" ", b"\x1b"])
def test_a_key_stops_softly_and_the_terminal_is_as_before(terminal: Terminal, tmp_path: Path, key: bytes) -> None:
    terminal.wait(tmp_path / "run" / "log.mcap")
    os.write(terminal.master, b"xyz\n")  # other keys do nothing
    time.sleep(0.2)
    assert terminal.process.poll() is None
    os.write(terminal.master, key * 3)  # held down: still a soft stop
    out, _ = terminal.process.communicate(timeout=120)
    said = json.loads(out)
    assert (said["ended"], said["reason"]) == ("stopped", "request to stop")
    assert termios.tcgetattr(terminal.slave) == terminal.before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP, signal.SIGUSR1])
def test_a_signal_leaves_the_terminal_as_before(terminal: Terminal, tmp_path: Path, number: signal.Signals) -> None:
    terminal.wait(tmp_path / "run" / "log.mcap")
    if number == signal.SIGINT:
        os.write(terminal.master, b"\x03")  # Ctrl-C typed: it still is one
    elif number == signal.SIGQUIT:
        os.write(terminal.master, b"\x1c")  # Ctrl-\\
    else:
        terminal.process.send_signal(number)
    out, _ = terminal.process.communicate(timeout=120)
    assert json.loads(out)["ended"] == "stopped"
    assert termios.tcgetattr(terminal.slave) == terminal.before


def test_no_terminal_no_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    os.write(writing, b"q")
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with StopKeys() as keys:
            assert not keys.listening
            assert not keys.pressed()
    os.close(writing)
