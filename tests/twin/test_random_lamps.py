"""Lamps drawn around a calibration: from the fit's covariance where it has one, else from spread.toml, to the bit."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import Calibration, Parameter, load_calibration
from robolamp.errors import FileError
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import build
from robolamp.twin.variation.random_lamps import LampLaw
from robolamp.twin.variation.spread import load_spread

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
NOMINAL = load_calibration(ASSETS)
LABELS = ["knee.torque_constant", "knee.resistance", "neck.coulomb"]
SIGMA = np.array([0.01, 0.12, 0.001])
MATRIX = np.outer(SIGMA, SIGMA) * np.array([[1.0, 0.95, 0.2], [0.95, 1.0, 0.1], [0.2, 0.1, 1.0]])
FITTED = """
[joint.knee]
torque_constant = {value = 0.36, unit = "Nm/A", stderr = 0.01}
resistance = {value = 3.5, unit = "Ohm", stderr = 0.12}

[joint.neck]
coulomb = {value = 0.01, unit = "Nm", stderr = 0.001}

[provenance.covariance]
"""


def fitted(folder: Path, parameters: object = LABELS, matrix: object = MATRIX.tolist()) -> Calibration:
    file = folder / "mine.toml"
    text = f"{FITTED}parameters = {parameters}\nmatrix = {matrix}\n".replace("'", '"')
    file.write_text(NOMINAL.source + text)
    return load_calibration(ASSETS, file)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_without_a_covariance_lamps_are_those_of_the_spread_to_the_bit(scale: float) -> None:
    law, spread = LampLaw(LAMP, NOMINAL, ASSETS), load_spread(ASSETS)
    first, second = np.random.default_rng(3), np.random.default_rng(3)
    for _ in range(5):
        numbers, bend = law.draw(first, scale)
        expected = spread.draw(int(second.integers(2**32)), 3, scale)
        assert numbers.groups == NOMINAL.groups
        for name in expected.keys() & vars(bend).keys():
            assert np.array_equal(getattr(bend, name), expected[name]), name
    assert law.source == "spread.toml"


def test_a_lamp_has_the_play_and_stiffness_of_the_spread_or_of_its_own_fit(tmp_path: Path) -> None:
    groups = {name: dict(parameters) for name, parameters in fitted(tmp_path).groups.items()}
    groups["lamp"]["arm_stiffness"] = Parameter(50.0, "Nm/rad", None, "")
    groups["joint knee"]["backlash"] = Parameter(0.002, "rad", None, "")
    told = replace(fitted(tmp_path), groups=groups)
    guessed = replace(told, provenance={})
    for calibration, of_the_spread in ((told, False), (guessed, True)):
        numbers, bend = LampLaw(LAMP, calibration, ASSETS).draw(np.random.default_rng(1))
        twin = build(LAMP, numbers, ASSETS, bend)
        assert math.isfinite(bend.stiffness) is of_the_spread
        assert np.isfinite(bend.backlash).all() == of_the_spread
        assert twin.gears.table[1, 0] == pytest.approx((np.ravel(bend.backlash)[1] if of_the_spread else 0.002) / 2)


def test_lamps_are_drawn_from_the_fits_covariance(tmp_path: Path) -> None:
    law, rng = LampLaw(LAMP, fitted(tmp_path), ASSETS), np.random.default_rng(1)
    drawn = [law.draw(rng) for _ in range(4000)]
    values = np.array([
        [
            numbers.groups["joint knee"]["torque_constant"].value,
            numbers.groups["joint knee"]["resistance"].value,
            numbers.groups["joint neck"]["coulomb"].value,
        ]
        for numbers, _ in drawn
    ])  # fmt: skip
    assert values.mean(axis=0) == pytest.approx([0.36, 3.5, 0.01], rel=0.005)
    found = np.cov(values.T)
    assert np.sqrt(np.diag(found)) == pytest.approx(SIGMA, rel=0.05)
    assert found[0, 1] / np.sqrt(found[0, 0] * found[1, 1]) == pytest.approx(0.95, abs=0.01)
    strength = np.array([bend.strength for _, bend in drawn])
    friction = np.array([bend.friction for _, bend in drawn])
    assert strength.std(axis=0) == pytest.approx([0.05, 0.0, 0.05], rel=0.05)  # told of the knee alone
    assert friction.std(axis=0) == pytest.approx([0.15, 0.15, 0.0], rel=0.05)
    assert np.std([bend.floor_friction for _, bend in drawn]) == pytest.approx(0.12, rel=0.05)
    assert law.source == "nominal's covariance and spread.toml"
    twin = build(LAMP, drawn[0][0], ASSETS, drawn[0][1])
    assert twin.servos.torque_constant[1] == drawn[0][0].groups["joint knee"]["torque_constant"].value


def test_scale_widens_and_zero_is_the_calibration(tmp_path: Path) -> None:
    calibration = fitted(tmp_path)
    numbers, bend = LampLaw(LAMP, calibration, ASSETS).draw(np.random.default_rng(1), 0.0)
    assert numbers.groups == calibration.groups
    assert np.array_equal(bend.strength, np.ones(3))
    assert math.isnan(bend.stiffness)


def test_of_the_whole_lamp_errors_take_the_place_of_the_spread(tmp_path: Path) -> None:
    calibration = fitted(tmp_path)
    whole = dict(calibration.groups["lamp"])
    whole["mass_scale"] = replace(whole["mass_scale"], stderr=0.005)
    whole["foot_gain"] = replace(whole["foot_gain"], stderr=0.02)
    law = LampLaw(LAMP, replace(calibration, groups={**calibration.groups, "lamp": whole}), ASSETS)
    rng = np.random.default_rng(1)
    drawn = [law.draw(rng) for _ in range(2000)]
    assert np.std([bend.mass for _, bend in drawn]) == pytest.approx(0.005, rel=0.1)
    assert np.std([numbers.lamp("foot_gain") for numbers, _ in drawn]) == pytest.approx(0.02, rel=0.1)


def test_a_spread_of_ones_own_has_any_law_and_a_wider_fit_takes_its_place(tmp_path: Path) -> None:
    calibration = fitted(tmp_path)
    whole = dict(calibration.groups["lamp"])
    whole["supply_voltage"] = replace(whole["supply_voltage"], stderr=0.3)
    whole["floor_friction"] = replace(whole["floor_friction"], stderr=0.008)
    spread = tmp_path / "own.toml"
    spread.write_text("schema = 2\nsupply = { low = 0.1, high = 0.2 }\nfloor_friction = { low = 1.0, high = 1.2 }\n")
    fit = replace(calibration, groups={**calibration.groups, "lamp": whole})
    law, rng = LampLaw(LAMP, fit, ASSETS, str(spread)), np.random.default_rng(1)
    bends = [law.draw(rng)[1] for _ in range(2000)]
    assert np.std([bend.supply for bend in bends]) == pytest.approx(0.3, rel=0.1)
    floors = [bend.floor_friction for bend in bends]
    assert (min(floors), max(floors)) == pytest.approx((1.0, 1.2), abs=0.01)
    assert law.source == "nominal's covariance and own.toml"


def test_a_single_servos_covariance_is_shared_by_the_joints_and_widens_the_spread() -> None:
    calibration = load_calibration(ASSETS, "xl330-m288-bench")
    law, rng = LampLaw(LAMP, calibration, ASSETS), np.random.default_rng(1)
    drawn = [law.draw(rng) for _ in range(500)]
    k = np.array([numbers.servo("XL330-M288-T", "knee")["torque_constant"] for numbers, _ in drawn])
    assert k.std() == pytest.approx(calibration.groups["XL330-M288-T"]["torque_constant"].stderr, rel=0.1)
    assert np.array([bend.strength for _, bend in drawn]).std(axis=0) == pytest.approx([0.05] * 3, rel=0.15)


@pytest.mark.parametrize(
    ("parameters", "matrix", "reason"),
    [
        (["hip.coulomb"], [[1.0]], "'hip.coulomb' is no parameter"),
        (["knee.weight"], [[1.0]], "'knee.weight' is no parameter"),
        (["ankle.coulomb"], [[1.0]], "'ankle.coulomb' is no parameter"),  # legal, but not in the file
        (LABELS, [[1.0]], "not 3 rows of 3 numbers"),
        (LABELS, [["a"] * 3] * 3, "not 3 rows of 3 numbers"),
        (LABELS, np.zeros((3, 3)).tolist(), "diagonal"),
        (LABELS, [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "positive semidefinite"),
        (LABELS, [[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "not symmetric"),
        (3, [], "no list"),
    ],
)
def test_a_malformed_covariance_is_named(parameters: object, matrix: object, reason: str, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=reason):
        LampLaw(LAMP, fitted(tmp_path, parameters, matrix), ASSETS)


def test_an_empty_covariance_is_none(tmp_path: Path) -> None:
    assert LampLaw(LAMP, fitted(tmp_path, [], []), ASSETS).source == "spread.toml"
