"""The calibration file: what the twin's parameters are, how well they are known, and where they come from."""

from __future__ import annotations

import hashlib
import math
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
        default: What it is where a file does not say; None: a file must.
    """

    unit: str
    low: float
    high: float
    default: float | None = None


SERVO: Mapping[str, Range] = {
    "torque_constant": Range("Nm/A", 0.02, 5.0),  # output torque per ampere of winding current, gear ratio included
    "resistance": Range("Ohm", 0.1, 100.0),  # of the winding and driver
    "armature": Range("kg m^2", 1e-6, 0.1),  # rotor inertia seen at the output
    "viscous": Range("Nm s/rad", 0.0, 0.5),  # friction proportional to speed
    "coulomb": Range("Nm", 0.0, 0.5),  # friction independent of speed and load
    "stribeck": Range("Nm", 0.0, 0.5),  # extra friction at standstill
    "stribeck_velocity": Range("rad/s", 0.01, 5.0),  # speed at which the extra friction has fallen to 1/e
    "load_motor": Range("1", 0.0, 0.9),  # friction per motor torque
    "load_external": Range("1", 0.0, 0.9),  # friction per torque from outside
    "load_external_stribeck": Range("1", 0.0, 0.9),  # extra friction per torque from outside, at standstill
    "gain_divisor": Range("1", 64.0, 1024.0),  # counts of Position P Gain per unit of proportional gain
    "delay": Range("s", 0.0, 0.05),  # from a goal's arrival at the servo to the voltage it causes
    "stribeck_exponent": Range("1", 0.2, 4.0, 1.0),  # how sharply the extra friction falls with speed
    "load_motor_stribeck": Range("1", -0.5, 0.9, 0.0),  # extra friction per motor torque, at standstill
    "asymmetry": Range("1", -0.5, 0.5, 0.0),  # friction towards larger angles, above its mean
    "saturation": Range("1/A", 0.0, 2.0, 0.0),  # loss of torque per ampere of winding current
    "supply_resistance": Range("Ohm", 0.0, 5.0, 0.0),  # between the supply and the motor's driver: voltage sag
    "resistance_temperature": Range("1/K", -0.05, 0.1, 0.0),  # growth of the resistance per degree above 30 degC
    "viscous_temperature": Range("1/K", -0.3, 0.1, 0.0),  # logarithmic growth of viscous per degree above 30 degC
}
"""Parameters of a servo, the same for every joint or for one joint alone."""

LAMP: Mapping[str, Range] = {
    "supply_voltage": Range("V", 3.0, 15.0),  # at the servos
    "line_delay": Range("s", 0.0, 0.05),  # from the start of a tick to the goal's arrival at the servo
    "floor_friction": Range("1", 0.05, 3.0),  # sliding friction coefficient of foot on floor
    "foot_gain": Range("1", 0.1, 10.0),  # foot sensor reading per true force
    "mass_scale": Range("1", 0.5, 2.0),  # all link masses, times this
    "contact_softness": Range("1", 1.0, 5.0, 1.0),  # time constant of the foot's contact with the floor, times this
    "supply_resistance": Range("Ohm", 0.0, 1.0, 0.0),  # of the supply and its leads, which all servos share: sag
    "arm_stiffness": Range("Nm/rad", 5.0, math.inf, math.inf),  # between each servo and what it turns; left out: rigid
}
"""Parameters of the lamp as a whole."""

JOINT: Mapping[str, Range] = {
    "encoder_offset": Range("rad", -0.3, 0.3, 0.0),  # what the encoder reads at true angle 0
    "link_mass": Range("1", 0.5, 2.0, 1.0),  # mass and inertia of the link that the joint turns, times this
    "backlash": Range("rad", 0.0, 0.1, 0.0),  # play between gear train and output, from end to end
}
"""Parameters of one joint, beside those of its servo."""


@dataclass(frozen=True)
class Parameter:
    """A calibrated number.

    Attributes:
        value: The value, in its unit.
        unit: The unit.
        stderr: Standard error in the same unit; None where the value is from a datasheet or publication.
        source: Where it comes from.
        identified: Whether the recordings that it was fitted to tell it; None where it was not fitted.
    """

    value: float
    unit: str
    stderr: float | None
    source: str
    identified: bool | None = None


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

    def other_lamp(self, source: str) -> bool:
        """Whether this was fitted to a lamp of another description; False where it was fitted to none.

        Args:
            source: Text of the description at hand (hardware/lamp.toml).
        """
        fitted_to = self.provenance.get("lamp_sha256")
        return fitted_to is not None and fitted_to != hashlib.sha256(source.encode()).hexdigest()

    def lamp(self, name: str) -> float:
        """Return a parameter of the lamp as a whole, in its unit (see LAMP).

        Raises:
            FileError: The file does not hold it.
        """
        parameter = self.groups.get("lamp", {}).get(name)
        default = LAMP[name].default
        if parameter is None and default is not None:
            return default
        if parameter is None:
            raise FileError(f"lamp.{name}: missing; expected a value in {LAMP[name].unit}", str(self.path))
        return parameter.value

    def joint(self, joint: str, name: str) -> float:
        """Return a parameter of one joint, in its unit (see JOINT)."""
        parameter = self.groups.get(f"joint {joint}", {}).get(name)
        return (JOINT[name].default or 0.0) if parameter is None else parameter.value

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
            if parameter is None and legal.default is not None:
                values[name] = legal.default
                continue
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
            identified=entry.flag("identified", default=None),
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
        groups[f"joint {joint}"] = _parameters(joints.table(joint), {**SERVO, **JOINT})
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
