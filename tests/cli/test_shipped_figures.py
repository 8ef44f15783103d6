"""The controllers that ship with the figures do what their READMEs say, on the simulation as it is."""

from __future__ import annotations

import json

import pytest

from .test_main import call


@pytest.mark.parametrize(("name", "words"), [("jumper", ()), ("madzia", ("--duration", "8")), ("madzia-heavy-box", ())])
def test_shipped_controller_reaches_its_goal(
    capsys: pytest.CaptureFixture[str], name: str, words: tuple[str, ...]
) -> None:
    code, out, err = call(capsys, "score", name, *words, "--json")
    said = json.loads(out)
    assert (code, err) == (0, "")
    assert (said["task"], said["runs"], said["hits"], said["falls"]) == (name, 1, 1, 0)


def test_shipped_controller_goes_to_most_points_that_it_was_not_shown(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = call(capsys, "score", "jumper-anywhere", "--goals", "0.5:1.5:100", "--duration", "20", "--json")
    assert json.loads(out)["hits"] >= 60
