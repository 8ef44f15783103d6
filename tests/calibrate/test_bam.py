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
