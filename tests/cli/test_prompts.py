"""Every prompt can be left: by Ctrl-C, another signal, q, or the end of input; nothing half-done is kept."""

from __future__ import annotations

import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from dynamixel.responder import Responder

from robolamp.assets import Assets
from robolamp.lamp import load_lamp

from .test_setup import Foot

LAMP = load_lamp(Assets())
RUN = """
import fcntl, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)  # its own terminal, as from a shell
from robolamp.cli.entry import main
sys.argv[1:] = {words!r}
main()
"""
WAYS = {
    "Ctrl-C": b"\x03",
    "Ctrl-backslash": b"\x1c",
    "q": b"q\n",
    "SIGTERM": signal.SIGTERM,
    "SIGHUP": signal.SIGHUP,
    "SIGQUIT": signal.SIGQUIT,
    "SIGUSR2": signal.SIGUSR2,
    "end of input": b"\x04",
}


@pytest.fixture
def own(tmp_path: Path) -> Path:
    shutil.copytree(LAMP.path.parent, tmp_path / "own" / "hardware")
    return tmp_path / "own"


@contextmanager
def asked(*words: object) -> Iterator[tuple[subprocess.Popen[str], int, list[str]]]:
    """A verb in a terminal of its own: the process, the other end of the terminal, and what was read of it so far."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-u", "-c", RUN.format(words=[str(word) for word in words])],
        stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
    )  # fmt: skip
    os.close(theirs)
    try:
        yield process, ours, []
    finally:
        process.kill()
        process.wait()
        os.close(ours)


def read(ours: int, said: list[str], until: str = "") -> str:
    """Read until a text, or the end, and return all that was read so far."""
    while not until or until not in "".join(said):
        try:
            data = os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
        said.append(data.decode())
        if not data:
            break
    return "".join(said)


def leave(process: subprocess.Popen[str], ours: int, way: str) -> None:
    time.sleep(0.05)  # it waits: a prompt is printed before it is
    what = WAYS[way]
    if isinstance(what, bytes):
        os.write(ours, what)
    else:
        process.send_signal(what)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("prompt", [0, 1])
def test_prompts_of_a_recording(tmp_path: Path, way: str, prompt: int) -> None:
    words = ("calibrate", "record", "-o", tmp_path / "new", "--port", "/dev/nosuch", "--foot-port", "/dev/nosuch")
    with asked(*words) as (process, ours, said):
        read(ours, said, "How many grams")
        if prompt:
            os.write(ours, b"214\n")
            read(ours, said, "Enter when ready, q or Ctrl-C to stop: ")
        leave(process, ours, way)
        text = read(ours, said)
        assert process.wait(timeout=10) == (2 if way == "end of input" else 130), text
    assert "Traceback" not in text
    assert ("ended before an answer" if way == "end of input" else "stopped, torque is off; the same command") in text
    assert "/dev/nosuch" not in text  # nothing was opened
    left = {path.name for path in (tmp_path / "new").iterdir()}
    assert left == ({".lock", "manifest.toml"} if prompt else {".lock"})


@pytest.mark.parametrize("way", WAYS)
def test_prompts_of_zeros(own: Path, way: str) -> None:
    before = (own / "hardware" / "lamp.toml").read_bytes()
    with (
        Responder() as line,
        asked("setup", "zero", "--port", line.name, "--lamp", own) as (process, ours, said),
    ):
        read(ours, said, "neutral pose (all joints at 0). Then press Enter (q or Ctrl-C to stop).")
        os.write(ours, b"\n")
        read(ours, said, "Push ankle")
        leave(process, ours, way)
        text = read(ours, said)
        assert process.wait(timeout=10) == (2 if way == "end of input" else 130), text
    assert "Traceback" not in text
    assert ("ended without an answer" if way == "end of input" else "stopped; nothing was written") in text
    assert (own / "hardware" / "lamp.toml").read_bytes() == before
    assert [path.name for path in (own / "hardware").glob(".*")] == []


@pytest.mark.parametrize("way", WAYS)
def test_prompts_of_the_foot(own: Path, way: str) -> None:
    before = (own / "hardware" / "lamp.toml").read_bytes()
    with (
        Foot(-0.25) as foot,
        asked("setup", "foot", "--foot-port", foot.name, "--lamp", own) as (process, ours, said),
    ):
        read(ours, said, "Then press Enter")
        leave(process, ours, way)
        text = read(ours, said)
        assert process.wait(timeout=10) == (2 if way == "end of input" else 130), text
    assert "Traceback" not in text
    assert (own / "hardware" / "lamp.toml").read_bytes() == before
