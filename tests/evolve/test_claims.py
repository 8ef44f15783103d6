"""The rules on made-up results: each verdict can be reached, and none by too few runs."""

from __future__ import annotations

import math
import statistics

import numpy as np
import pytest

from robolamp.evolve.study import claims
from robolamp.evolve.study.claims import AGREES, DISAGREES, UNKNOWN, Noise, Shares

SPREAD = (-0.03, 0.0, 0.03)


def around(**medians: float) -> dict[str, list[float]]:
    """Three seeds a point, close to a median; a leading underscore keeps numbers legal names."""
    return {name.lstrip("_"): [median + step for step in SPREAD] for name, median in medians.items()}


def wide(**medians: float) -> dict[str, list[float]]:
    return {name.lstrip("_"): [median + 20 * step for step in SPREAD] for name, median in medians.items()}


def verdicts(found: list[claims.Verdict]) -> list[str]:
    return [each.verdict for each in found]


def test_noise_is_pooled_over_points_and_bounds_differences_as_documented() -> None:
    results = {"a": [1.0, 1.2], "b": [2.0, 2.1, 2.5], "c": [9.0]}
    noise = Noise(results)
    within = statistics.variance(results["a"]) + 2 * statistics.variance(results["b"])
    assert noise.deviation == pytest.approx(math.sqrt(within / 3))
    assert noise.clear(2, 3) == pytest.approx(2 * 1.2533 * noise.deviation * math.sqrt(1 / 2 + 1 / 3), rel=1e-4)
    assert math.isnan(Noise({"a": [1.0], "b": [2.0]}).deviation)


def test_the_bound_is_two_standard_errors_of_a_difference_of_medians() -> None:
    draws = np.random.default_rng(1).normal(size=(20_000, 2, 25))
    differences = np.diff(np.median(draws, axis=2), axis=1)
    noise = Noise({"a": [0.0, math.sqrt(2)]})  # of standard deviation 1
    assert noise.clear(25, 25) == pytest.approx(2 * differences.std(), rel=0.03)


@pytest.mark.parametrize(
    ("results", "relation"),
    [
        (around(a=0.4, b=0.9), "better"),
        (around(a=0.9, b=0.4), "worse"),
        (around(a=0.5, b=0.55), "alike"),
        (around(a=0.5, b=0.62) | wide(c=0.5), "unclear"),  # further apart than alike, within the noise
        (wide(a=0.5, b=0.5), "unclear"),  # nothing is alike in such noise
        ({"a": [0.1], "b": [0.9]}, "unclear"),
        ({"a": [0.30, 0.301], "b": [0.35, 0.351]}, "alike"),  # clearly apart, by what nobody sees
    ],
)
def test_two_points_compared(results: dict[str, list[float]], relation: str) -> None:
    assert Noise(results).compare(["a"], ["b"]) == relation


@pytest.mark.parametrize(
    ("results", "fails", "alike"),
    [
        (around(_10=1.5, _150=1.0, _200=0.5, _400=0.48), AGREES, AGREES),
        (around(_10=1.5, _150=0.5, _200=0.5, _400=0.9), DISAGREES, DISAGREES),
        (around(_150=1.0, _200=0.5), AGREES, UNKNOWN),
        (around(_10=1.5, _150=1.0), UNKNOWN, UNKNOWN),
        (wide(_150=1.0, _200=0.5, _400=0.5), UNKNOWN, UNKNOWN),
        ({"150": [1.0], "200": [0.5], "300": [0.5]}, UNKNOWN, UNKNOWN),
        ({}, UNKNOWN, UNKNOWN),
    ],
)
def test_population(results: dict[str, list[float]], fails: str, alike: str) -> None:
    assert verdicts(claims.population(results)) == [fails, alike]


@pytest.mark.parametrize(
    ("results", "verdict"),
    [
        (around(_10=1.0, _30=0.5, _100=0.55), AGREES),
        (around(_10=1.0, _30=0.5, _100=0.8), AGREES),
        (around(_10=1.0, _30=0.5, _100=0.3), DISAGREES),
        (around(_10=0.5, _30=0.5, _100=0.5), DISAGREES),
        (wide(_10=1.0, _30=0.5, _100=0.5), UNKNOWN),
        (around(_10=1.0, _100=0.5), UNKNOWN),
        (around(_30=1.0), UNKNOWN),
        ({}, UNKNOWN),
    ],
)
def test_generations(results: dict[str, list[float]], verdict: str) -> None:
    assert verdicts(claims.generations(results)) == [verdict]


