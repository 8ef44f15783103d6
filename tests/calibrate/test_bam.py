"""Parameter files of Rhoban/bam go in and come out again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.main import main

MODEL = "XL330-M288-T"
M6 = {
    "model": "m6", "actuator": "xl330", "kt": 0.31, "R": 2.9, "armature": 0.0021, "q_offset": 0.01,
    "friction_base": 0.008, "friction_viscous": 0.006, "friction_stribeck": 0.004, "dtheta_stribeck": 0.15,
    "alpha": 1.4, "load_friction_motor": 0.2, "load_friction_external": 0.25, "load_friction_motor_stribeck": 0.05,
    "load_friction_external_stribeck": 0.1, "load_friction_motor_quad": 0.005,
}  # fmt: skip


def run(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    return int(ended.value.code or 0)


def test_a_parameter_file_survives_the_way_in_and_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    theirs, ours, back = tmp_path / "m6.json", tmp_path / "mine.toml", tmp_path / "back.json"
    theirs.write_text(json.dumps(M6))
    assert run("calibrate", "bam", theirs, "-o", ours, "--json") == 0
    assert "quadratic" in json.loads(capsys.readouterr().out)["left_out"][0]
    values = load_calibration(Assets(), ours).servo(MODEL, "knee")
    assert (values["torque_constant"], values["stribeck_exponent"]) == (0.31, 1.4)
    assert values["gain_divisor"] == 256.0  # nominal's: BAM's file does not say
    assert run("calibrate", "bam", ours, "-o", back) == 0
    found = json.loads(back.read_text())
    assert {name: found[name] for name in M6 if name in found and name not in ("model", "actuator")} == {
        name: value for name, value in M6.items() if name not in ("model", "actuator", "q_offset")
        and "quad" not in name
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not valid JSON"),
        ('{"model": "m3"}', "model: 'm3' is not one of m1, m2, m5, m6"),
        ('{"model": "m1", "kt": "strong"}', "kt: 'strong' is not a number from 0.02 to 5 Nm/A"),
        ('{"model": "m1", "kt": 0.3, "R": -1}', "R: -1 is not a number"),
    ],
)
def test_a_file_that_is_none_is_refused(
    tmp_path: Path, text: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.json").write_text(text)
    assert run("calibrate", "bam", tmp_path / "x.json", "-o", tmp_path / "out.toml") == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out.toml").exists()


M5 = {name: value for name, value in {**M6, "model": "m5"}.items() if "quad" not in name and name != "q_offset"}
M2 = {name: value for name, value in {**M5, "model": "m2"}.items() if not name.startswith("load_")}
M1 = {name: value for name, value in {**M2, "model": "m1"}.items() if name not in ("dtheta_stribeck", "alpha")
      and "stribeck" not in name}  # fmt: skip


def imported(tmp_path: Path, capsys: pytest.CaptureFixture[str], data: object, *more: str) -> tuple[int, str, Path]:
    file, out = tmp_path / "in.json", tmp_path / "out.toml"
    file.write_text(data if isinstance(data, str) else json.dumps(data))
    code = run("calibrate", "bam", file, "-o", out, *more)
    said = capsys.readouterr()
    return code, said.err + said.out, out


@pytest.mark.parametrize("data", [M1, M2, M5, {**M6, "load_friction_external_quad": 0.0}])
def test_every_model_is_read_and_each_of_its_parameters_is_needed(
    data: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(tmp_path, capsys, data)[0] == 0
    for name in data:
        if name in ("actuator", "q_offset") or "quad" in name:
            continue
        code, said, out = imported(tmp_path, capsys, {key: value for key, value in data.items() if key != name})
        assert code == 2
        if name != "model":
            assert f"{name}: missing; expected it in a file of model {data['model']}" in said
        out.unlink(missing_ok=True)


@pytest.mark.parametrize("actuator", ["mx106", "xl430", "xl330-m077", "", "x", "XL330-M077-T", None, 3, ["xl330"]])
def test_another_actuator_is_refused(actuator: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said, out = imported(tmp_path, capsys, {**M1, "actuator": actuator})
    assert (code, out.exists()) == (2, False)
    assert f"actuator: is of {actuator!r}; expected parameters of XL330-M288-T" in said


@pytest.mark.parametrize("actuator", ["xl330", "XL330", "xl330_m288", "XL330-M288-T"])
def test_the_actuator_asked_for_is_taken(actuator: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported(tmp_path, capsys, {**M1, "actuator": actuator})[0] == 0


def test_a_file_that_names_no_actuator_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said, _ = imported(tmp_path, capsys, {name: value for name, value in M1.items() if name != "actuator"})
    assert code == 0
    assert "names no actuator: taken as one of XL330-M288-T" in said


def test_the_delay_of_newer_files_is_the_delay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said, out = imported(tmp_path, capsys, {**M5, "command_delay": 0.0123})
    assert (code, "left out" in said) == (0, False)
    assert load_calibration(Assets(), out).servo(MODEL, "")["delay"] == 0.0123
    assert run("calibrate", "bam", out, "-o", tmp_path / "BACK.JSON") == 0
    assert json.loads((tmp_path / "BACK.JSON").read_text())["command_delay"] == 0.0123
    code, said, _ = imported(tmp_path, capsys, {**M5, "command_delay": 0.06})
    assert code == 2
    assert "command_delay: 0.06 is not a number from 0 to 0.05 s" in said


def test_what_is_left_out_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = {"q_offset": 0.01, "load_friction_motor": 0.2, "backlash": 0.02, "comment": "Tuesday", "unused": 0.0}
    code, said, out = imported(tmp_path, capsys, {**M1, **more})
    assert code == 0
    for words in (
        "q_offset = 0.01: of BAM's bench", "load_friction_motor = 0.2: no parameter of model m1",
        "backlash = 0.02: no parameter of model m1", "comment = 'Tuesday': no parameter of model m1",
    ):  # fmt: skip
        assert f"left out: {words}" in said
    assert load_calibration(Assets(), out).servo(MODEL, "")["load_motor"] == 0.0


@pytest.mark.parametrize(
    "value", ["NaN", "Infinity", "-Infinity", "-0.001", "1e400", "1" * 400, "null", "true", '"0.1"']
)
@pytest.mark.parametrize("name", ["kt", "friction_viscous", "dtheta_stribeck", "command_delay"])
def test_a_value_that_is_no_sane_number_is_refused(
    name: str, value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = json.dumps({**M2, name: "HERE"}).replace('"HERE"', value)
    code, said, out = imported(tmp_path, capsys, text)
    assert (code, out.exists()) == (2, False)
    assert f"{name}: " in said
    assert "is not a number from" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("data", ["[]", "null", '{"model": ["m1"]}', '{"model": "m1", "model": "m2"}'])
def test_a_file_of_another_shape_is_refused(data: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said, _ = imported(tmp_path, capsys, data)
    assert code == 2
    assert said.count("\n") == 1


def test_odd_values_of_what_is_left_out_do_not_break_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    odd = {"load_friction_motor_quad": "much", "q_offset": [1, 2], "x": {"y": "z" * 1000}}
    code, said, _ = imported(tmp_path, capsys, {**M6, **odd})
    assert code == 0
    assert max(map(len, said.splitlines())) < 200
