"""The command line: help, scores, runs, and one line for every kind of bad input."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets, shipped
from robolamp.cli.main import main

CONTROLLER = """
schema = 1
name = "nod"
[joints]
ankle = "0"
knee = "0"
neck = "(* 0.2 (ifltz (- 0.5 t) 1 -1))"
"""


@pytest.fixture
def nod(tmp_path: Path) -> Path:
    path = tmp_path / "nod.toml"
    path.write_text(CONTROLLER)
    return path


def call(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of one command."""
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


VERBS = (
    "dry-run",
    "deploy",
    "stop",
    "monitor",
    "setup",
    "emulate",
    "evolve",
    "explain",
    "score",
    "study",
    "compare",
    "replay",
    "render",
)


def test_help_names_every_verb_and_loads_nothing_heavy() -> None:
    code = (
        "import sys; from robolamp.cli.main import main\n"
        "try: main(['--help'])\nexcept SystemExit as end: code = end.code\n"
        "print(sorted({'mujoco', 'numba', 'numpy', 'serial', 'matplotlib'} & set(sys.modules)), code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for verb in VERBS:
        assert verb in done.stdout
    assert done.stdout.rstrip().endswith("[] 0")


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(capsys: pytest.CaptureFixture[str], verb: str) -> None:
    code, out, err = call(capsys, verb, "--help")
    assert (code, err) == (0, "")
    assert f"robolamp {verb}" in out
    assert "--json" in out


def test_scores_have_an_entry_a_goal(capsys: pytest.CaptureFixture[str], nod: Path) -> None:
    code, out, err = call(capsys, "score", nod, "--goals", "0.01:0.4:4", "--duration", "1", "--json")
    assert (code, err) == (0, "")
    said = json.loads(out)
    np.testing.assert_allclose(said["goals_m"], np.linspace(0.01, 0.4, 4))
    assert np.shape(said["errors_m"]) == np.shape(said["hops"]) == np.shape(said["flight_share"]) == (4,)
    assert all(isinstance(hops, int) for hops in said["hops"])
    np.testing.assert_allclose(said["errors_m"], -np.array(said["goals_m"]), atol=0.01)  # it nods where it stands
    assert said["flight_share"] == [None] * 4
    assert (said["hits"], said["hits_1997"], said["falls"]) == (1, 1, 0)
    assert out.count("\n") == 1


def test_scores_over_a_spread_have_a_leading_axis_of_lamps(capsys: pytest.CaptureFixture[str], nod: Path) -> None:
    words = ("score", nod, "--goals", "0.1:0.4:2", "--duration", "1", "--json", "--lamps", "3")
    first = json.loads(call(capsys, *words)[1])
    assert np.shape(first["errors_m"]) == np.shape(first["hops"]) == np.shape(first["flight_share"]) == (3, 2)
    assert np.shape(first["goals_m"]) == (2,)
    assert len({row[0] for row in first["errors_m"]}) == 3
    assert json.loads(call(capsys, *words, "--workers", "1")[1]) == first
    assert json.loads(call(capsys, *words, "--seed", "2")[1])["errors_m"] != first["errors_m"]
    none = json.loads(call(capsys, *words, "--spread", "0")[1])
    assert len({row[0] for row in none["errors_m"]}) == 1
    narrow = json.loads(call(capsys, *words, "--spread-file", "spread-narrow")[1])
    assert (first["drawn_from"], narrow["drawn_from"]) == ("spread.toml", "spread-narrow.toml")
    assert narrow["errors_m"] != first["errors_m"]


def test_one_lamp_drawn_is_not_the_calibrated_one(capsys: pytest.CaptureFixture[str], nod: Path) -> None:
    words = ("score", nod, "--goals", "0.2", "--duration", "1", "--json")
    drawn = json.loads(call(capsys, *words, "--lamps", "1")[1])
    assert np.shape(drawn["errors_m"]) == (1, 1)
    assert drawn["errors_m"][0][0] != json.loads(call(capsys, *words)[1])["errors_m"][0]


def test_scores_for_people(capsys: pytest.CaptureFixture[str], nod: Path) -> None:
    code, out, err = call(capsys, "score", nod, "--goals", "0.1:0.4:20", "--duration", "1")
    assert (code, err) == (0, "")
    assert "\n12 of 20 goals are shown; an error below 0 is short of the goal.\n" in out
    assert "nod on the twin" in out
    assert "20 runs: 0 hits" in out


def test_a_controller_that_falls_is_scored_not_refused(capsys: pytest.CaptureFixture[str], nod: Path) -> None:
    nod.write_text(CONTROLLER.replace('ankle = "0"', 'ankle = "0.6"').replace('knee = "0"', 'knee = "(- 0 1)"'))
    said = json.loads(call(capsys, "score", nod, "--goals", "0.3", "--duration", "2", "--json")[1])
    assert (said["falls"], said["hits"]) == (1, 0)


def test_a_run_from_the_command_line(capsys: pytest.CaptureFixture[str], tmp_path: Path, nod: Path) -> None:
    words = ("evolve", "hop", "-o", tmp_path / "run", "--population", "4", "--generations", "2", "--seed-from", nod)
    code, out, err = call(capsys, *words, "--seed", "3", "--json")
    assert (code, err) == (0, "")
    said = json.loads(out)
    assert said.keys() >= {
        "controller", "best_fitness", "individuals", "physics_steps", "physics_s", "wall_s", "generations",
    }  # fmt: skip
    assert said["individuals"] == 8
    assert said["physics_s"] <= said["wall_s"]
    assert Path(said["controller"]).is_file()
    assert len((tmp_path / "run" / "progress.jsonl").read_text().splitlines()) == 2
    code, out, err = call(capsys, *words)
    assert (code, out) == (2, "")
    assert err.startswith(f"robolamp: {tmp_path / 'run'}: holds a run already")
    code, _, err = call(capsys, "score", said["controller"], "--goals", "0.3", "--duration", "1")
    assert (code, err) == (0, "")


def test_progress_for_people(capsys: pytest.CaptureFixture[str], tmp_path: Path, nod: Path) -> None:
    code, out, err = call(
        capsys, "evolve", "hop", "-o", tmp_path / "run", "--population", "2", "--generations", "1", "--seed-from", nod
    )
    assert code == 0
    assert "Controller:" in out
    assert "generation" in err
    assert "evolution" in err


NO_PORT = Assets().path("hardware/lamp.toml").read_text().replace("/dev/ttyUSB0", "")
VERBS = ("evolve", "render", "compare", "dry-run", "deploy")


def bad_inputs() -> list:
    broken = CONTROLLER.replace('ankle = "0"', 'ankle = "(+ 0"')
    unknown = CONTROLLER.replace('ankle = "0"', 'ankle = "q7"')
    period = CONTROLLER.replace('name = "nod"', 'name = "nod"\ncontrol_period = 0.003')
    timed = CONTROLLER.replace('ankle = "0"', 'ankle = "(* 0.1 goal_time)"')
    sees = CONTROLLER.replace('ankle = "0"', 'ankle = "px"')
    return [
        pytest.param(words, files, message, id=message[:40])
        for words, files, message in (
            ("hop --no-such-option", {}, "command line: Unknown option"),
            ("hop --goals 0.3:0.1:2", {}, "--goals: '0.3:0.1:2': 0.3 m is above 0.1 m"),
            ("hop --goals far", {}, "--goals: 'far' is not a length above 0 m and up to 5 m"),
            ("hop --goals 0.1:0.2", {}, "--goals: '0.1:0.2' is not LOW:HIGH:COUNT"),
            ("hop --lamps 0", {}, "command line: Invalid value"),
            ("hop --duration nan", {}, "Must be a number from 0.5 to 600 (seconds)."),
            ("hop --duration 0.4", {}, "Must be a number from 0.5 to 600 (seconds)."),
            ("hop --goals 0.1:0.2:²", {}, "--goals: '0.1:0.2:²' is not LOW:HIGH:COUNT"),
            ("hop --goals 0.1:0.2:" + "1" * 5000, {}, "is not LOW:HIGH:COUNT"),
            ("hop --spread 0.5", {}, "--spread: is for lamps that are drawn; give --lamps, too"),
            ("hop --seed 4", {}, "--seed: is for lamps that are drawn; give --lamps, too"),
            ("hop --spread-file spread", {}, "--spread-file: is for lamps that are drawn; give --lamps, too"),
            (
                "hop --lamps 2 --spread-file wide",
                {},
                "wide: no such spread; give a file, or one of: spread, spread-narrow",
            ),
            (
                "hop --lamps 2 --spread-file hop",
                {},
                "hop: no such spread; give a file, or one of: spread, spread-narrow",
            ),
            ("hop --pole low", {}, "--pole: 'low' is not a length above 0.02 m and up to 1 m"),
            ("hop --pole 1cm", {}, "--pole: '1cm' is not a length above 0.02 m and up to 1 m"),
            ("hop --pole 0.2 --pole-at 9cm", {}, "--pole-at: '9cm' is not a length above 0.1 m and up to 5 m"),
            ("hop --pole-at 0.3", {}, "--pole-at: says where a pole is; give its height with --pole, too"),
            ("hop --goal-time 0", {}, "Must be a number from 0.1 to 600 (seconds)."),
            ("hop --goal-time nan", {}, "Must be a number from 0.1 to 600 (seconds)."),
            (
                "c.toml",
                {"c.toml": timed},
                "nod: joints.ankle: reads goal_time, the time to take; give it by --g",
            ),
            ("render c.toml -o c.png", {"c.toml": timed}, "nod: joints.ankle: reads goal_time"),
            ("dry-run c.toml --goal 0.3", {"c.toml": timed}, "nod: joints.ankle: reads goal_time"),
            ("deploy c.toml --goal 0.3", {"c.toml": timed}, "nod: joints.ankle: reads goal_time"),
            ("render log.mcap -o c.png --pole 0.2", {}, "--pole: is for a controller; no log has a pole"),
            ("hop --lamp=", {}, "--lamp: is empty; expected a value"),
            ("hop --lamp " + "x" * 300, {}, "File name too long"),
            ("hop --lamp .", {"hardware/lamp.toml/x": ""}, "hardware/lamp.toml: is a folder; expected a file"),
            ("compare .", {}, ".: holds no log (.mcap) that can be compared"),
            (
                "evolve spread -o run",
                {},
                "spread: no such task; give a file, or one of: hop, hop-sighted, jumper,",
            ),
            ("evolve hop -o " + "x" * 300, {}, "File name too long"),
            ("dry-run hop --goal 0.3 -o " + "x" * 300, {}, "File name too long"),
            ("deploy hop --goal 0.3 --lamp .", {"hardware/lamp.toml": NO_PORT}, "bus.port: '' is not a serial port"),
            ("hop --calibration none", {}, "none: no such calibration; give a file, or one of: bending, nominal"),
            ("hop --lamp none", {}, "none: is not a folder"),
            ("none.toml", {}, "none.toml: no such controller; give a file, or one of: "),
            ("c.toml", {"c.toml": "x = ["}, "c.toml: not valid TOML"),
            ("c.toml", {"c.toml": broken}, "c.toml: joints.ankle: found the end at line 1, column 5"),
            ("c.toml", {"c.toml": unknown}, "c.toml: joints.ankle: found 'q7' at line 1, column 1; expected a number"),
            ("c.toml", {"c.toml": period}, "control_period: 0.003 s is not a whole number of physics steps"),
            ("hop --lamp .", {"hardware/lamp.toml": "name = 1"}, "hardware/lamp.toml: bus: missing"),
            ("hop --lamp .", {"sim/lamp/scene.xml": "<mujoco"}, "sim/lamp/scene.xml: not a MuJoCo model"),
            ("hop --lamp . --lamps 2", {"sim/tasks/spread.toml": ""}, "sim/tasks/spread.toml: schema: missing"),
            ("hop --calibration c.toml", {"c.toml": "schema = 1"}, "c.toml: lamp: missing"),
            ("evolve juggle -o run", {}, "juggle: no such task; give a file, or one of: hop"),
            ("evolve hop -o run --population 0", {}, "command line: Invalid value"),
            ("evolve hop -o c.toml", {"c.toml": ""}, "--output c.toml: is not a folder"),
            ("evolve hop -o run --seed-from c.toml", {"c.toml": sees}, "c.toml: joints.ankle: needs px"),
            ("evolve hop -o c.toml/run", {"c.toml": ""}, "c.toml/run"),
            ("render hop -o c.jpg", {}, "--output: 'c.jpg' does not end in .png, .gif or .mp4"),
        )
    ]


@pytest.mark.parametrize(("words", "files", "message"), bad_inputs())
def test_bad_input_is_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, files: dict,
    message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    before = sorted(tmp_path.rglob("*"))
    arguments = words.split() if words.split(maxsplit=1)[0] in VERBS else ["score", *words.split()]
    code, out, err = call(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("robolamp: ")
    assert err.count("\n") == 1
    assert message in err
    code, out, err = call(capsys, *arguments, "--json")
    assert (code, err) == (2, "")
    said = json.loads(out)
    assert said.keys() == {"error", "where"}
    assert message in f"{said['where']}: {said['error']}"
    assert sorted(tmp_path.rglob("*")) == before  # nothing half-written


@pytest.mark.parametrize(
    ("words", "where"),
    [
        (["compare", ""], "an argument"),
        (["dry-run", "hop", "--goal", "0.3", "-o", ""], "-o"),
        (["score", "hop", "--lamp", ""], "--lamp"),
        (["deploy", "hop", "--goal", "0.3", "--port", ""], "--port"),
    ],
)
def test_an_empty_argument_is_not_the_current_folder(
    capsys: pytest.CaptureFixture[str], words: list[str], where: str
) -> None:
    assert call(capsys, *words) == (2, "", f"robolamp: {where}: is empty; expected a value\n")


def test_brackets_in_a_path_are_not_markup(capsys: pytest.CaptureFixture[str], tmp_path: Path, nod: Path) -> None:
    folder = tmp_path / "[a]" / "[/b]"
    code, out, _ = call(
        capsys, "evolve", "hop", "-o", folder, "--population", "2", "--generations", "1", "--seed-from", nod
    )
    assert code == 0
    assert f"Controller: {folder / 'controller.toml'}" in out
    code, out, err = call(capsys, "score", folder / "controller.toml", "--goals", "0.3", "--duration", "1")
    assert (code, err) == (0, "")
    assert "1 run: " in out
    assert re.search(r"^b-? \((evolved|by hand)\) on the twin", out, re.MULTILINE)


SCORE = [sys.executable, "-m", "robolamp", "score", "hop", "--goals", "0.3", "--duration", "1"]


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_a_full_disk_behind_stdout_is_one_line(more: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([*SCORE, *more], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_a_reader_that_left_is_met_in_silence(more: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([*SCORE, *more], stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert done.returncode in (1, 141)
    assert done.stderr == ""


@pytest.mark.parametrize("delay", [0.05, 0.15, 0.3, 0.6])
@pytest.mark.parametrize("words", [["score", "hop"], ["emulate"]])
def test_ctrl_c_while_loading_ends_without_a_traceback(delay: float, words: list[str]) -> None:
    code = f"""
import sys
sys.argv[1:] = {words}
from robolamp.cli import entry
settle = entry.settle_streams
entry.settle_streams = lambda: (settle(), print(flush=True))  # signals are taken over: from here on it loads
entry.main()
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout
        process.stdout.readline()
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode in ((0, 130) if words == ["emulate"] else (130,))  # Ctrl-C is how an emulator ends
    assert b"Traceback" not in err
    assert b"ignored" not in err


def test_what_a_file_or_a_name_holds_stays_on_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, nod: Path
) -> None:
    lamp = tmp_path / "hardware" / "lamp.toml"
    lamp.parent.mkdir()
    text = (shipped() / "hardware" / "lamp.toml").read_text()
    lamp.write_text(text.replace('name = "ankle"', 'name = "a\\nb\\u001b[31m\\u202e"'))
    for words in (("score", nod, "--lamp", tmp_path), ("score", "no\nsuch\x1b[31m\u202e")):
        code, out, err = call(capsys, *words)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "\\n" in err
        assert "\\x1b[31m\\u202e" in err
        assert "\x1b" not in err
