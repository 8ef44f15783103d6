"""The odometer through the wire: what the lamp says of its way, in files, in the answer and in its replay."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.cli.main import main
from robolamp.compare.replays.controller_replay import replay_controller
from robolamp.lamp import load_lamp
from robolamp.log.reader import read_run
from robolamp.odometer import load_odometer

LAMP = load_lamp(Assets.of(None))


def told(capsys: pytest.CaptureFixture[str], *words: str, code: int | None = None) -> dict:
    with pytest.raises(SystemExit) as ended:
        main([*words, "--json"])
    if code is not None:
        assert ended.value.code == code
    return json.loads(capsys.readouterr().out)


def test_a_lamp_that_is_not_its_twin_says_how_far_it_came(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["hop", "--goal", "0.15", "--duration", "5", "--lockstep", "-o", str(tmp_path / "run")]
    facts = told(capsys, "dry-run", *words, "--reality", "loose")
    assert facts["way_m"] == pytest.approx(facts["landed_m"], abs=3 * facts["way_stderr_m"])
    assert facts["way_stderr_m"] < 0.025
    assert facts["way_error_m"] == pytest.approx(facts["way_m"] - facts["landed_m"], abs=1e-3)
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert f"counted {facts['way_m'] * 100:.1f}\u00a0cm" in page
    assert not facts["fell"]
    run = read_run(tmp_path / "run" / "log.mcap")
    last = dict(zip(run.terminals, run.inputs[run.phase == "run"][-1], strict=True))
    assert (last["way"], last["way_stderr"]) == (facts["way_m"], facts["way_stderr_m"])
    assert last["way_left"] == pytest.approx(0.15 - last["way"])
    seen = run.inputs[run.phase == "run"][:, run.terminals.index("foot_contact")]
    assert ((seen > 0) & (seen < 1)).any()  # a part of a tick: the sensor samples faster
    assert run.context["odometer"] == LAMP.odometer.source  # type: ignore[union-attr]
    assert replay_controller(run, LAMP).exact


def test_a_lamp_without_an_odometer_refuses_who_needs_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = LAMP.source.splitlines(keepends=True)
    (tmp_path / "hardware").mkdir()
    own = tmp_path / "hardware" / "lamp.toml"
    own.write_text("".join(line for line in text if not line.startswith("odometer")), encoding="utf-8")
    for verb in ("dry-run", "score"):
        goal = ["--goal", "0.1", "-o", str(tmp_path / "run")] if verb == "dry-run" else ["--goals", "0.1"]
        facts = told(capsys, verb, "hop", *goal, "--lamp", str(tmp_path), code=2)
        assert "needs way_left, which this lamp cannot supply" in facts["error"]
    assert not (tmp_path / "run").exists()
    assert told(capsys, "score", "hop-counting", "--goals", "0.1", "--lamp", str(tmp_path), code=0)["runs"] == 1
    assert "the lamp has none" in told(capsys, "odometer", "score", "--lamp", str(tmp_path), code=2)["error"]
    own.write_text(LAMP.source.replace("sim/lamp/odometer.toml", "sim/lamp/nothing.toml"), encoding="utf-8")
    facts = told(capsys, "score", "hop-counting", "--lamp", str(tmp_path), code=2)
    assert "sim/lamp/nothing.toml not found" in facts["error"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fit", "-o", "made.txt"], "'made.txt' does not end in .toml"),
        (["fit", "-o", "made.toml", "--lamps", "3"], "--lamps"),
        (["fit", "nobody", "-o", "made.toml"], "no such controller"),
        (["score", "--odometer", "missing.toml"], "missing.toml"),
    ],
)
def test_bad_words_are_one_line(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    facts = told(capsys, "odometer", *words, code=2)
    assert said in f"{facts['where']}: {facts['error']}"
    assert not list(tmp_path.iterdir())


def test_the_shipped_odometer_says_what_it_is_worth() -> None:
    shipped = load_odometer(Assets.of(None).path("sim/lamp/odometer.toml"))
    assert shipped.provenance["command"].startswith("robolamp odometer fit")
    assert 0.8 < shipped.scores["run_standardised"] < 1.3
    assert all(row["step_rms_when_left_out_m"] < 0.03 for row in shipped.scores["by_controller"])
    assert np.all(shipped.low < shipped.high)
