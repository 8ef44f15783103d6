"""deploy, stage by stage, on an emulated lamp."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from contract.backends import emulator

from robolamp.log.reader import read_run

from .test_main import call


def test_stages_follow_each_other(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robolamp.robot.connection._EMULATOR_PATIENCE", 0.015)  # a test machine may be busy
    logs = {stage: tmp_path / stage / "log.mcap" for stage in ("shadow", "gentle", "full")}
    with emulator() as (_, servo_port, foot_port):

        def deploy(stage: str, *more: object) -> tuple[int, dict]:
            words = ("deploy", "hop", "--goal", "0.1", "--port", servo_port, "--foot-port", foot_port)
            where = ("--duration", "0.6", "-o", logs[stage].parent, "--stage", stage, "--json")
            for _ in range(30):  # a busy machine may hold up the emulator until the loop gives up
                shutil.rmtree(logs[stage].parent, ignore_errors=True)
                code, out, _ = call(capsys, *words, *where, *more)
                if code == 0 or (code == 2 and "no angle" not in json.loads(out)["error"]):
                    break
            return code, json.loads(out)

        code, said = deploy("gentle")
        assert (code, said["where"]) == (2, "--after")
        assert "--stage gentle wants --after LOG, the log of a finished shadow run, or --force" in said["error"]
        code, said = deploy("shadow")
        assert code == 0, json.dumps(said)
        assert [row["joint"] for row in said["commanded"]] == ["ankle", "knee", "neck"]
        shadow = read_run(logs["shadow"])
        assert set(shadow.torque.flatten().tolist()) <= {0, -1}  # it was read all along, and never on
        assert np.ptp(shadow.goal[shadow.phase == "run"]) > 0.1  # it would have moved
        assert (np.nanmax(shadow.angle, axis=0) - np.nanmin(shadow.angle, axis=0)).max() < 0.05
        code, said = deploy("full", "--after", logs["shadow"])
        assert (code, said["error"][:27]) == (2, "is the log of shadow stage;")
        code, said = deploy("gentle", "--after", logs["shadow"])
        assert code == 0, json.dumps(said)
    gentle = read_run(logs["gentle"])
    assert gentle.context["stage"] == "gentle"
    rows = gentle.phase == "run"
    assert set(gentle.torque[rows].flatten().tolist()) <= {1, -1}
    assert np.nanmax(np.abs(gentle.pwm)) <= 0.51
    speed = np.abs(np.diff(gentle.goal[rows], axis=0)) / 0.02
    assert speed.max() <= 14.0 / 4 + 1e-6


def test_a_log_of_something_else_does_not_do(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(b"not a log")
    words = ("deploy", "hop", "--goal", "0.1", "--port", "/dev/nosuch", "--stage", "full", "--json")
    code, out, _ = call(capsys, *words, "--after", tmp_path / "log.mcap")
    assert (code, json.loads(out)["where"]) == (2, str(tmp_path / "log.mcap"))
    code, out, _ = call(capsys, *words, "--force", "-o", tmp_path / "run")
    assert "no such serial port" in json.loads(out)["error"]


@pytest.mark.parametrize("words", [("--after", "log.mcap"), ("--force",), ("--stage", "shadow", "--force")])
def test_options_of_stages_want_a_stage_that_uses_them(capsys: pytest.CaptureFixture[str], words: tuple[str]) -> None:
    code, out, _ = call(capsys, "deploy", "hop", "--goal", "0.1", "--port", "/dev/nosuch", "--json", *words)
    assert code == 2
    assert json.loads(out)["where"] in words
