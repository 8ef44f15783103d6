"""`robolamp gesture` and `robolamp play`, as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from robolamp.cli.main import main
from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive, drive
from robolamp.cli.run.gesture_check import check_sequence
from robolamp.cli.run.lockstep import LockstepLamp
from robolamp.compare.compare_logs import compare_log
from robolamp.emulator.faults.script import Faults
from robolamp.emulator.reality.file import load_reality
from robolamp.log.reader import read_run, read_truth
from robolamp.pose.sequence import load_sequence
from robolamp.runtime.stop import StopRequest

SETUP = Setup.of(None, "nominal")
SHRUG = """schema = 1
name = "shrug"
says = "Who knows?"
[[frame]]
time = 0.4 # s
pose = { ankle = 0.1, knee = -0.3, neck = -0.3 }
[[frame]]
time = 0.8
pose = "neutral"
"""
TIPS = """schema = 1
name = "tips"
[[frame]]
time = 0.5
pose = { ankle = 0.6, knee = 0.3, neck = -0.3 }
"""
SCENE = """schema = 1
name = "scene"
[[act]]
gesture = "shrug.toml"
[[act]]
controller = "hop"
goal = 0.06
duration = 1.6
[[act]]
pause = 0.2
[[act]]
gesture = "shrug.toml"
speed = 1.6
"""


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exited:
        main([*words])
    out, err = capsys.readouterr()
    return int(exited.value.code or 0), out, err


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in (("shrug", SHRUG), ("tips", TIPS), ("scene", SCENE)):
        (tmp_path / f"{name}.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_gestures_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "gesture", "list")
    assert code == 0
    assert "nod" in out
    assert "Yes." in out
    code, out, _ = run(capsys, "gesture", "list", "--json")
    listed = json.loads(out)["gestures"]
    assert len(listed) >= 8
    assert all(each["duration_s"] > 0 for each in listed)


def test_a_gesture_is_played_on_the_emulated_lamp(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--lockstep", "--reality", "none", "-o", "run", "--json")
    code, out, err = run(capsys, "gesture", "play", "shrug.toml", *words)
    said = json.loads(out)
    assert code == 0, err
    assert (said["ended"], said["fell"], said["task"], said["verdict"]) == ("finished", False, "done", "inside")
    assert said["missed_ticks"] == 0
    assert not any(said["interventions"].values())
    assert (said["goal_m"], said["hops"]) == (None, 0)
    assert abs(said["landed_m"]) < 0.005
    knee = said["planned"][1]
    assert 0 < knee["mae_mrad"]["before"] < 120
    log = read_run(here / said["log"])
    assert log.context["gesture"] == SHRUG
    planned = log.outputs[log.phase == "run"]
    assert planned == pytest.approx(log.goal[log.phase == "run"], abs=1e-12)
    assert np.ptp(planned, axis=0) == pytest.approx([0.1, 0.3, 0.3], abs=0.01)
    assert {"start", "run", "landing"} == set(log.phase)


def test_a_sequence_is_one_run(here: Path) -> None:
    sequence = load_sequence("scene.toml", SETUP.lamp, SETUP.assets)
    check_sequence(sequence, SETUP)
    log, truth = here / "log.mcap", here / "truth.mcap"
    plan = Drive(SETUP, sequence, sequence.goal, sequence.duration, "emulator", log)
    bent = load_reality("none", SETUP.lamp, SETUP.assets)
    with LockstepLamp(SETUP, bent, Faults("none"), truth, None) as lamp, StopRequest() as stop:
        result = drive(plan, lamp.ports, stop, True)
    assert (result.ended, result.missed_ticks) == ("finished", 0)
    run = read_run(log)
    rows = run.phase == "run"
    assert (run.torque[rows] == 1).all()
    assert [text for _, _, text in run.events].count("torque on") == 1
    assert run.goal_m == 0.06
    assert json.loads(run.context["sequence_acts"])[0] == {"gesture": "shrug", "text": SHRUG}
    # 0.8 s of gesture, 1.5 s to the neutral pose, 1.6 s of hops, 1 s to the neutral pose, pause, 0.5 s of gesture; a
    # tick more for each, so that it ends where it should.
    goal, at = run.goal[rows], run.scheduled[rows] - run.scheduled[rows][0]
    assert at[-1] == pytest.approx(5.70, abs=0.001)
    assert np.abs(goal[(at > 1.9) & (at < 2.3)]).max() < 1e-9
    assert np.isfinite(run.inputs[rows]).all(axis=1).sum() == 81
    hops = run.hops[rows]
    assert hops[at < 2.3].max() == 0
    assert hops[-1] >= 1
    assert (np.diff(hops) >= 0).all()
    assert np.abs(goal[(at > 4.97) & (at < 5.19)]).max() < 1e-9
    assert not read_truth(truth).fallen.any()
    found = compare_log(
        log, assets=SETUP.assets, calibration=SETUP.calibration, out=here / "r.html", truth=truth, diagnosis=False
    )
    assert "names no controller" in found.alone.why
    assert "for a goal of 6.0 cm" in found.task.why[0]


def test_a_sequence_finds_what_is_beside_it(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "elsewhere").mkdir()
    monkeypatch.chdir(here / "elsewhere")
    acts = load_sequence("../scene.toml", SETUP.lamp, SETUP.assets).acts
    assert [getattr(act, "name", "hop") for act in acts] == ["shrug", "hop", "pause", "shrug"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("gesture", "check", "nodd"), "no such gesture; give a file, or one of: bow, breathe, curious"),
        (("gesture", "check", "tips.toml"), "it would tip: the floor would push"),
        (("gesture", "play", "tips.toml"), "ankle puts its weight there"),
        (("gesture", "play", "nod", "--speed", "9"), "neck would turn at"),
        (("gesture", "play", "nod", "--loops", "0"), "--loops: 0 is not a number from 1 to"),
        (("gesture", "play", "breathe", "--loops", "999"), "expected 600 s at most"),
        (("gesture", "play", "nod", "--stage", "gentle"), "--stage: is of use only with --port"),
        (
            ("gesture", "play", "nod", "--port", "/dev/nosuch", "--lockstep"),
            "--lockstep: is of use only without --port",
        ),
        (("gesture", "record", "mine", "--port", "/dev/nosuch", "-o", "x.toml"), "/dev/nosuch"),
        (("gesture", "record", "mine", "-o", "tips.toml"), "tips.toml: is there already"),
        (("gesture", "record", "../mine"), "is not 1 to 64 letters"),
        (("gesture", "record", "mine", "--frames", "2"), "--frames: 2 is not a number from 3 to 200"),
        (("render", "nod", "-o", "nod.png", "--goal", "0.3"), "--goal: is not for a gesture"),
        (("play", "nosuch"), "no such sequence; give a file, or one of: greeting"),
        (("play", "act.toml"), "act[0].gesture: an act has one of gesture, controller, pause; found none"),
    ],
)
def test_bad_input_is_one_line(here: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture) -> None:
    (here / "act.toml").write_text('schema = 1\nname = "empty"\n[[act]]\n')
    before = sorted(here.iterdir())
    code, out, err = run(capsys, *words)
    assert code == 2
    assert said in err
    assert err.count("\n") == 1
    assert not out
    assert sorted(here.iterdir()) == before


def test_a_gesture_is_drawn_at_its_frames(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "render", "shrug.toml", "-o", "shrug.png", "--no-opengl", "--json")
    assert code == 0
    assert json.loads(out)["duration_s"] == pytest.approx(0.8)
    assert (here / "shrug.png").read_bytes().startswith(b"\x89PNG")
