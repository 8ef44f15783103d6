from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from robolamp.assets import Assets
from robolamp.calibration import LAMP, SERVO, Calibration, load_calibration
from robolamp.errors import FileError

SHIPPED = Assets().path("calibration/nominal.toml").read_text()
MODEL = "XL330-M288-T"


def changed(folder: Path, old: str, new: str) -> Calibration:
    assert old in SHIPPED
    path = folder / "bent.toml"
    path.write_text(SHIPPED.replace(old, new, 1))
    return load_calibration(Assets(), path)


def test_the_nominal_calibration_is_complete() -> None:
    nominal = load_calibration(Assets())
    assert nominal.name == "nominal"
    assert nominal.hash == hashlib.sha256(SHIPPED.encode()).hexdigest()
    assert nominal.servo(MODEL, "knee").keys() == SERVO.keys()
    for name, legal in LAMP.items():
        value = nominal.lamp(name)
        assert value == legal.default or legal.low <= value <= legal.high
    assert all(parameter.source for group in nominal.groups.values() for parameter in group.values())


def test_a_joints_own_value_comes_before_its_servo_models(tmp_path: Path) -> None:
    own = '[joint.knee]\nresistance = { value = 4.5, unit = "Ohm", stderr = 0.1 }\n\n[lamp]'
    bent = changed(tmp_path, "[lamp]", own)
    assert bent.servo(MODEL, "knee")["resistance"] == 4.5
    assert bent.servo(MODEL, "ankle")["resistance"] == load_calibration(Assets()).servo(MODEL, "ankle")["resistance"]
    assert bent.groups["joint knee"]["resistance"].stderr == 0.1
    assert bent.groups[MODEL]["resistance"].stderr is None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("value = 5.0", "value = 230.0", "lamp.supply_voltage.value: 230.0 is not a number from 3 to 15 V"),
        (
            "value = 3.4",
            "value = -3.4",
            "resistance.value: -3.4 is not a number from 0.1 to 100 Ohm",
        ),
        ("value = 3.4", "value = nan", "servo.XL330-M288-T.resistance.value: nan is not"),
        ("value = 3.4", "worth = 3.4", "servo.XL330-M288-T.resistance.value: missing; expected a number"),
        ('unit = "Ohm"', 'unit = "kOhm"', "servo.XL330-M288-T.resistance.unit: 'kOhm' is not one of Ohm"),
        ("coulomb =", "columb =", "servo.XL330-M288-T.columb: unknown parameter; expected one of torque_constant,"),
        ("schema = 1", "schema = 9", "schema: 9 is not a whole number from 1 to 1"),
        ("[provenance]", "[history]", "provenance: missing"),
        (
            'value = 3.4, unit = "Ohm"',
            'value = 3.4, stderr = -1, unit = "Ohm"',
            "stderr: -1 is not a number",
        ),
    ],
)
def test_a_missing_or_absurd_value_is_refused_by_file_key_and_legal_range(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    with pytest.raises(FileError) as caught:
        changed(tmp_path, old, new)
    assert str(caught.value).startswith(str(tmp_path / "bent.toml"))
    assert words in str(caught.value)


def test_what_the_file_does_not_hold_is_refused_when_asked_for(tmp_path: Path) -> None:
    line = next(line for line in SHIPPED.splitlines() if line.startswith("armature"))
    with pytest.raises(FileError, match=r"armature: missing; expected a number from 1e-06 to 0\.1 kg m\^2"):
        changed(tmp_path, line, "").servo(MODEL, "knee")
    with pytest.raises(FileError, match=r"servo\.XL430-W250-T\.torque_constant: missing"):
        load_calibration(Assets()).servo("XL430-W250-T", "knee")
    line = next(line for line in SHIPPED.splitlines() if line.startswith("foot_gain"))
    with pytest.raises(FileError, match=r"lamp\.foot_gain: missing; expected a value in 1"):
        changed(tmp_path, line, "").lamp("foot_gain")
