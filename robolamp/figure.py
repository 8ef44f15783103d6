"""Figures other than the lamp (sim/NAME/figure.toml): joints, motors, and what their controllers may see.

Jumper and Madzia of Kwasnicka & Wozniak, "EMOT - Evolutionary Approach to 3D Computer Animation": angular motors of
limited strength at joints with limits (section 4.1). They live in the simulation alone; the lamp has
hardware/lamp.toml.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.errors import FileError
from robolamp.files import Table, read_text, read_toml

LAMP = "lamp"
"""The figure that is described in hardware/lamp.toml instead."""
DRIVES = ("position", "velocity")
"""What a controller's outputs may mean: goal angles [rad], or goal angular velocities [rad/s]."""
POINT = "point"
"""A goal that is a point of the floor and no body."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}\Z")  # becomes part of a terminal's name


class Driven(Protocol):
    """What controllers drive: the lamp, or another figure. Goals are of the kind that its drive says."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def drive(self) -> str:
        """What goals are, one of `DRIVES`."""
        ...

    @property
    def joints(self) -> Sequence[object]:
        """Its joints, in the order of a controller's outputs."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """The joints' names."""
        ...

    @property
    def lower(self) -> NDArray[np.float64]:
        """Smallest goals, shape (n,)."""
        ...

    @property
    def upper(self) -> NDArray[np.float64]:
        """Largest goals, shape (n,)."""
        ...

    @property
    def slew(self) -> NDArray[np.float64]:
        """Fastest changes of the goals, shape (n,), per second."""
        ...


@dataclass(frozen=True)
class FigureJoint:
    """One joint and its motor.

    Attributes:
        name: The joint's name in the model.
        lower: Smallest angle [rad].
        upper: Largest angle [rad].
        speed: Fastest angular velocity that may be asked for [rad/s].
        strength: Largest torque of the motor [Nm].
    """

    name: str
    lower: float
    upper: float
    speed: float
    strength: float


@dataclass(frozen=True)
class Figure:
    """A figure as the programs know it.

    Attributes:
        name: Its name, that of its folder in sim/.
        model: The model's path inside the data folders.
        drive: What goals are, one of `DRIVES`.
        root: The body whose centre is to come to the goal.
        heading: The body in whose directions `goal_ahead` and `goal_left` are told.
        goal: `POINT`, or the body that stands at the goal.
        objects: Bodies whose positions and velocities are terminals.
        radius: Distance from the goal that counts as there [m].
        tilt: Largest tilt of the root that counts as upright [rad].
        joints: Its joints.
        source: The text of the file it was read from.
        path: That file.
    """

    name: str
    model: str
    drive: str
    root: str
    heading: str
    goal: str
    objects: tuple[str, ...]
    radius: float
    tilt: float
    joints: tuple[FigureJoint, ...]
    source: str
    path: Path

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names, in the order of terminals k0, k1 .."""
        return tuple(joint.name for joint in self.joints)

    @property
    def speed(self) -> NDArray[np.float64]:
        """Fastest angular velocities, shape (n,) [rad/s]."""
        return np.array([joint.speed for joint in self.joints])

    @property
    def lower(self) -> NDArray[np.float64]:
        """Smallest goals, shape (n,) [rad/s or rad, by `drive`]."""
        return -self.speed if self.drive == "velocity" else np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> NDArray[np.float64]:
        """Largest goals, shape (n,) [rad/s or rad, by `drive`]."""
        return self.speed if self.drive == "velocity" else np.array([joint.upper for joint in self.joints])

    @property
    def slew(self) -> NDArray[np.float64]:
        """Fastest changes of the goals, shape (n,), per second: velocities may jump, angles move at `speed`."""
        return np.full(len(self.joints), np.inf) if self.drive == "velocity" else self.speed


def _joint(table: Table) -> FigureJoint:
    lower = table.number("lower", -math.pi - 0.01, 0.0, "rad")
    joint = FigureJoint(
        name=table.text("name"),
        lower=lower,
        upper=table.number("upper", 0.0, math.pi + 0.01, "rad"),
        speed=table.number("speed", 0.01, 100.0, "rad/s"),
        strength=table.number("strength", 0.001, 10_000.0, "Nm"),
    )
    if joint.lower == joint.upper:
        raise table.fail("upper", "0 is not above lower = 0 rad: the joint could not move")
    table.done()
    return joint


def _objects(root: Table) -> tuple[str, ...]:
    names = root.array("objects")
    if not all(isinstance(name, str) and _NAME.match(name) for name in names) or len(set(names)) < len(names):
        raise root.fail("objects", f"{names!r} is not a list of different bodies' names (letters, digits, _)")
    return tuple(names)


def load_figure(assets: Assets, name: str, drive: str | None = None) -> Figure:
    """Read sim/NAME/figure.toml.

    Args:
        assets: Where to look.
        name: The figure.
        drive: What goals are, one of `DRIVES`; None: what the file says.

    Raises:
        FileError: There is no such figure, or its file is malformed; the message names the key and its legal range.
    """
    known = figures(assets)
    if name not in known:
        raise FileError(f"no such figure; expected one of {', '.join((LAMP, *known))}", f"figure {name!r}")
    path = assets.path(f"sim/{name}/figure.toml")
    root = Table(read_toml(path), str(path))
    root.integer("schema", 1, 1)
    success = root.table("success")
    joints = tuple(_joint(table) for table in root.tables("joint"))
    names = [joint.name for joint in joints]
    if len(set(names)) != len(names):
        raise root.fail("joint", f"two joints have the same name ({', '.join(names)})")
    figure = Figure(
        name=root.text("name", (name,)),
        model=root.text("model"),
        drive=root.text("drive", DRIVES),
        root=root.text("root"),
        heading=root.text("heading"),
        goal=root.text("goal"),
        objects=_objects(root),
        radius=success.number("radius", 0.001, 10.0, "m"),
        tilt=success.number("tilt", 0.01, math.pi, "rad"),
        joints=joints,
        source=read_text(path),
        path=path,
    )
    for table in (root, success):
        table.done()
    return figure if drive is None else replace(figure, drive=drive)


def figures(assets: Assets) -> tuple[str, ...]:
    """Return the names of the figures that have a figure.toml, sorted."""
    found = {path.parent.name for root in assets.roots() for path in (root / "sim").glob("*/figure.toml")}
    return tuple(sorted(found))
