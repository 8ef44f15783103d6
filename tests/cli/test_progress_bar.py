"""Verbs that take a while show how far they are, and only to a person."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from tests.calibrate.bench_parts import record, steps, write_csv


def seen(words: list[str]) -> tuple[int, str, str]:
    """Return exit code, stdout, and what a terminal on stderr showed."""
    master, slave = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(
        [sys.executable, "-m", "robolamp", *words], stdout=subprocess.PIPE, stderr=slave, text=True, env=environment
    ) as process:
        os.close(slave)
        shown = b""
        while True:
            try:
                part = os.read(master, 65536)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            shown += part
        out = process.stdout.read() if process.stdout else ""
    os.close(master)
    return process.returncode, out, shown.decode(errors="replace")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_csv(tmp_path_factory.mktemp("bar"), record(steps, seconds=1.5), "a.csv")


@pytest.mark.parametrize("verb", ["calibrate score", "score"])
def test_a_bar_with_the_time_left_is_on_stderr_alone(verb: str, recording: Path) -> None:
    words = ["calibrate", "score", "nominal", str(recording)]
    if verb == "score":
        words = ["score", "hop", "--goals", "0.1:0.3:3", "--duration", "1"]
    code, out, shown = seen(words)
    assert code == 0, shown
    assert "simulating" in shown
    assert "%" in shown
    assert "left" in shown
    assert "simulating" not in out
    code, out, shown = seen([*words, "--json"])
    assert (code, shown) == (0, "")
    assert out.startswith("{")


def test_nothing_is_shown_where_nobody_looks(recording: Path) -> None:
    words = [sys.executable, "-m", "robolamp", "calibrate", "score", "nominal", str(recording)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
