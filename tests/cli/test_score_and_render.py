"""`robolamp score` and `robolamp render`: poles, times to take, controllers that see all."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from .test_main import call


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "c.toml"


def written(path: Path, ankle: str, knee: str) -> Path:
    """A controller of two joints' texts; the neck keeps still."""
    path.write_text(f'schema = 1\nname = "c"\n[joints]\nankle = "{ankle}"\nknee = "{knee}"\nneck = "0"\n')
    return path


def test_a_pole_is_scored(capsys: pytest.CaptureFixture[str], path: Path) -> None:
    words = ("score", written(path, "(* 0.4 goal_dist)", "0.1"), "--goals", "0.01:0.6:2", "--duration", "1")
    assert "pole_hits" not in json.loads(call(capsys, *words, "--json")[1])
    said = json.loads(call(capsys, *words, "--pole", "19cm", "--pole-at", "0.101", "--json")[1])
    assert (said["pole_hits"], said["upright"], said["runs"]) == (1, 2, 2)
    assert said["median_abs_error_m"] == pytest.approx(0.3, abs=0.05)
    assert said["flight_share_median"] is None
    assert json.loads(call(capsys, *words, "--pole", "0.5", "--json")[1])["pole_hits"] == 0
    code, out, err = call(capsys, *words, "--pole", "190 mm", "--pole-at", "0.101")
    assert (code, err) == (0, "")
    assert "a pole 19.0 cm high at 10 cm" in out
    assert "1 pole hit;" in out


def test_a_time_to_take_is_scored(capsys: pytest.CaptureFixture[str], path: Path) -> None:
    timed = written(path, "(ifltz (- goal_time 1) 0 0.6)", "(ifltz (- goal_time 1) 0 -1)")
    words = ("score", timed, "--goals", "0.3", "--duration", "2", "--json")
    assert [json.loads(call(capsys, *words, "--goal-time", time)[1])["falls"] for time in ("0.9", "1.1")] == [0, 1]


@pytest.mark.parametrize(("ankle", "knee", "falls"), [("(* 0.1 px)", "0", 0), ("(- 0 (* 2 px))", "-1", 1)])
def test_pictures_of_controllers_that_see_all(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, path: Path, ankle: str, knee: str, falls: int
) -> None:
    words = ("--duration", "2", "--pole", "30cm", "--json")
    sees = written(path, ankle, knee)
    picture = tmp_path / "strip.png"
    code, out, err = call(capsys, "render", sees, "-o", picture, "--goal", "0.3", "--no-opengl", *words)
    assert (code, err) == (0, "")
    with Image.open(picture) as image:
        assert image.size == (8 * 224 - 4, 284)
    assert 0 < json.loads(out)["duration_s"] <= 2
    assert json.loads(call(capsys, "score", sees, "--goals", "0.3", *words)[1])["falls"] == falls


def test_a_picture_shows_what_is_scored(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ("--duration", "4", "--json")
    strip = tmp_path / "a.png"
    drawn = json.loads(call(capsys, "render", "hop", "-o", strip, "--goal", "20cm", "--no-opengl", *words)[1])
    scored = json.loads(call(capsys, "score", "hop", "--goals", "20cm", *words)[1])
    assert drawn["travel_m"] == pytest.approx(0.2 + scored["errors_m"][0], abs=0.002)
