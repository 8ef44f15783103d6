"""Reads shape.toml, and refuses what cannot be built: one line with the value, what was expected, and where."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import measures

JOINTS = ("ankle", "knee", "neck")
"""From the foot up."""

BODIES = ("base", "lower_arm", "upper_arm", "head")
"""The links, from the foot up; the joint of that number stands between a link and the next."""


class ShapeError(Exception):
    """A shape that cannot be built; the message is one line."""


@dataclass(frozen=True)
class Shape:
    """The lamp's measures, as in shape.toml [mm, rad, g], and what follows from them.

    Attributes:
        foot: Keys of the table `foot`.
        arms: Keys of the table `arms`.
        shade: Keys of the table `shade`.
        neutral: Neutral pitch of each joint against the link below [rad].
        stops: Range of each joint from the neutral pose [rad].
        printing: Keys of the table `print`.
        path: The file it was read from.
    """

    foot: dict[str, float]
    arms: dict[str, float]
    shade: dict[str, float]
    neutral: dict[str, float]
    stops: dict[str, tuple[float, float]]
    printing: dict[str, float]
    path: Path

    def fork_reach(self, joint: str) -> float:
        """Return how far from the joint's axis the cross-piece of the upper link's fork begins [mm].

        Outside the circle that the servo's corners sweep, and clear of its long side at the joint's largest bend.

        Args:
            joint: The joint, "knee" or "neck".
        """
        swept = measures.SWEEP + self.printing["clearance"] + 0.3
        side = measures.CRADLE_HALF_WIDTH + self.printing["clearance"] + 0.3
        between = math.pi - (self.neutral[joint] + self.stops[joint][1])  # fork and servo, at the largest bend
        if between <= 0.3:
            return math.inf
        return max(swept, (side + measures.CRADLE_HALF_WIDTH * math.cos(between)) / math.sin(between))


_KEYS = {
    "foot": {
        "radius": (45.0, 90.0),
        "sole_width": (4.0, 10.0),
        "sole_height": (3.0, 8.0),
        "sensor_radius": (30.0, 80.0),
        "axis": (30.0, 60.0),
    },
    "arms": {
        "lower": (1.0, 170.0),
        "upper": (1.0, 170.0),
        "tube": (5.0, 6.5),
        "bore": (0.0, 6.0),
        "spacing": (9.0, 12.0),
    },
    "shade": {
        "neck_radius": (18.0, 30.0),
        "mouth_radius": (25.0, 80.0),
        "end": (40.0, 160.0),
        "wall": (1.2, 5.0),
        "bulb_radius": (10.0, 60.0),
        "bulb_middle": (30.0, 150.0),
        "bulb_mass": (0.1, 200.0),
    },
    "neutral": {"ankle": (-1.2, 1.2), "knee": (-2.4, 2.4), "neck": (-2.4, 2.4)},
    "print": {
        "density": (0.1, 10.0),
        "sole_density": (0.1, 10.0),
        "bed": (120.0, 1000.0),
        "wall": (0.8, 3.0),
        "clearance": (0.2, 0.7),
        "rate": (0.1, 100.0),
    },
}
_UNITS = {"neutral": "rad", "density": "g/cm3", "sole_density": "g/cm3", "bulb_mass": "g", "rate": "mm3/s"}


def read_shape(path: Path) -> Shape:
    """Return the shape that a file describes.

    Args:
        path: A file as shape.toml.

    Raises:
        ShapeError: It cannot be read, lacks a key, has an unknown one, or describes what cannot be built.
    """
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ShapeError(f"{path}: cannot be read as TOML: {' '.join(str(error).split())}") from None
    known = {*_KEYS, "stops"}
    for name in sorted(tables.keys() ^ known, key=lambda name: name not in known):
        fault = "is missing" if name in known else f"is unknown; expected one of {', '.join(sorted(known))}"
        raise ShapeError(f"{path}: table [{name}] {fault}")
    read = {name: _numbers(path, name, tables[name]) for name in _KEYS}
    shape = Shape(
        read["foot"], read["arms"], read["shade"], read["neutral"], _stops(path, tables["stops"]), read["print"], path
    )
    _check(shape)
    return shape


def _numbers(path: Path, name: str, table: Any) -> dict[str, float]:
    keys = _KEYS[name]
    if not isinstance(table, dict):
        raise ShapeError(f"{path}: {name} = {table!r}; expected a table")
    for key in sorted(table.keys() ^ keys.keys()):
        fault = "is missing" if key in keys else f"is unknown; expected one of {', '.join(keys)}"
        raise ShapeError(f"{path}: {name}.{key} {fault}")
    for key, (low, high) in keys.items():
        value = table[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            unit = _UNITS.get(key, _UNITS.get(name, "mm"))
            raise ShapeError(f"{path}: {name}.{key} = {value!r}; expected {low:g} to {high:g} {unit}")
    return {key: float(table[key]) for key in keys}


def _stops(path: Path, table: Any) -> dict[str, tuple[float, float]]:
    found = {}
    for joint in JOINTS:
        pair = table.get(joint) if isinstance(table, dict) else None
        numbers = isinstance(pair, list) and len(pair) == 2 and all(isinstance(each, int | float) for each in pair)
        if not numbers or not -math.pi < pair[0] < 0.0 < pair[1] < math.pi:
            raise ShapeError(f"{path}: stops.{joint} = {pair!r}; expected two angles, one below and one above 0 rad")
        found[joint] = (float(pair[0]), float(pair[1]))
    return found


def _check(shape: Shape) -> None:
    """Refuse what a look at the numbers shows; the solids are checked when they are there."""
    path, arms, shade, foot = shape.path, shape.arms, shape.shade, shape.foot
    held = measures.CASE_FAR + measures.CRADLE_GAP + measures.SOCKET  # of an arm, by a servo and the sockets at its end
    knee = shape.fork_reach("knee")
    for key, least in (("lower", 2 * held + 2.0), ("upper", knee + measures.SOCKET + held + 2.0)):
        if arms[key] < least:
            raise ShapeError(
                f"{path}: arms.{key} = {arms[key]:g}; expected {least:.1f} mm or more, "
                "or there is no room for its servo and the sockets of its tubes"
            )
    if arms["bore"] >= arms["tube"] - 0.4:
        raise ShapeError(
            f"{path}: arms.bore = {arms['bore']:g}; expected less than tube - 0.4 = {arms['tube'] - 0.4:g} mm"
        )
    room = foot["axis"] - measures.SWEEP - shape.printing["clearance"] - foot["sole_height"]
    if room < 11.4:
        low = foot["axis"] + 11.4 - room
        raise ShapeError(
            f"{path}: foot.axis = {foot['axis']:g}; expected {low:.1f} mm or more, or the servo meets the dome"
        )
    widest = foot["radius"] - foot["sole_width"] / 2 - 9.3
    if foot["sensor_radius"] > widest:
        raise ShapeError(f"{path}: foot.sensor_radius = {foot['sensor_radius']:g}; expected {widest:g} mm or less")
    if shade["mouth_radius"] <= shade["neck_radius"]:
        raise ShapeError(
            f"{path}: shade.mouth_radius = {shade['mouth_radius']:g}; expected more than "
            f"neck_radius = {shade['neck_radius']:g} mm"
        )
    start = shape.fork_reach("neck")
    if not start + 25.0 < shade["end"]:
        raise ShapeError(f"{path}: shade.end = {shade['end']:g}; expected more than {start + 25.0:.1f} mm")
    if shade["bulb_middle"] - shade["bulb_radius"] < start + 12.0:
        raise ShapeError(
            f"{path}: shade.bulb_middle = {shade['bulb_middle']:g}; expected "
            f"{start + 12.0 + shade['bulb_radius']:.1f} mm or more, or the bulb meets the neck"
        )
