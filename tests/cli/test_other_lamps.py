"""Lamps with other joints and servos, made from `robolamp new --joints 5`: what its README says works, works."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.main import main
from robolamp.lamp import SERVO_MODELS, load_lamp

HELD = 'schema = 1\nname = "held"\norigin = "by hand"\ncontrol_period = 0.02\n\n[joints]\n'
TASK = ("--population", 4, "--generations", 1, "--set", "duration=0.5", "--set", "cases.count=2")


def call(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, dict[str, Any]]:
    with pytest.raises(SystemExit) as exited:
        main([*map(str, words), "--json"])
    out, _ = capsys.readouterr()
    return int(exited.value.code or 0), json.loads(out)


def drop(folder: Path, joint: str) -> None:
    """Take a joint out of description and model: what it turned is fixed to what carried it."""
    path = folder / "hardware/lamp.toml"
    head, *joints = path.read_text().split("[[joint]]")
    path.write_text("[[joint]]".join([head, *(each for each in joints if f'name = "{joint}"' not in each)]))
    path = folder / "sim/lamp/lamp.xml"
    path.write_text(re.sub(rf'\n *<(joint|dcmotor) name="{joint}"[^>]*>', "", path.read_text()))


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def joints_of(folder: Path) -> list[str]:
    return list(load_lamp(Assets(folder)).names)


@pytest.fixture(scope="module")
def five(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("five") / "lamp"
    with pytest.raises(SystemExit):
        main(["new", str(folder), "--joints", "5"])
    return folder


@pytest.fixture(params=["five", "four, of two models of servo", "three, of 12 V"])
def other(request: pytest.FixtureRequest, five: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "lamp"
    shutil.copytree(five, folder)
    description, numbers = folder / "hardware/lamp.toml", folder / "calibration/nominal.toml"
    if request.param != "five":
        drop(folder, "roll")
    if "two" in request.param:
        before, neck = description.read_text().split('name = "neck"')
        description.write_text(f'{before}name = "neck"{neck.replace("XL330-M288-T", "XL330-M077-T")}')
    if "12 V" in request.param:
        drop(folder, "yaw")
        change(description, "XL330-M288-T", "XL430-W250-T")
        change(numbers, "supply_voltage = { value = 5.0", "supply_voltage = { value = 12.0")
    (folder / "held.toml").write_text(HELD + "".join(f'{joint} = "0.15"\n' for joint in joints_of(folder)))
    return folder


def test_a_controller_that_holds_it_is_run_and_explained(
    other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held, own = other / "held.toml", ("--lamp", other)
    where = ("--goal", 0.1, "--duration", 2, "--lockstep", "--reality", "random:4", "-o", tmp_path / "run")
    _, said = call(capsys, "dry-run", held, *where, *own)
    assert said["ended"] == "finished"
    assert said["verdict"] == "inside"
    assert abs(said["landed_m"]) < 0.005
    assert call(capsys, "compare", said["log"], "-o", tmp_path / "page.html", *own)[1]["verdict"] == "inside"
    _, scored = call(capsys, "score", held, "--goals", 0.1, "--lamps", 2, "--duration", 1, *own)
    assert scored["falls"] == 0
    assert [row["evolved"] for row in call(capsys, "explain", held, *own)[1]["joints"]] == ["0.15"] * len(
        joints_of(other)
    )
    _, drawn = call(capsys, "render", tmp_path / "run/log.mcap", "-o", tmp_path / "run.png", "--twin", *own)
    assert drawn["travel_m"] == pytest.approx(0.0, abs=0.005)
    call(capsys, "evolve", "hop", "-o", tmp_path / "made", "--seed-from", held, *TASK, *own)
    made = tomllib.loads((tmp_path / "made/controller.toml").read_text())
    assert list(made["joints"]) == joints_of(other)


def test_its_numbers_are_the_nominal_ones_and_those_of_other_servos(five: Path) -> None:
    own, shipped = load_calibration(Assets(five)), load_calibration(Assets())
    assert {name: own.groups[name] for name in shipped.groups} == shipped.groups
    assert set(own.groups) - set(shipped.groups) == {"XL330-M077-T", "XL430-W250-T"}
    for name in set(SERVO_MODELS) & set(own.groups):
        for key, parameter in own.groups[name].items():
            assert len(parameter.source) > 8, f"{name}.{key}"


def test_gestures_that_name_its_joints_are_its_own(five: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("nod", "shake"):
        code, said = call(capsys, "gesture", "check", name, "--lamp", five)
        assert code == 0
        assert said["gesture"] == name


def test_what_drives_three_joints_is_refused_by_name(five: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = call(capsys, "dry-run", "hop", "--goal", 0.1, "--lamp", five)
    assert code == 2
    assert (
        "the controller's joints (ankle, knee, neck) are not the lamp's (yaw, ankle, knee, roll, neck)" in said["error"]
    )


def test_a_reality_of_another_lamp_says_which_others_there_are(
    five: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own, mine = tmp_path / "lamp", tmp_path / "mine.toml"
    shutil.copytree(five, own)
    for path in ("hardware/lamp.toml", "sim/lamp/lamp.xml", "sim/lamp/controllers/cycle.toml"):
        change(own / path, "knee", "elbow")
    mine.write_text('name = "mine"\n[joint.knee]\nfriction = 1.2\n')
    for reality, remedy in (("worn", True), (mine, False)):
        code, said = call(capsys, "dry-run", "cycle", "--goal", 0.1, "--lamp", own, "--reality", reality)
        assert code == 2
        assert "no such joint; expected one of yaw, ankle, elbow, roll, neck" in said["error"]
        assert said["error"].endswith("for this lamp: none, random:SEED, knob:KIND:SEED or a file of its own") == remedy


def test_the_next_commands_are_of_the_same_lamp(five: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = tmp_path / "a lamp"
    shutil.copytree(five, own)
    words = ["evolve", "hop", "-o", str(tmp_path / "made"), *map(str, TASK), "--lamp", str(own)]
    for again in (words, ["evolve", "--resume", str(tmp_path / "made")]):
        with pytest.raises(SystemExit):
            main([*again, "--calibration", "bending"] if again is words else again)
        out, _ = capsys.readouterr()
        told = [shlex.split(line) for line in out.splitlines() if "robolamp " in line]
        assert len(told) == 3
        for command in told:
            assert command[command.index("--lamp") + 1] == str(own)
            assert Path(command[command.index("--calibration") + 1]).stem == "bending"
