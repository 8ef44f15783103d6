"""The spread: what its laws draw, that each number has chance of its own, and that a wrong file is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.errors import FileError
from robolamp.twin.variation.spread import Law, Spread, load_spread

ASSETS = Assets()


def many(key: str, law: Law, count: int = 4000, scale: float = 1.0) -> np.ndarray:
    return np.array([Spread("one", {key: law}).draw(seed, 1, scale)[key] for seed in range(count)]).ravel()


@pytest.mark.parametrize(
    ("key", "law", "middle", "deviation"),
    [
        ("strength", Law("factor", 0.05), 0.0, 0.05),
        ("backlash", Law("median", 0.005, 0.4), math.log(0.005), 0.4),
        ("stiffness", Law("median", 23.0, 0.27), math.log(23.0), 0.27),
    ],
)
def test_logarithms_are_normal_and_cut_off(key: str, law: Law, middle: float, deviation: float) -> None:
    drawn = np.log(many(key, law))
    assert drawn.mean() == pytest.approx(middle, abs=0.06 * deviation)
    assert drawn.std() == pytest.approx(deviation, rel=0.05)
    assert np.abs(drawn - middle).max() <= 3 * deviation + 1e-12


@pytest.mark.parametrize(
    ("key", "law", "middle"),
    [
        ("delay", Law("normal", 0.002), 0.0),
        ("temperature", Law("normal", 4.0), 30.0),
        ("mass", Law("relative", 0.02), 1.0),
    ],
)
def test_numbers_are_normal_about_what_is_off(key: str, law: Law, middle: float) -> None:
    drawn = many(key, law)
    assert drawn.mean() == pytest.approx(middle, abs=0.06 * law.low)
    assert drawn.std() == pytest.approx(law.low, rel=0.05)
    assert np.abs(drawn - middle).max() <= 3 * law.low + 1e-12


def test_others_are_even_between_two_ends() -> None:
    drawn = many("floor_softness", Law("between", 1.0, 2.5))
    assert (drawn.min(), drawn.mean(), drawn.max()) == pytest.approx((1.0, 1.75, 2.5), abs=0.02)


def test_scale_shrinks_every_deviation_and_0_is_none() -> None:
    laws = load_spread(ASSETS)
    whole, half, none = (laws.draw(3, 3, scale) for scale in (1.0, 0.5, 0.0))
    np.testing.assert_allclose(np.log(half["backlash"] / 0.005), np.log(whole["backlash"] / 0.005) / 2)
    np.testing.assert_allclose(np.log(half["strength"]), np.log(whole["strength"]) / 2)
    assert half["stiffness"] == pytest.approx(math.sqrt(23.0 * whole["stiffness"]))
    assert half["floor_softness"] - 1 == pytest.approx((whole["floor_softness"] - 1) / 2)
    assert none["stiffness"] == pytest.approx(23.0)
    assert none["backlash"] == pytest.approx([0.005] * 3)
    assert none["temperature"] == 30.0


def test_a_law_more_leaves_the_others_draws_as_they_were() -> None:
    whole = load_spread(ASSETS)
    for key, law in whole.laws.items():
        np.testing.assert_array_equal(Spread("one", {key: law}).draw(7, 3)[key], whole.draw(7, 3)[key])
    values = [np.ravel(whole.draw(7, 3)[key])[0] for key in whole.laws]
    assert len(set(values)) == len(values)


def test_the_narrow_spread_differs_in_six_numbers() -> None:
    drawn = load_spread(ASSETS, "spread-narrow").draw(1, 3)
    assert drawn.keys() - {"seed"} == {"strength", "friction", "mass", "floor_friction", "delay", "supply"}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("strenth = { factor = 0.1 }", "strenth: no such key; expected one of strength, friction"),
        ("strength = 0.1", "strength: 0.1 is not a table"),
        ("strength = { normal = 0.1 }", "strength: expected a table with low or factor or relative"),
        (
            "strength = { factor = 0.1, low = 0.0, high = 1.0 }",
            "strength: expected a table with low or factor or relative",
        ),
        ("strength = { factor = 0.9 }", "strength.factor: 0.9"),
        ("strength = { factor = -0.1 }", "strength.factor: -0.1"),
        ("strength = { factor = 0.1, sd = 1 }", "strength.sd"),
        ("stiffness = { median = 23.0 }", "stiffness.factor: missing"),
        ("resistance = { low = 0.2, high = 0.1 }", "resistance.high: 0.1"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f"schema = 2\n{text}\n")
    with pytest.raises(FileError) as failure:
        load_spread(ASSETS, str(file))
    assert says in str(failure.value)
    assert "\n" not in str(failure.value)
