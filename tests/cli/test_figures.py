"""`robolamp score` and `robolamp render` of figures other than the lamp."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from .test_main import call

JUMPER = ("bearing", "lower_leg", "upper_leg", "head")
STILL = (
    'schema = 1\nname = "still"\nfigure = "{}"\ndrive = "velocity"\ncontrol_period = 0.01\ntask = "{}"\n\n[joints]\n'
)


@pytest.fixture
def still(tmp_path: Path) -> Path:
    """A controller of Jumper's that asks for nothing."""
    path = tmp_path / "still.toml"
    path.write_text(STILL.format("jumper", "jumper") + "".join(f'{name} = "0"\n' for name in JUMPER))
    return path


def test_score_of_a_figure_that_stands_where_it_is(capsys: pytest.CaptureFixture[str], still: Path) -> None:
    code, out, _ = call(capsys, "score", still, "--duration", "1", "--goals", "0.6,-0.8", "--json")
    said = json.loads(out)
    assert code == 0
    assert (said["figure"], said["task"], said["runs"], said["hits"], said["falls"]) == ("jumper", "jumper", 1, 0, 0)
    assert said["goals_m"] == pytest.approx([1.0], abs=1e-3)
    assert said["directions_rad"] == pytest.approx([np.arctan2(-0.8, 0.6)], abs=1e-3)
    assert said["errors_m"] == pytest.approx([1.0], abs=1e-3)
    assert said["fitness"][0] == pytest.approx(1.33, abs=0.03)  # all of the way is left, and it was idle
    assert json.loads(call(capsys, "score", still, "--duration", "1", "--goals", "2cm", "--json")[1])["hits"] == 1


def test_goals_are_drawn_all_around_and_the_same_each_time(capsys: pytest.CaptureFixture[str], still: Path) -> None:
    words = ("score", still, "--duration", "0.5", "--goals", "0.5:1.0:20")
    drawn = [json.loads(call(capsys, *words, *more, "--json")[1]) for more in ((), (), ("--seed", "2"))]
    assert drawn[0] == drawn[1]
    assert drawn[0]["goals_m"] != drawn[2]["goals_m"]
    assert min(drawn[0]["goals_m"]) > 0.49
    assert max(drawn[0]["goals_m"]) < 1.01
    assert np.ptp(drawn[0]["directions_rad"]) > 4.0
    code, out, err = call(capsys, *words)
    assert (code, err) == (0, "")
    assert "20 runs: 0 hits (within 5 cm at the end, upright, nothing hit)" in out


@pytest.mark.parametrize("opengl", ["--opengl", "--no-opengl"])
def test_figure_is_drawn(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, still: Path, opengl: str
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "0")  # the suite has none by default
    path = still.with_suffix(".png")
    code, out, err = call(
        capsys, "render", still, "-o", path, "--goal", "0.2,0.1", "--duration", "0.5", opengl, "--json"
    )
    assert (code, err) == (0, "")
    assert json.loads(out)["travel_m"] == pytest.approx(0.0, abs=1e-3)
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    red, green, blue = picture.transpose(2, 0, 1)
    assert ((red > green + 60) & (green > blue + 10)).sum() > 1000  # Jumper is orange


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--lamps", "3"), "--lamps: is for the lamp alone"),
        (("--pole", "20cm"), "--pole: is for the lamp alone"),
        (("--goals", "1,b"), "--goals: '1,b' is not X,Y in metres"),
        (("--goals", "0,0"), "--goals: '0,0' is not X,Y in metres"),
        (("--task", "hop"), "task hop: is for lamp"),
        (("--task", "madzia"), "task madzia: is for spider"),
        (("--task", "nowhere"), "nowhere: no such task"),
    ],
)
def test_what_a_figure_cannot_be_asked_is_one_line(
    capsys: pytest.CaptureFixture[str], still: Path, words: tuple[str, ...], message: str
) -> None:
    code, out, err = call(capsys, "score", still, *words)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1


def test_controller_of_another_figure_or_joints_is_refused(capsys: pytest.CaptureFixture[str], still: Path) -> None:
    text = still.read_text()
    for old, new, message in (
        ('figure = "jumper"', 'figure = "dog"', "figure 'dog': no such figure"),
        ('head = "0"', 'tail = "0"', "are not jumper's (bearing, lower_leg, upper_leg, head)"),
        ('head = "0"', 'head = "s0"', "found 's0'"),
        ('task = "jumper"\n', "", "names no task; give one with --task"),
    ):
        still.write_text(text.replace(old, new))
        code, _, err = call(capsys, "score", still)
        assert code == 2
        assert message in err
    still.write_text(text)
    code, _, err = call(capsys, "dry-run", still, "--goal", "0.3")
    assert code == 2
    assert "drives 'jumper'; expected a controller for 'lamp'" in err


def test_task_is_for_figures_alone(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = call(capsys, "score", "hop", "--task", "jumper")
    assert (code, err) == (2, "robolamp: --task: is for figures other than the lamp\n")


def test_calibration_is_for_the_lamp_alone(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, _, err = call(capsys, "evolve", "jumper", "-o", tmp_path / "run", "--calibration", "nominal")
    assert (code, err) == (2, "robolamp: --calibration: is for the lamp alone; task jumper is for jumper\n")
    assert not (tmp_path / "run").exists()
