"""The controllers that ship with the figures do what their READMEs say, on the simulation as it is."""

from __future__ import annotations

import json
from typing import Any

import pytest

from .test_main import call


def told(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """What `robolamp score` says of a shipped controller."""
    code, out, err = call(capsys, "score", *words, "--json")
    assert (code, err) == (0, "")
    return json.loads(out)


@pytest.mark.parametrize("name", ["jumper", "madzia", "madzia-by-hand", "madzia-heavy-box", "madzia-light"])
def test_shipped_controller_reaches_its_goal(capsys: pytest.CaptureFixture[str], name: str) -> None:
    said = told(capsys, name)
    assert (said["task"], said["runs"], said["hits"], said["falls"]) == (name.removesuffix("-by-hand"), 1, 1, 0)


def test_madzia_pulls_the_light_box_goes_over_the_heavy_one_and_jumps_when_light(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pulls, goes, jumps = (told(capsys, name) for name in ("madzia", "madzia-heavy-box", "madzia-light"))
    assert pulls["goal_pulled_m"][0] > 0.15
    assert goes["goal_moved_m"][0] < 0.01
    assert goes["hops"] == pulls["hops"] == [0]
    assert jumps["goal_moved_m"][0] < 0.01
    assert jumps["flight_gain_m"][0] > 0.25  # of 0.5: more than half of the way is flown


def test_shipped_controller_goes_to_points_that_it_was_not_shown(capsys: pytest.CaptureFixture[str]) -> None:
    said = told(capsys, "jumper-anywhere", "--goals", "0.5:1.5:100")
    assert said["hits"] >= 88
    assert said["falls"] <= 2
