"""A dry run that this computer is too busy for goes on in lockstep; one that ends for another reason does not."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from sleeper import eventually

from robolamp.assets import Assets
from robolamp.cli.run.witness import Busy, Silence, Watch, judged
from robolamp.lamp import load_lamp
from robolamp.lateness import Lateness

COMMAND = [sys.executable, "-m", "robolamp", "dry-run", "hop", "--goal", "0.1", "--reality", "none", "--duration"]
PATIENCE = 0.012
BEFORE = len(load_lamp(Assets.of(None)).odometer.source)  # type: ignore[union-attr]
TICKING = (
    BEFORE + 12_000
)  # the size of a log that holds ticks [bytes]: the rest before the first takes 8 kB or a little more


def emulator_of(process: subprocess.Popen[str]) -> int:
    """The process id of a dry run's emulator."""
    return int(Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()[0])


def disturbed(
    folder: Path, disturb: Callable[[subprocess.Popen[str], int], None], *options: str, duration: str = "2"
) -> tuple[int, dict, str]:
    """Start a dry run, disturb it once the lamp moves, and return its exit code, what it said, and its stderr."""
    process = subprocess.Popen(
        [*COMMAND, duration, *options, "-o", "run", "--json"],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    log = folder / "run" / "log.mcap"
    try:
        assert eventually(lambda: process.poll() is not None or (log.exists() and log.stat().st_size > TICKING))
        disturb(process, emulator_of(process))
        out, err = process.communicate(timeout=200)
    finally:
        process.kill()
        process.communicate()
    return process.returncode, json.loads(out), err


def freeze(process: subprocess.Popen[str], emulator: int) -> None:
    """Let an emulator stand still, as on a computer that has no time for it."""
    os.kill(emulator, signal.SIGSTOP)
    time.sleep(0.6)
    os.kill(emulator, signal.SIGCONT)


@pytest.mark.realtime
def test_a_run_that_this_computer_cut_goes_on_in_lockstep(tmp_path: Path) -> None:
    code, said, err = disturbed(tmp_path, freeze)
    assert code == 0, err
    assert (said["ended"], said["lockstep"], said["fell"]) == ("finished", True, False)
    assert said["host_late_ms"] > 100
    assert said["missed_ticks"] == 0
    assert abs(said["landed_m"] - 0.1) < 0.05
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"log.mcap", "log.mcap.cut", "truth.mcap", "truth.mcap.cut", "report.html"} <= names


