"""What is said of an odometer's way."""

from __future__ import annotations

import math

from robolamp.compare.travel.measured_way import MeasuredWay


def test_it_is_held_against_what_was_travelled() -> None:
    told = MeasuredWay(0.31, 0.01, 0.24)
    assert told.text == "counted 31.0 cm, give or take 1.0; travelled 24.0 cm. That is further off than it says."
    assert math.isclose(told.error, 0.07)
    assert MeasuredWay(0.31, 0.03, 0.24).text.endswith("travelled 24.0 cm.")


def test_nobody_knows_what_was_travelled() -> None:
    told = MeasuredWay(0.31, 0.01, math.nan)
    assert told.text == "counted 31.0 cm, give or take 1.0."
    assert math.isnan(told.error)
