"""`robolamp explain`: what it says of a controller, to people and to programs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robolamp.controller.expression import parse
from robolamp.controller.terminals import all_terminals

from .test_main import call

CONTROLLER = """
schema = 1
name = "nod"
[joints]
ankle = "(+ 0 (* a0 (- 1 1)))"
knee = "(ifltz (- t 0.29) (ifltz (- t 2) 0.01 w2) (ifltz (- hops 90) 0.02 -0.3))"
neck = "0.1"
"""


@pytest.fixture
def nod(tmp_path: Path) -> Path:
    path = tmp_path / "nod.toml"
    path.write_text(CONTROLLER)
    return path


def test_for_programs(capsys: pytest.CaptureFixture[str], nod: Path) -> None:
    code, out, err = call(capsys, "explain", nod, "--goals", "0.1:0.3:2", "--duration", "1", "--json")
    assert (code, err, out.count("\n")) == (0, "", 1)
    said = json.loads(out)
    assert (said["controller"], said["goals_m"], said["ticks"]) == ("nod", [0.1, 0.3], 100)
    ankle, knee, neck = said["joints"]
    assert (ankle["joint"], ankle["simplified"], ankle["nodes"], ankle["nodes_simplified"]) == ("ankle", "0", 7, 1)
    assert (ankle["signals"], ankle["signals_idle"], ankle["branches"]) == ([], ["a0"], [])
    assert knee["simplified"] == "(ifltz (- t 0.29) 0.01 (ifltz (- hops 90) 0.02 -0.3))"
    assert (knee["signals"], knee["signals_idle"]) == (["t", "hops"], ["w2"])
    shares = ("reached_share", "negative_share", "otherwise_share")
    assert [(branch["condition"], *(branch[name] for name in shares)) for branch in knee["branches"]] == [
        ("(- t 0.29)", 1.0, 0.3, 0.7),  # 15 of 50 ticks, 0 to 0.28 s
        ("(- t 2)", 0.3, 0.3, 0.0),
        ("(- hops 90)", 0.7, 0.7, 0.0),
    ]
    assert [branch["condition"] for branch in knee["branches_simplified"]] == ["(- t 0.29)", "(- hops 90)"]
    assert (neck["evolved"], neck["simplified"], neck["signals"]) == ("0.1", "0.1", [])


def test_for_people(capsys: pytest.CaptureFixture[str], nod: Path) -> None:
    code, out, err = call(capsys, "explain", nod, "--goals", "0.2", "--duration", "1")
    assert (code, err) == (0, "")
    assert "share of 50 ticks" in " ".join(out.split())
    assert "ankle: reads nothing; a0 changes nothing" in out
    assert "  as given, 7 nodes" in out
    assert "  simplified, 1 node\n" in out
    assert "knee: reads t, hops; w2 changes nothing" in out
    lines = out.splitlines()
    assert "          (ifltz (- t 0.29)" in lines
    assert "    30 %      0.01" in lines
    assert "   never      w2)" in lines
    assert "    70 %    (ifltz (- hops 90)" in lines
    assert "   never      -0.3))" in lines
    assert "  1 node, as simple as it gets" in lines


def test_the_shipped_hop_fits_a_hundred_columns_and_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call(capsys, "explain", "hop", "--goals", "0.3", "--duration", "2")
    assert code == 0
    lines = out.splitlines()
    assert max(map(len, lines)) <= 100
    begin = next(index for index, line in enumerate(lines) if line.startswith("ankle: reads")) + 2
    end = next(index for index in range(begin, len(lines)) if not lines[index].startswith(" " * 3))
    shown = parse("\n".join(line[10:] for line in lines[begin:end]), all_terminals(3))
    said = json.loads(call(capsys, "explain", "hop", "--goals", "0.3", "--duration", "1", "--json")[1])
    assert str(shown) == said["joints"][0]["evolved"]


def test_it_explains_itself_and_refuses_in_one_line(capsys: pytest.CaptureFixture[str], nod: Path) -> None:
    code, out, err = call(capsys, "explain", "--help")
    assert (code, err) == (0, "")
    assert "robolamp explain" in out
    assert "--goals" in out
    nod.write_text(CONTROLLER.replace('"0.1"', '"goal_time"'))
    code, out, err = call(capsys, "explain", nod)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "--goal-time" in err
    assert call(capsys, "explain", nod, "--goal-time", "1", "--duration", "1", "--goals", "0.1")[0] == 0
    for words, message in ((("nothere",), "nothere"), (("hop", "--goals", "1:2"), "LOW:HIGH:COUNT")):
        code, out, err = call(capsys, "explain", *words)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert message in err


def test_a_figure_is_explained_in_its_task(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = call(capsys, "explain", "jumper", "--goals", "0.6,-0.8", "--duration", "0.5", "--json")
    assert (code, err) == (0, "")
    said = json.loads(out)
    assert (said["controller"], said["ticks"]) == ("jumper", 50)
    assert said["goals_m"] == pytest.approx([1.0])
    assert [joint["joint"] for joint in said["joints"]] == ["bearing", "lower_leg", "upper_leg", "head"]
    code, out, _ = call(capsys, "explain", "jumper", "--goals", "0.6,-0.8", "--duration", "0.5")
    assert code == 0
    assert "goal velocities in rad/s" in out
    assert "50 ticks" in out
    code, _, err = call(capsys, "explain", "jumper", "--goal-time", "1")
    assert (code, err) == (2, "robolamp: --goal-time: is for the lamp alone; jumper drives jumper\n")