@pytest.mark.parametrize(
    ("results", "beat", "alike"),
    [
        (around(proportionate=1.0, _2=0.5, _6=0.5, _20=0.52), AGREES, AGREES),
        (around(proportionate=1.0, _2=1.0, _6=0.5, _20=0.5), DISAGREES, DISAGREES),
        (around(proportionate=1.0, _6=0.5), AGREES, UNKNOWN),
        (around(_2=0.5, _6=0.5), UNKNOWN, AGREES),
        (wide(proportionate=1.0, _2=0.6, _6=0.5), UNKNOWN, UNKNOWN),
        ({}, UNKNOWN, UNKNOWN),
    ],
)
def test_selection(results: dict[str, list[float]], beat: str, alike: str) -> None:
    assert verdicts(claims.selection(results)) == [beat, alike]


@pytest.mark.parametrize(
    ("results", "verdict"),
    [
        (around(_0=2.0, _50=0.5, _90=0.52, _100=0.5), AGREES),
        (around(_0=2.0, _50=0.9, _90=0.5, _100=0.5), DISAGREES),
        (wide(_0=2.0, _50=0.5, _90=0.5), UNKNOWN),
        (around(_0=2.0, _90=0.5), UNKNOWN),
        (around(_0=2.0), UNKNOWN),
    ],
)
def test_crossover(results: dict[str, list[float]], verdict: str) -> None:
    assert verdicts(claims.crossover(results)) == [verdict]


@pytest.mark.parametrize(
    ("results", "verdict"),
    [
        (around(first=0.5, tuned=0.5), AGREES),
        (around(first=0.9, tuned=0.5), AGREES),
        (around(first=0.5, tuned=0.9), DISAGREES),
        (wide(first=0.5, tuned=0.5), UNKNOWN),
        (around(first=0.5), UNKNOWN),
    ],
)
def test_tuned(results: dict[str, list[float]], verdict: str) -> None:
    assert verdicts(claims.tuned(results)) == [verdict]


def shares(*values: tuple[float, float, bool]) -> list[Shares]:
    return [Shares(*value) for value in values]


SKILLED = shares((0.9, 0.8, True), (0.8, 0.8, True))


@pytest.mark.parametrize(
    ("specific", "robust", "verdict"),
    [
        (shares((0.1, 0.0, True), (0.2, 0.0, True)), SKILLED, AGREES),
        (shares((0.8, 0.0, True), (0.7, 0.0, True)), SKILLED, DISAGREES),
        (shares((0.1, 0.0, True), (0.2, 0.0, False)), SKILLED, UNKNOWN),  # half did not learn even that
        (shares((0.1, 0.0, True)), SKILLED, UNKNOWN),
        (shares((0.0, 0.0, True), (0.0, 0.0, True)), shares((0.2, 0.0, True), (0.2, 0.0, True)), UNKNOWN),
        ([], SKILLED, UNKNOWN),
    ],
)
def test_specific(specific: list[Shares], robust: list[Shares], verdict: str) -> None:
    assert verdicts(claims.specific({"specific": specific, "robust": robust})) == [verdict]


@pytest.mark.parametrize(
    ("robust", "verdict"),
    [
        (SKILLED, AGREES),
        (shares((0.9, 0.3, True), (0.9, 0.2, True)), DISAGREES),
        (shares((0.9, 0.6, True), (0.9, 0.5, True)), UNKNOWN),
        (shares((0.2, 0.2, True), (0.2, 0.2, True)), UNKNOWN),
        (SKILLED[:1], UNKNOWN),
        ([], UNKNOWN),
    ],
)
def test_distance(robust: list[Shares], verdict: str) -> None:
    assert verdicts(claims.distance({"robust": robust})) == [verdict]


def test_a_verdict_tells_its_figures() -> None:
    [told] = claims.tuned(around(first=0.5, tuned=0.9))
    assert "first: 0.500, tuned: 0.900" in told.figures
    assert "standard deviation over seeds 0.030" in told.figures
    [told] = claims.specific({"specific": shares((0.1, 0, True), (0.2, 0, True)), "robust": SKILLED})
    assert "arrive at 15%, the robust ones at 85%" in told.figures
