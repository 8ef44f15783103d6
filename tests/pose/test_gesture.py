"""Gesture files and the motion through their frames."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.assets import Assets
from robolamp.ease import EASES
from robolamp.errors import RobolampError, SafetyError
from robolamp.lamp import load_lamp
from robolamp.pose.gesture import Frame, Gesture, altered, check_slew
from robolamp.pose.gesture_file import all_gestures, find_gesture, load_gesture, save_gesture

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
WANTED = {"look-up", "look-down", "nod", "bow", "peek", "shy", "curious", "stretch", "sleep", "breathe"}

angles = st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3).map(np.array)
frames = st.lists(st.tuples(st.floats(0.1, 2.0), angles, st.sampled_from(sorted(EASES))), min_size=1, max_size=6)


def gesture(made: list, loops: int = 1, speed: float = 1.0) -> Gesture:
    times = np.cumsum([length for length, _, _ in made]).tolist()
    steps = tuple(Frame(time, pose, ease) for time, (_, pose, ease) in zip(times, made, strict=True))
    return Gesture("made", LAMP.names, steps, loops=loops, speed=speed)


@given(frames, angles, st.integers(1, 3), st.floats(0.3, 3.0))
def test_a_motion_passes_through_its_frames(made: list, start: np.ndarray, loops: int, speed: float) -> None:
    played = gesture(made, loops, speed)
    motion = played.motion(start)
    assert np.array_equal(motion(0.0), start)
    assert np.array_equal(motion(-1.0), start)
    for time in (played.duration, played.duration + 9.0):
        assert motion(time) == pytest.approx(made[-1][1], abs=1e-9)
    for loop in range(loops):
        for frame in played.frames[:-1]:
            at = loop * played.once + frame.time / speed
            assert motion(at) == pytest.approx(frame.pose, abs=1e-6)


@given(frames, angles, st.integers(1, 3), st.floats(0.3, 3.0))
def test_no_joint_is_faster_than_it_is_said_to_be(made: list, start: np.ndarray, loops: int, speed: float) -> None:
    motion = gesture(made, loops, speed).motion(start)
    fastest = [max(turn.speed for turn in motion.turns() if turn.joint == joint) for joint in range(3)]
    steps = np.abs(np.diff(motion.samples(0.01), axis=0)).max(axis=0, initial=0.0)
    assert (steps <= np.array(fastest) * 0.01 + 1e-9).all()


@given(frames, angles)
def test_between_two_frames_joints_go_one_way(made: list, start: np.ndarray) -> None:
    played = gesture(made)
    motion, times = played.motion(start), [0.0, *(frame.time for frame in played.frames)]
    for begin, end in itertools.pairwise(times):
        steps = np.diff([motion(time) for time in np.linspace(begin, end, 20)[:-1]], axis=0)
        assert ((steps >= -1e-12).all(axis=0) | (steps <= 1e-12).all(axis=0)).all()


def test_a_joint_that_a_frame_does_not_name_stays() -> None:
    nod = Gesture("nod", LAMP.names, (Frame(1.0, np.array([np.nan, np.nan, 0.2]), "linear"),), loops=2)
    motion = nod.motion(np.array([0.1, -0.1, 0.0]))
    assert motion(0.5) == pytest.approx([0.1, -0.1, 0.1])
    assert motion(1.5) == pytest.approx([0.1, -0.1, 0.2])


def test_what_ships_is_known_by_name_and_slow_enough() -> None:
    assert {path.stem for path in all_gestures(ASSETS)} >= WANTED
    for path in all_gestures(ASSETS):
        shipped = load_gesture(path, LAMP)
        assert shipped.name == path.stem
        assert shipped.says
        check_slew(shipped, LAMP)


@given(made=frames)
def test_what_is_written_is_read_again(made: list, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "made.toml"
    written = gesture(made, 2, 1.5)
    save_gesture(written, path, "a remark")
    read = load_gesture(path, LAMP)
    assert (read.name, read.loops, read.speed) == ("made", 2, 1.5)
    assert [frame.ease for frame in read.frames] == [frame.ease for frame in written.frames]
    for one, other in zip(read.frames, written.frames, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-3)
        assert one.pose == pytest.approx(other.pose, abs=1e-3)


def test_another_speed_is_in_the_text_too(tmp_path: Path) -> None:
    nod = load_gesture(find_gesture("nod", ASSETS), LAMP)
    quick = altered(nod, 2.0, 3)
    assert quick.duration == pytest.approx(1.5 * nod.duration)
    (tmp_path / "nod.toml").write_text(quick.source)
    assert load_gesture(tmp_path / "nod.toml", LAMP).duration == quick.duration
    with pytest.raises(SafetyError, match=r"at 0\.\d+ s neck would turn at .* its slew limit in lamp.toml is 14 rad/s"):
        check_slew(altered(nod, 5.0), LAMP)


GOOD = """schema = 1
name = "mine"
[poses]
down = { knee = 0.2, neck = 0.3 }
[[frame]]
time = 0.5
pose = "down"
[[frame]]
time = 1.0
pose = "neutral"
"""


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("neck = 0.3", "neck = 0.5", "poses.down.neck: 0.5 rad is not from -1 to 0.35 rad, its limits in lamp.toml"),
        ("neck = 0.3", "wrist = 0.3", "poses.down.wrist: unknown; expected one of ankle, knee, neck"),
        ("neck = 0.3", "neck = nan", "poses.down.neck: nan is not a number"),
        ('pose = "down"', 'pose = "dwon"', "frame[0].pose: 'dwon' is not one of neutral, rest, down"),
        ('pose = "down"', "pose = { knee = 0.9 }", "frame[0].pose.knee: 0.9 rad, at 0.5 s is not from -1 to 0.78"),
        ('pose = "down"', "pose = 3", "frame[0].pose: 3 is not a table"),
        ("time = 1.0", "time = 0.5", "frame[1].time: 0.5 s is not after that of the frame before, 0.5 s"),
        ("time = 0.5", "time = 0", "frame[0].time: 0 s is not after 0 s, when it begins"),
        ("time = 0.5", 'time = 0.5\nease = "quick"', "frame[0].ease: 'quick' is not one of linear, slow in and out"),
        ("down =", "rest =", "poses.rest: is a pose that every lamp has"),
        ("schema = 1", "schema = 1\nloops = 9999", "takes 9999 s with loops and speed; expected 600 s at most"),
        ('name = "mine"', 'name = "../mine"', "name: '../mine' is not 1 to 64 letters"),
        ("[[frame]]\ntime = 1.0", "[[frame]\ntime = 1.0", "not valid TOML"),
        ("schema", "scheme", "schema: missing"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, before: str, after: str, said: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    assert load_gesture(path, LAMP).duration == 1.0
    path.write_text(GOOD.replace(before, after, 1))
    with pytest.raises(RobolampError) as error:
        load_gesture(path, LAMP)
    assert said in str(error.value)
    assert str(path) in str(error.value)


@given(cut=st.integers(0, len(GOOD)))
def test_a_cut_file_is_a_gesture_or_one_line(cut: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "cut.toml"
    path.write_text(GOOD[:cut])
    said = ""
    try:
        load_gesture(path, LAMP)
    except RobolampError as error:
        said = str(error)
    assert not said or (str(path) in said and "\n" not in said)
