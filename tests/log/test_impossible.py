"""Logs that say what cannot be: refused in one line, by every verb that reads one."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path
from typing import Any

import pytest

from robolamp.assets import Assets
from robolamp.cli.main import main
from robolamp.errors import FileError
from robolamp.lamp import load_lamp, same_lamp
from robolamp.log.reader import read_run
from robolamp.log.run_context import SERVO_SETTINGS, servo_settings
from robolamp.log.writer import LogWriter

from .rewritten import rewritten
from .ticks import JOINTS, make_tick

CONTEXT = {"control_period": "0.02", "goal_m": "0.3"}


def written(path: Path, *, at: int = 12, joints: tuple[str, ...] = JOINTS, **changed: Any) -> Path:
    """Write 20 ticks; from one on something is changed in them (`measured_at`: of what was observed)."""
    with LogWriter(path, context=CONTEXT, joints=joints, now=100.0, lossless=True) as log:
        for index in range(20):
            tick = make_tick(index)
            if index >= at:
                own = {name: value for name, value in changed.items() if name != "measured_at"}
                seen = {"time": changed["measured_at"]} if "measured_at" in changed else {}
                tick = dataclasses.replace(tick, observation=dataclasses.replace(tick.observation, **seen), **own)
            log.tick(tick)
    return path


@pytest.mark.parametrize("name", ["scheduled", "read_done", "write_done", "measured_at"])
def test_a_ticks_times_belong_together(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / "run.mcap", **{name: 4000.0})
    with pytest.raises(FileError, match=rf"tick 12 began at 100\.24 s, and its {name} is 4000 s; expected no more"):
        read_run(path)


@pytest.mark.parametrize(("value", "said"), [(math.nan, "tick 12 began at nan s"), (math.inf, "tick 12 began at inf")])
def test_a_tick_begins_at_some_time(tmp_path: Path, value: float, said: str) -> None:
    with pytest.raises(FileError, match=said):
        read_run(written(tmp_path / "run.mcap", began=value))


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_a_schedule_without_a_time_is_one_line(
    tmp_path: Path, value: float, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "run.mcap", scheduled=value)
    for words in (["log", "info", path], ["render", path, "-o", tmp_path / "x.png"], ["compare", path]):
        with pytest.raises(SystemExit, match="2"):
            main([str(word) for word in words])
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "its scheduled is" in said


def test_a_log_that_lasts_for_ever_is_refused(tmp_path: Path) -> None:
    times = dict.fromkeys(("scheduled", "began", "read_done", "write_done"), 1e8)
    with pytest.raises(FileError, match=r"lasts 9.*e\+07 s; expected the log of one run"):
        read_run(written(tmp_path / "run.mcap", **times, measured_at=1e8))


def test_two_ticks_of_one_number_are_not_one(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"two ticks are number 5: one began at 100\.100 s, one at 100\.240 s"):
        read_run(written(tmp_path / "run.mcap", index=5))


def test_a_joint_is_named_once(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="names the same joint twice: ankle, ankle, neck"):
        read_run(written(tmp_path / "run.mcap", joints=("ankle", "ankle", "neck")))


@pytest.mark.parametrize("stamp", [2**63, 2**64 - 1])
def test_stamps_beyond_what_can_be_counted_are_one_line(
    tmp_path: Path, stamp: int, capsys: pytest.CaptureFixture[str]
) -> None:
    source = written(tmp_path / "run.mcap")
    path = rewritten(source, tmp_path / "other.mcap", clock=lambda topic, number, log_time: stamp)
    with pytest.raises(SystemExit, match="2"):
        main(["log", "info", str(path)])
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"a message of {stamp} ns since the epoch" in said


@pytest.mark.parametrize("text", ["a" + ".a" * 50_000 + " = 1", "a = " + "[" * 50_000], ids=["key", "array"])
def test_a_description_nested_without_end_is_passed_over_at_once(tmp_path: Path, text: str) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, context={**CONTEXT, "lamp": text}, joints=JOINTS, now=100.0, lossless=True) as log:
        for index in range(20):
            log.tick(make_tick(index))
    began = time.monotonic()
    assert read_run(path).joints == JOINTS
    assert not same_lamp(load_lamp(Assets()), text)
    assert time.monotonic() - began < 5.0


@pytest.mark.parametrize("text", ['{"ankle": {"P": 1e999}}', '{"ankle": {"P": NaN}}', "[1]", "[" * 100_000])
def test_settings_that_are_none_are_not_known(text: str) -> None:
    assert servo_settings({SERVO_SETTINGS: text}) == {}
