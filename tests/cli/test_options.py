from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.cli.options import goal_range, length
from robolamp.cli.screen.output import jsonable
from robolamp.errors import RobolampError


@pytest.mark.parametrize(
    ("text", "metres"),
    [("0.30", 0.3), ("30cm", 0.3), ("300 mm", 0.3), ("0.3 m", 0.3), (" .3m ", 0.3), ("3e-1", 0.3), ("5", 5.0)],
)
def test_lengths(text: str, metres: float) -> None:
    assert length(text, "--goal") == pytest.approx(metres, abs=1e-15)


@pytest.mark.parametrize("text", ["", "0", "-0.3", "5.01", "30 inch", "nan", "inf", "1e999", "0.3.1", "cm", "30cmm"])
def test_what_is_no_length_is_refused(text: str) -> None:
    with pytest.raises(RobolampError, match=r"is not a length above 0 m and up to 5 m, as 0\.30 or 30cm") as caught:
        length(text, "--goal")
    assert caught.value.where == "--goal"


@given(st.floats(0.001, 5.0))
def test_a_length_in_any_unit_is_the_same(metres: float) -> None:
    assert length(repr(metres), "") == metres
    assert length(f"{metres * 100!r} cm", "", high=6) == pytest.approx(metres, rel=1e-12)
    assert length(f"{metres * 1000!r}mm", "", high=6) == pytest.approx(metres, rel=1e-12)


def test_ranges_of_goals() -> None:
    assert goal_range("0.05:0.60:56", "").tolist() == np.linspace(0.05, 0.60, 56).tolist()
    assert goal_range("5cm:60cm:3", "") == pytest.approx([0.05, 0.325, 0.60])
    assert goal_range("30cm", "") == pytest.approx([0.3])
    assert goal_range("0.3:0.3:1", "").tolist() == [0.3]


@pytest.mark.parametrize(
    "text", ["0.1:0.2", "0.1:0.2:0", "0.1:0.2:-3", "0.1:0.2:x", "0.2:0.1:3", "a:b:3", "::", "0.1:0.2:1e9"]
)
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(RobolampError):
        goal_range(text, "--goals")


def test_json_has_no_numpy_no_nan_and_no_paths() -> None:
    value = {
        "array": np.array([[1.0, np.nan], [np.inf, 2.0]]), "number": np.int64(3), "flag": np.bool_(True),
        "path": Path("a/b"), "tuple": (1, float("-inf")), 5: None,
    }  # fmt: skip
    assert json.loads(json.dumps(jsonable(value), allow_nan=False)) == {
        "array": [[1.0, None], [None, 2.0]], "number": 3, "flag": True, "path": "a/b", "tuple": [1, None], "5": None,
    }  # fmt: skip
