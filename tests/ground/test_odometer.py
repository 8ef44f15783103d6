"""The odometer's file: what is written is read again, and what is wrong with it is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import shipped
from robolamp.errors import FileError
from robolamp.odometer import feature_names, format_odometer, load_odometer, parse_odometer, save_odometer

SHIPPED = shipped() / "sim" / "lamp" / "odometer.toml"


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    made = load_odometer(SHIPPED)
    save_odometer(made, tmp_path / "odometer.toml")
    again = load_odometer(tmp_path / "odometer.toml")
    features = made.mean + np.linspace(-2, 2, 7)[:, None] * made.scale
    for before, after in zip(made.measure(features), again.measure(features), strict=True):
        assert np.array_equal(before, after)
    assert again.scores == made.scores
    assert again.provenance == made.provenance
    assert format_odometer(again) == again.source


def test_every_feature_has_a_name_of_its_own() -> None:
    for joints in (1, 3, 5):
        names = feature_names(joints)
        assert len(set(names)) == len(names) == 17 * (2 * joints + 2) + 6 + joints


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("schema = 1", "schema = 2", "schema: 2 is not"),
        ("joints = 3", "joints = 2", "unknown; expected those of 2 joints"),
        ("control_period = 0.02", "control_period = 2.0", "control_period: 2.0 is not a number from 0.002 to 0.1 s"),
        ("correlation = ", "correlation = 1", "correlation: "),
        ("log_variance = [", "log_variance = [1.0, ", "hidden.log_variance: is not 32 finite numbers"),
        ("log_variance = [", "log_variance = [inf, ", "hidden.log_variance: is not 32 finite numbers"),
        ("bias = [", "bias = [] # [", "hidden.bias: has 0 numbers; expected 1 to 256"),
        ("air = [", "air = [true, ", "features.air: is not 36 finite numbers"),
        ("air = [", "hair = [", "features.air: missing; expected those of 3 joints"),
        ("schema = 1", "schema = 1\nmore = 2", "more: unknown; expected one of"),
    ],
)
def test_what_is_wrong_is_named(old: str, new: str, words: str) -> None:
    text = SHIPPED.read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(FileError, match=words) as caught:
        parse_odometer(text.replace(old, new, 1), "o.toml")
    assert caught.value.where == "o.toml"


def test_a_feature_that_never_differs_is_refused() -> None:
    text = SHIPPED.read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if line.startswith("air = "))
    mean, _, *rest = line.removeprefix("air = [").split(", ")
    with pytest.raises(FileError, match=r"features.air: its standard deviation 0 is not above 0"):
        parse_odometer(text.replace(line, f"air = [{', '.join([mean, '0.0', *rest])}"), "o.toml")
