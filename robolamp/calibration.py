"""The calibration file: what the twin's parameters are, how well they are known, and where they come from."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from robolamp.assets import Assets
from robolamp.errors import FileError
from robolamp.files import Table, read_text, read_toml


@dataclass(frozen=True)
class Range:
    """A parameter that calibration files may hold.

    Attributes:
        unit: Its unit.
        low: Smallest sane value.
        high: Largest sane value.
        meaning: What it is.
    """

    unit: str
    low: float
    high: float
    meaning: str


SERVO: Mapping[str, Range] = {
    "torque_constant": Range("Nm/A", 0.02, 5.0, "output torque per ampere of winding current, gear ratio included"),
    "resistance": Range("Ohm", 0.1, 100.0, "of the winding and driver"),
    "armature": Range("kg m^2", 1e-6, 0.1, "rotor inertia seen at the output"),
    "viscous": Range("Nm s/rad", 0.0, 0.5, "friction proportional to speed"),
    "coulomb": Range("Nm", 0.0, 0.5, "friction independent of speed and load"),
    "stribeck": Range("Nm", 0.0, 0.5, "extra friction at standstill"),
    "stribeck_velocity": Range("rad/s", 0.01, 5.0, "speed at which the extra friction has fallen to 1/e"),
    "load_motor": Range("1", 0.0, 0.9, "friction per motor torque"),
    "load_external": Range("1", 0.0, 0.9, "friction per torque from outside"),
    "load_external_stribeck": Range("1", 0.0, 0.9, "extra friction per torque from outside, at standstill"),
    "gain_divisor": Range("1", 64.0, 1024.0, "counts of Position P Gain per unit of proportional gain"),
    "delay": Range("s", 0.0, 0.05, "from a goal's arrival at the servo to the voltage it causes"),
}
"""Parameters of a servo, the same for every joint or for one joint alone."""

LAMP: Mapping[str, Range] = {
    "supply_voltage": Range("V", 3.0, 15.0, "at the servos"),
    "line_delay": Range("s", 0.0, 0.05, "from the start of a tick to the goal's arrival at the servo"),
    "floor_friction": Range("1", 0.05, 3.0, "sliding friction coefficient of foot on floor"),
    "foot_gain": Range("1", 0.1, 10.0, "foot sensor reading per true force"),
    "mass_scale": Range("1", 0.5, 2.0, "all link masses, times this"),
}
"""Parameters of the lamp as a whole."""


@dataclass(frozen=True)
class Parameter:
    """A calibrated number.

    Attributes:
        value: The value, in its unit.
        unit: The unit.
        stderr: Standard error in the same unit; None where the value is from a datasheet or publication.
        source: Where it comes from.
    """

    value: float
    unit: str
    stderr: float | None
    source: str


@dataclass(frozen=True)
class Calibration:
    """Parameters by group: "lamp", a servo model, or "joint NAME" for one joint's own.

    Attributes:
        name: The calibration's name.
        groups: Parameters by group and name.
        provenance: What it was made from: files and their hashes, versions, date, held-out error.
        hash: SHA-256 of the file's text.
        source: The file's text.
        path: The file.
    """

    name: str
    groups: Mapping[str, Mapping[str, Parameter]]
    provenance: Mapping[str, Any]
    hash: str
    source: str = field(repr=False)
    path: Path

    def lamp(self, name: str) -> float:
        """Return a parameter of the lamp as a whole, in its unit (see LAMP).

        Raises:
            FileError: The file does not hold it.
        """
        parameter = self.groups.get("lamp", {}).get(name)
        if parameter is None:
            raise FileError(f"lamp.{name}: missing; expected a value in {LAMP[name].unit}", str(self.path))
        return parameter.value

    def servo(self, model: str, joint: str) -> dict[str, float]:
        """Return every parameter of SERVO for one joint: its own value where there is one, else its servo model's.

        Args:
            model: Servo model, as "XL330-M288-T".
            joint: Joint name.

        Raises:
            FileError: The file holds no value for one of them.
        """
        shared, own = self.groups.get(model, {}), self.groups.get(f"joint {joint}", {})
        values = {}
        for name, legal in SERVO.items():
            parameter = own.get(name) or shared.get(name)
            if parameter is None:
                expected = f"a number from {legal.low:g} to {legal.high:g} {legal.unit}"
                raise FileError(f"servo.{model}.{name}: missing; expected {expected}", str(self.path))
            values[name] = parameter.value
        return values


def _parameters(table: Table, legal: Mapping[str, Range]) -> dict[str, Parameter]:
    found = {}
    for name in table.names():
        if name not in legal:
            raise table.fail(name, f"unknown parameter; expected one of {', '.join(legal)}")
        entry = table.table(name)
        found[name] = Parameter(
            value=entry.number("value", legal[name].low, legal[name].high, legal[name].unit),
            unit=entry.text("unit", [legal[name].unit]),
            stderr=entry.number("stderr", 0.0, float("inf"), legal[name].unit, default=None),
            source=entry.text("source", default=""),
        )
        entry.done()
    return found


def load_calibration(assets: Assets, name: str | Path = "nominal") -> Calibration:
    """Read a calibration file.

    Args:
        assets: Where to look.
        name: A path, or the name of a file in calibration/.

    Raises:
        FileError: The file is missing or malformed, or a value is outside its sane range.
    """
    path = assets.named(name, "calibration", "calibration")
    text = read_text(path)
    root = Table(read_toml(path), str(path))
    root.integer("schema", 1, 1)
    groups: dict[str, dict[str, Parameter]] = {"lamp": _parameters(root.table("lamp"), LAMP)}
    servos = root.table("servo")
    for model in servos.names():
        groups[model] = _parameters(servos.table(model), SERVO)
    joints = root.table("joint", default={})
    for joint in joints.names():
        groups[f"joint {joint}"] = _parameters(joints.table(joint), SERVO)
    provenance = root.table("provenance")
    calibration = Calibration(
        name=root.text("name"),
        groups=groups,
        provenance=provenance.raw(),
        hash=hashlib.sha256(text.encode()).hexdigest(),
        source=text,
        path=path,
    )
    root.done()
    return calibration
