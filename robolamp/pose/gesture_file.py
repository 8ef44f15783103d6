"""The gesture file: TOML that people read and edit, a few poses and when each is reached."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import tomlkit
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.controller.controller_file import slug
from robolamp.ease import EASES, MINIMUM_JERK
from robolamp.files import Table, read_text, read_toml, write_atomic
from robolamp.lamp import Lamp
from robolamp.pose.gesture import LONGEST, MOST_LOOPS, QUICKEST, SLOWEST, Frame, Gesture, check_length

Array = NDArray[np.float64]

FOLDER = "sim/lamp/gestures"
"""Where the lamp's gestures are."""

NEUTRAL, REST = "neutral", "rest"
"""Poses that every lamp has: all joints at 0; and that of lamp.toml's `rest`."""

_DIGITS = 3  # of an angle [rad] and of a time [s] that is written


def find_gesture(name: str, assets: Assets) -> Path:
    """Return the file of a gesture.

    Args:
        name: A path, or the name of a shipped gesture, such as "nod".
        assets: Where to look.

    Raises:
        FileError: Neither a file nor a known name; the message lists the known ones.
    """
    return assets.named(name, FOLDER, "gesture")


def all_gestures(assets: Assets) -> list[Path]:
    """Return the files of all gestures by name, one's own before a shipped one of the same name."""
    found: dict[str, Path] = {}
    for path in assets.all(FOLDER):
        found.setdefault(path.stem, path)
    return [found[name] for name in sorted(found)]


def load_gesture(path: Path, lamp: Lamp) -> Gesture:
    """Read a gesture file.

    Args:
        path: The file.
        lamp: The lamp that plays it: joints and limits.

    Raises:
        FileError: The file is missing or malformed; a pose, a joint or an ease is unknown; a joint is sent outside its
            limits; times do not rise.
    """
    where = str(path)
    root = Table(read_toml(path), where)
    root.integer("schema", 1, 1)
    name = legal_name(root)
    says = root.text("says", default="")
    ease = root.text("ease", EASES, default=MINIMUM_JERK)
    loops = root.integer("loops", 1, MOST_LOOPS, default=1)
    speed = root.number("speed", SLOWEST, QUICKEST, default=1.0)
    poses = _poses(root, lamp)
    frames: list[Frame] = []
    for table in root.tables("frame"):
        before = frames[-1].time if frames else 0.0
        time = table.number("time", 0.0, LONGEST, "s")
        if time <= before:
            what = "that of the frame before" if frames else "0 s, when it begins"
            raise table.fail("time", f"{time:g} s is not after {what}{f', {before:g} s' if frames else ''}")
        frames.append(Frame(time, _pose(table, poses, lamp, time), table.text("ease", EASES, default=ease)))
        table.done()
    root.done()
    gesture = Gesture(name, lamp.names, tuple(frames), says, loops, speed, read_text(path), where)
    check_length(gesture.duration, where)
    return gesture


def legal_name(root: Table) -> str:
    """Return a file's `name`, which becomes part of a folder's.

    Raises:
        FileError: It cannot.
    """
    name = root.text("name")
    if slug(name) != name:
        raise root.fail("name", f"{name[:64]!r} is not 1 to 64 letters, digits, spaces, or . _ - (no such first)")
    return name


def _poses(root: Table, lamp: Lamp) -> dict[str, Array]:
    """Read [poses]: each names every joint, or leaves those out that are to stay."""
    poses = {NEUTRAL: np.zeros(len(lamp.joints)), REST: lamp.rest}
    if "poses" in root:
        table = root.table("poses")
        for name in table.names():
            if name in poses:
                raise table.fail(name, "is a pose that every lamp has; give yours another name")
        for name in table.names():
            poses[name] = _angles(table.table(name), lamp)
    return poses


def _pose(table: Table, poses: Mapping[str, Array], lamp: Lamp, time: float) -> Array:
    """Read a frame's pose: a name, or a table of angles; without one every joint stays."""
    if "pose" not in table:
        return np.full(len(lamp.joints), math.nan)
    if table.is_text("pose"):
        return poses[table.text("pose", poses)]
    return _angles(table.table("pose"), lamp, f", at {time:g} s")


def _angles(table: Table, lamp: Lamp, moment: str = "") -> Array:
    """Read joint angles; a joint that is not named is NaN."""
    angles = np.full(len(lamp.joints), math.nan)
    for index, joint in enumerate(lamp.joints):
        value = table.number(joint.name, -math.pi, math.pi, "rad", default=math.nan)
        if not math.isnan(value) and not joint.lower <= value <= joint.upper:
            raise table.fail(
                joint.name,
                f"{value:g} rad{moment} is not from {joint.lower:g} to {joint.upper:g} rad, its limits in "
                f"{lamp.path.name}",
            )
        angles[index] = value
    table.done()
    return angles


def format_gesture(gesture: Gesture, remark: str = "") -> str:
    """Return a gesture as the text of its file.

    Args:
        gesture: The gesture.
        remark: A comment above it; empty: none.
    """
    document = tomlkit.document()
    for line in remark.splitlines():
        document.add(tomlkit.comment(line))
    document["schema"] = 1
    document["name"] = gesture.name
    if gesture.says:
        document["says"] = gesture.says
    if gesture.loops != 1:
        document["loops"] = gesture.loops
    if gesture.speed != 1.0:
        document["speed"] = gesture.speed
    frames = tomlkit.aot()
    for frame in gesture.frames:
        table = tomlkit.table()
        table["time"] = tomlkit.item(round(frame.time, _DIGITS)).comment("s")
        pose = tomlkit.inline_table()
        for joint, angle in zip(gesture.joints, frame.pose.tolist(), strict=True):
            if not math.isnan(angle):
                pose[joint] = round(angle, _DIGITS)
        if pose:
            table["pose"] = pose
        table["ease"] = frame.ease
        frames.append(table)
    document["frame"] = frames
    return tomlkit.dumps(document)


def save_gesture(gesture: Gesture, path: Path, remark: str = "") -> None:
    """Write a gesture file, atomically.

    Args:
        gesture: The gesture.
        path: Where to.
        remark: A comment above it.

    Raises:
        FileError: It cannot be written.
    """
    write_atomic(path, format_gesture(gesture, remark))