@pytest.mark.realtime
def test_it_says_so(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, "2", "-o", "run"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    assert any(line.strip() == "run" for line in process.stderr)
    with contextlib.suppress(
        IndexError, FileNotFoundError
    ):  # the run was cut already: a computer that is busy by itself
        freeze(process, emulator_of(process))
    out, err = process.communicate(timeout=200)
    assert process.returncode == 0, err
    first, _, last = out.partition("Landed at ")
    assert "This computer was busy: " in first
    assert "going on in lockstep" in first
    assert "late by " in last
    assert "its log: run/log.mcap.cut" in last
    assert "replay  robolamp replay run/log.mcap\n" in last
    assert "baud" not in out + err


@pytest.mark.realtime
def test_an_emulator_that_dies_is_no_busy_computer(tmp_path: Path) -> None:
    code, said, err = disturbed(tmp_path, lambda process, emulator: os.kill(emulator, signal.SIGKILL))
    assert code == 2
    assert (said["ended"], said["lockstep"]) == ("cut", False)
    assert said["ticks"] > 0
    assert said["faults"]
    assert said["error"] == "ended in the midst of the run (signal 9)"
    assert "robolamp: emulator: ended in the midst of the run (signal 9)" in err


@pytest.mark.realtime
def test_a_run_that_was_asked_to_stop_is_not_repeated(tmp_path: Path) -> None:
    def stop(process: subprocess.Popen[str], emulator: int) -> None:
        process.send_signal(signal.SIGINT)
        freeze(process, emulator)

    code, said, _ = disturbed(tmp_path, stop)
    assert code == 1
    assert (said["ended"] in ("stopped", "cut"), said["lockstep"]) == (True, False)


@pytest.mark.realtime
def test_a_run_with_a_script_of_faults_is_not_repeated(tmp_path: Path) -> None:
    script = tmp_path / "faults.toml"
    # So late that a busy machine has opened the lamp by then, and the run is still on.
    script.write_text('name = "x"\n[[event]]\nwhat = "silent"\nservo = 1\nat = 15.0\nlasts = 90.0\n')
    code, said, _ = disturbed(tmp_path, freeze, "--faults", str(script), duration="40")
    assert code == 1
    assert (said["ended"] in ("cut", "guard"), said["lockstep"]) == (True, False)
    assert not (tmp_path / "run" / "log.mcap.cut").exists()


def spans(*late: tuple[float, float]) -> Lateness:
    found = Lateness()
    for due, done in late:
        found.note(due, done)
    return found


@pytest.mark.parametrize(
    ("silence", "emulator", "loop", "ended", "expected"),
    [
        # A freeze explains the silence that it filled.
        ((5.0, 5.12), [(5.01, 5.11)], [], "cut", Busy(0.1, "emulator", True)),
        # So do a few that were each longer than the patience, and a loop that slept.
        ((5.0, 5.12), [(5.01, 5.03), (5.035, 5.055), (5.06, 5.09)], [], "cut", Busy(0.03, "emulator", True)),
        ((5.0, 5.3), [], [(5.02, 5.29)], "cut", Busy(0.27, "loop", True)),
        # A moment's lateness in a long silence, or lateness that the patience bears, does not.
        ((5.0, 5.12), [(5.01, 5.03)], [], "cut", Busy(0.02, "emulator", False)),
        ((5.0, 5.12), [(5.0 + i / 100, 5.009 + i / 100) for i in range(12)], [], "cut", Busy(0.009, "emulator", False)),
        ((5.0, 5.12), [(4.0, 4.5)], [], "cut", Busy(0.0, "emulator", False)),
        # Nor is a run that ended for something else explained by it, nor one that ended well.
        ((5.0, 5.12), [(5.01, 5.11)], [], "stopped", Busy(0.1, "emulator", False)),
        ((5.0, 5.12), [(5.01, 5.11)], [], "finished", Busy(0.1, "emulator", False)),
        (None, [(5.01, 5.11)], [], "guard", Busy(0.1, "emulator", False)),
    ],
)
def test_a_silence_is_explained_by_what_was_late(
    silence: tuple[float, float] | None,
    emulator: list[tuple[float, float]],
    loop: list[tuple[float, float]],
    ended: str,
    expected: Busy,
) -> None:
    watch = Watch(loop=spans(*loop), began=4.9, ended=6.0)
    watch.silence = Silence(*silence, PATIENCE, landing=False) if silence else None
    found = judged(watch, spans(*emulator), ended, PATIENCE)
    assert (found.who, found.ended_it) == (expected.who, expected.ended_it)
    assert found.late == pytest.approx(expected.late)


def test_a_silence_while_landing_is_not_what_a_guard_landed_the_lamp_for() -> None:
    watch = Watch(began=4.9, ended=6.0, silence=Silence(5.0, 5.12, PATIENCE, landing=True))
    late = spans((5.01, 5.11))
    assert not judged(watch, late, "guard", PATIENCE).ended_it
    assert judged(watch, late, "cut", PATIENCE).ended_it


def test_a_fall_is_laid_on_what_was_late_just_before() -> None:
    watch = Watch(began=1.0, ended=9.0)
    assert judged(watch, spans((4.5, 4.6)), "finished", PATIENCE, fell=5.0).ended_it
    assert not judged(watch, spans((2.5, 2.6)), "finished", PATIENCE, fell=5.0).ended_it
    assert not judged(watch, spans((4.5, 4.51)), "finished", PATIENCE, fell=5.0).ended_it
