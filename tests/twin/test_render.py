from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robolamp.twin.pictures.render import animation, qpos_of, side_view, strip, strips

from .parts import TWIN

POSES = np.stack(
    [qpos_of(TWIN, (x, 0.0, 0.0), np.array(angle)) for x, angle in ((0, (0, 0, 0)), (0.1, (0.3, -0.8, 0.3)))]
)


def alive(picture: np.ndarray) -> bool:
    """Whether there is a lamp in it: light and dark, many colours."""
    return picture.std() > 15 and len(np.unique(picture.reshape(-1, 3), axis=0)) > 50


@pytest.mark.parametrize("opengl", [True, False], indirect=True)
def test_a_strip_shows_every_pose_side_by_side(opengl: bool) -> None:
    picture = strip(TWIN, POSES, ["0.0 s", "0.5 s"], width=120, height=140, opengl=opengl)
    assert picture.shape == (140 + 24, 2 * 120 + 4, 3)
    assert picture.dtype == np.uint8
    left, right = picture[:140, :120], picture[:140, 124:]
    assert alive(left)
    assert alive(right)
    assert (left != right).mean() > 0.02
    label = picture[140:, :120]
    assert label.min() < 100
    assert label.max() > 250


def test_without_opengl_the_strip_is_drawn_and_nothing_fails() -> None:
    code = """
import numpy as np
from twin.parts import TWIN
from robolamp.twin.pictures.render import Camera, RenderUnavailableError, qpos_of, side_view, strip
pose = qpos_of(TWIN, (0, 0, 0), np.zeros(3))
try:
    Camera(TWIN, 60, 60)
except RenderUnavailableError:
    drawn = strip(TWIN, pose[None], ["x"], width=60, height=60)
    print((drawn[:60] == side_view(TWIN, pose, 60, 60)).all())
"""
    environment = {**os.environ, "MUJOCO_GL": "disabled", "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")


def test_frames_of_an_animation_have_the_size_asked_for() -> None:
    frames = animation(TWIN, POSES, width=90, height=70, opengl=False)
    assert [frame.shape for frame in frames] == [(70, 90, 3)] * 2
    assert alive(frames[0])


def test_the_side_view_moves_with_the_lamp() -> None:
    here = side_view(TWIN, POSES[0], 120, 140)
    moved = POSES[0].copy()
    moved[0] = 0.10  # a multiple of the marks on the desk: the picture is the same
    assert np.abs(here.astype(int) - side_view(TWIN, moved, 120, 140)).mean() < 1
    bent = POSES[0].copy()
    bent[TWIN.qpos] = [0.4, -0.6, 0.3]
    assert (here != side_view(TWIN, bent, 120, 140)).mean() > 0.03


@pytest.mark.parametrize("opengl", [True, False], indirect=True)
def test_the_goal_is_marked_on_the_floor_where_it_is(opengl: bool) -> None:
    plain, near, far = (
        animation(TWIN, POSES[:1], opengl=opengl, point=point)[0].astype(int)
        for point in (None, (0.1, 0.0), (5.0, 0.0))
    )
    changed = np.abs(near - plain).sum(axis=2) > 30
    assert 0.0005 < changed.mean() < 0.02
    rows, columns = np.nonzero(changed)
    assert rows.min() > 200  # on the floor
    assert columns.min() > 180  # ahead of the lamp
    assert (far == plain).all()


def test_what_holds_of_one_motion_alone_stands_in_its_pictures() -> None:
    motions = {"lamp": POSES, "twin": POSES}
    plain = strips(TWIN, motions, ["a", "b"], width=120, height=140, opengl=False)
    told = strips(TWIN, motions, ["a", "b"], width=120, height=140, opengl=False, notes={"twin": ["1 cm", "2 cm"]})
    changed = (plain != told).any(axis=2)
    assert not changed[:144].any()
    assert changed[144:284, :120].any()
    assert changed[144:284, 124:].any()


def test_positions_of_a_lamp_from_what_is_known_of_it() -> None:
    data = mujoco.MjData(TWIN.model)
    data.qpos[:] = qpos_of(TWIN, (0.2, 0.05, 0.3), np.array([0.1, -0.2, 0.3]))
    mujoco.mj_kinematics(TWIN.model, data)
    base = TWIN.model.body("base").id
    assert data.xpos[base] == pytest.approx([0.2, 0.0, 0.05])
    assert data.xmat[base].reshape(3, 3)[:, 2] == pytest.approx([np.sin(0.3), 0.0, np.cos(0.3)])
    assert data.qpos[TWIN.qpos] == pytest.approx([0.1, -0.2, 0.3])
