"""A run that is stopped, in whatever manner, goes on as if it had not been."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from robolamp.errors import FileError
from robolamp.evolve.evolution import evolve, open_run, resume
from robolamp.evolve.progress import Generation
from robolamp.files import write_atomic

from .parts import ASSETS, CALIBRATION, LAMP, walk

TIMES = ("physics_s", "wall_s")


class Stop(Exception):
    """What a progress callback raises to end a run."""


def told(folder: Path) -> list[dict]:
    lines = [json.loads(line) for line in (folder / "progress.jsonl").read_text().splitlines()]
    return [{key: value for key, value in line.items() if key not in TIMES} for line in lines]


def begin(folder: Path, *overrides: str, stop_after: int | None = None, **options: object) -> None:
    def count(entry: Generation) -> None:
        seen.append(entry)
        if len(seen) == stop_after:
            raise Stop

    seen: list[Generation] = []
    task = walk(folder.parent, *overrides)
    try:
        evolve(task, LAMP, CALIBRATION, ASSETS, folder, seed=5, workers=2, progress=count, **options)  # type: ignore[arg-type]
    except Stop:
        assert stop_after is not None


@pytest.mark.parametrize(
    ("overrides", "stop_after"),
    [
        ((), 1),
        ((), 3),
        (("gp.selection=lexicase",), 2),
        (("cases.fresh=true",), 3),
        (("cases.lamps=2",), 4),
        (("cases.fresh=true",), 6),
    ],
)
def test_a_run_that_was_stopped_goes_on_to_the_same_end(
    tmp_path: Path, overrides: tuple[str, ...], stop_after: int
) -> None:
    whole, cut = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    for folder in (whole, cut):
        folder.parent.mkdir()
    begin(whole, *overrides, tuning=2)
    begin(cut, *overrides, tuning=2, stop_after=stop_after)
    result = resume(cut, workers=1)
    assert (cut / "controller.toml").read_text() == (whole / "controller.toml").read_text()
    assert told(cut) == told(whole)
    assert len(result.generations) == 7
    again = resume(cut)
    assert again.best_fitness == result.best_fitness
    assert told(cut) == told(whole)


def test_tuning_that_was_stopped_goes_on_to_the_same_end(tmp_path: Path) -> None:
    whole, cut = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    for folder in (whole, cut):
        folder.parent.mkdir()
    begin(whole, "gp.generations=2", tuning=4)
    begin(cut, "gp.generations=2", tuning=4, stop_after=4)
    resume(cut)
    assert (cut / "controller.toml").read_text() == (whole / "controller.toml").read_text()
    assert told(cut) == told(whole)


def test_a_run_that_is_killed_at_any_moment_goes_on_to_the_same_end(tmp_path: Path) -> None:
    walk(tmp_path)
    command = [sys.executable, "-m", "robolamp", "evolve"]
    options = [
        str(tmp_path / "walk.toml"),
        "--seed",
        "3",
        "--set",
        "gp.generations=8",
        "--set",
        "gp.population=60",
        "--json",
    ]
    whole, cut = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    subprocess.run([*command, *options, "-o", str(whole)], check=True, capture_output=True)
    rng = random.Random(11)
    words = [*options, "-o", str(cut)]
    kills = 0

    def stamp() -> int:
        checkpoint = cut / "checkpoint.json"
        return checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0

    while True:
        process = subprocess.Popen(
            [*command, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
        )
        begun, last, passed = time.monotonic(), stamp(), 0
        # As it starts; then as its first generation goes by, and its second: machines get faster and slower.
        while process.poll() is None and (kills >= 3 or time.monotonic() < begun + 0.3 or passed < kills):
            time.sleep(0.005)
            passed, last = passed + (stamp() != last), stamp()
        time.sleep(0.1 * rng.random())
        if process.poll() is not None:
            _, errors = process.communicate()
            assert process.returncode == 0, errors
            break
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        kills += 1
        if (cut / "checkpoint.json").exists():
            words = ["--resume", str(cut), "--json"]
    assert kills > 0
    commands = [(folder / "controller.toml").read_text().replace(str(folder), "RUN") for folder in (whole, cut)]
    assert commands[0] == commands[1]
    assert told(cut) == told(whole)


def test_a_disk_that_is_full_leaves_the_last_checkpoint_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, cut = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    for folder in (whole, cut):
        folder.parent.mkdir()
    begin(whole)
    written = 0

    def full(path: Path, data: str | bytes) -> None:
        nonlocal written
        written += 1
        if written > 8:
            raise FileError("cannot be written: No space left on device", str(path))
        write_atomic(path, data)

    with monkeypatch.context() as patch:
        for module in ("evolution", "checkpoint", "progress", "run_record"):
            patch.setattr(f"robolamp.evolve.{module}.write_atomic", full)
        with pytest.raises(FileError, match="No space left on device"):
            begin(cut)
    resume(cut)
    assert (cut / "controller.toml").read_text() == (whole / "controller.toml").read_text()
    assert told(cut) == told(whole)


def test_what_cannot_be_resumed_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="holds no run; expected a folder made by robolamp evolve -o"):
        resume(tmp_path)
    folder = tmp_path / "walk"
    begin(folder, stop_after=2)
    checkpoint = (folder / "checkpoint.json").read_text()
    for text in ("", "{", "[]", '{"schema": 9}', checkpoint[: len(checkpoint) // 2], checkpoint.replace("(", "[", 1)):
        (folder / "checkpoint.json").write_text(text)
        with pytest.raises(FileError, match=r"checkpoint\.json: (is damaged|schema)"):
            resume(folder)
    told = json.loads(checkpoint)
    for changed in (
        {"stage": "asleep"}, {"population": []}, {"mothers": [-1]}, {"mothers": [99] * 40}, {"rng": {}}, {"lines": 9},
    ):  # fmt: skip
        (folder / "checkpoint.json").write_text(json.dumps(told | changed))
        with pytest.raises(FileError, match=r"is damaged|has 2 lines; expected 9"):
            resume(folder)
    (folder / "checkpoint.json").unlink()
    with pytest.raises(FileError, match="was stopped before its first checkpoint; begin it again with -o"):
        resume(folder)
    (folder / "checkpoint.json").write_text(checkpoint)
    (folder / "controller.toml").write_text("not mine")
    task = (folder / "task.toml").read_text()
    (folder / "task.toml").write_text(task.replace("generations = 5", "generations = 9"))
    with pytest.raises(FileError, match=r"task\.toml: has changed since the run began"):
        resume(folder)
    (folder / "task.toml").write_text(task)
    record = (folder / "run.toml").read_text()
    (folder / "run.toml").write_text(record.replace('calibration_sha256 = "', 'calibration_sha256 = "0'))
    with pytest.raises(FileError, match=r"nominal\.toml: has changed since the run began"):
        resume(folder)
    (folder / "run.toml").write_text(record.replace('twin_sha256 = "', 'twin_sha256 = "0'))
    with pytest.raises(FileError, match="is not the one the run began with"):
        resume(folder)
    (folder / "run.toml").write_text(record.replace('processor = "', 'processor = "Antikythera '))
    lines: list[str] = []
    with open_run(folder, warn=lines.append) as opened:
        assert not opened.finished
        with pytest.raises(FileError, match="another robolamp is at work here"):
            resume(folder)
    assert (folder / "controller.toml").read_text() == json.loads(checkpoint)["controller"]  # mended
    assert len(lines) == 1
    assert "Antikythera" in lines[0]
