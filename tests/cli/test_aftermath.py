"""What fails after a run does not hide it: ticks, faults and outcome are told, and the exit code is 2."""

from __future__ import annotations

import json
import os
import pty
import select
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from robolamp.assets import Assets

RUN = ["dry-run", "hop", "--goal", "0.1", "--duration", "0.5", "--lockstep", "-o", "run"]
TICKS = 176  # of soft start, half a second, and landing


def robolamp(*words: str, cwd: Path, blocks: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run it, with files no longer than so many blocks of 1024 bytes: a disk that fills up."""
    limit = f"ulimit -f {blocks}; " if blocks else ""
    return subprocess.run(
        ["bash", "-c", f'{limit}exec "$@"', "-", sys.executable, "-m", "robolamp", *words],
        cwd=cwd, capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip


def nothing(folder: Path) -> None:
    pass


def in_the_way(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "run" / name).mkdir(parents=True)


@pytest.mark.parametrize(
    ("prepare", "blocks", "says"),
    [
        (nothing, 76, "truth.mcap: the truth log ended early: File too large"),
        (nothing, 200, "report.html: cannot be written: File too large"),
        (in_the_way("report.html"), None, "report.html: cannot be written: Is a directory"),
        (in_the_way("report.twin.mcap"), None, "report.twin.mcap: cannot be written: Is a directory"),
    ],
    ids=["full disk", "full for the report", "report in the way", "replay in the way"],
)
def test_results_are_told_whatever_fails_after_the_run(
    tmp_path: Path, prepare: Callable[[Path], None], blocks: int | None, says: str
) -> None:
    for folder, as_json in ((tmp_path / "a", []), (tmp_path / "b", ["--json"])):
        folder.mkdir()
        prepare(folder)
        done = robolamp(*RUN, *as_json, cwd=folder, blocks=blocks)
        assert done.returncode == 2
        assert says in done.stderr
        assert "Traceback" not in done.stderr
        if not as_json:
            assert f"Ticks {TICKS}, missed 0" in done.stdout
            assert "finished" in done.stdout
            assert "run/log.mcap" in done.stdout
            continue
        said = json.loads(done.stdout)
        assert (said["ticks"], said["ended"], said["verdict"], said["report"]) == (TICKS, "finished", None, None)
        assert says.endswith(said["error"]) or says in said["error"]
        assert said["where"]
        full = blocks == 76
        assert (said["landed_m"] is None, "log: File too large" in said["faults"]) == (full, full)


def test_tolerances_are_read_before_the_run(tmp_path: Path) -> None:
    own = tmp_path / "own"
    shutil.copytree(Assets().roots()[-1] / "calibration", own / "calibration")
    (own / "calibration" / "tolerances" / "default.toml").write_text('schema = 1\nname = "x"\njoint_mae = -1.0\n')
    for verb in (RUN, ["deploy", "hop", "--goal", "0.1", "--port", "/dev/nosuch", "--foot-port", "/dev/nosuch"]):
        done = robolamp(*verb, "--lamp", str(own), cwd=tmp_path)
        assert done.returncode == 2
        assert "default.toml: joint_mae" in done.stderr
        assert done.stdout == ""
    assert [path.name for path in tmp_path.iterdir()] == ["own"]


def test_a_recording_that_fails_leaves_what_was_recorded(tmp_path: Path) -> None:
    words = ("calibrate", "record", "--emulate", "--step", "steps-soft", "-o", "session", "--json")
    done = robolamp(*words, cwd=tmp_path, blocks=100)
    assert done.returncode == 2
    said = json.loads(done.stdout)
    (run,) = said["runs"]
    assert (run["step"], run["ended"], run["ticks"] > 100) == ("steps-soft", "finished", True)
    assert said["recordings"] == []
    assert said["error"] == "the log ended early: File too large"
    assert not list((tmp_path / "session").glob("*.mcap*"))


@pytest.mark.parametrize("display", ["", ":7"])
def test_the_player_is_named_and_opened_where_it_can_be_seen(tmp_path: Path, display: str) -> None:
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > {tmp_path}/opened\n')
    browser.chmod(0o755)
    kept = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment = {**kept, "BROWSER": f"{browser} %s", "DISPLAY": display, "TERM": "dumb"}
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "robolamp", *RUN, "--open"],
        cwd=tmp_path, env=environment, stdin=slave, stdout=slave, stderr=slave,
    )  # fmt: skip
    os.close(slave)
    shown = b""
    try:
        while process.poll() is None or select.select([master], [], [], 0.2)[0]:
            if select.select([master], [], [], 0.2)[0]:
                try:
                    shown += os.read(master, 65536)
                except OSError:  # the last writer has closed the terminal
                    break
        assert process.wait(100) == 0
    finally:
        os.close(master)
    assert "replay  robolamp replay run/log.mcap" in shown.decode()
    assert (tmp_path / "opened").exists() is bool(display)
    if display:
        page = tmp_path / "run" / "replay.html"
        assert (tmp_path / "opened").read_text().strip() == page.as_uri()
        assert page.stat().st_size > 10_000
