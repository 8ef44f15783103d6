"""What a lamp's recordings are asked for: parameters, each with a prior, and the calibration made of their values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robolamp.calibration import JOINT, LAMP, SERVO, Calibration, Parameter
from robolamp.lamp import Lamp

Array = NDArray[np.float64]

SPREAD: Mapping[str, float] = {
    "torque_constant": 0.10,
    "resistance": 0.10,
    "armature": 0.30,
    "viscous": 0.40,
    "coulomb": 0.50,
    "load_motor": 0.35,
    "load_external": 0.35,
    "link_mass": 0.10,
    "delay": 0.004,
    "encoder_offset": 0.02,
}
"""How far a lamp's own values may well lie from its base calibration, one standard deviation: of encoder_offset [rad]
and delay [s] as such, of the others relative. Estimates: published identifications of one servo differ by as much."""

GEARS: Mapping[str, tuple[float, float]] = {"backlash": (0.004, 0.7), "arm_stiffness": (30.0, 0.5)}
"""Parameters that are in a twin only where they make it predict better: what they are expected to be [rad, Nm/rad], and
their standard deviation, relative. Chosen: ROBOTIS prints 0.25 degrees of play for its larger servos; a horn on a
printed arm gives a degree under half a newton metre."""

ABSOLUTE = ("encoder_offset", "delay")
"""Parameters that are shifted; the others are scaled."""

MOST = 4.0
"""How many standard deviations from its prior a value may go."""


@dataclass(frozen=True)
class Unknown:
    """One parameter to find.

    Attributes:
        joint: Whose it is; empty: the lamp's as a whole.
        name: Of the parameter, as in calibration files.
        prior: What the base calibration says.
        spread: Standard deviation of the prior: relative, or of those in ABSOLUTE in their unit.
        unit: Its unit.
    """

    joint: str
    name: str
    prior: float
    spread: float
    unit: str

    @property
    def label(self) -> str:
        """Its name in full, as "knee.coulomb"."""
        return f"{self.joint}.{self.name}" if self.joint else f"lamp.{self.name}"

    def value(self, z: float) -> float:
        """Return the value that lies `z` standard deviations from the prior, kept inside what a file may hold."""
        raw = self.prior + self.spread * z if self.name in ABSOLUTE else self.prior * math.exp(self.spread * z)
        legal = (SERVO.get(self.name) or JOINT.get(self.name) or LAMP[self.name]) if self.joint else LAMP[self.name]
        return min(max(raw, legal.low), legal.high)

    def stderr(self, z: float, sigma: float) -> float:
        """Return the standard error in the parameter's unit.

        Args:
            z: Where the value lies, in standard deviations of the prior.
            sigma: Its standard error in the same measure.
        """
        return self.spread * sigma * (1.0 if self.name in ABSOLUTE else self.value(z))


def unknowns(lamp: Lamp, base: Calibration, names: Sequence[str] = tuple(SPREAD)) -> tuple[Unknown, ...]:
    """Return a lamp's unknowns, joint by joint.

    Args:
        lamp: Its joints.
        base: What is known before.
        names: Which parameters of each joint.

    Raises:
        FileError: The base calibration lacks one.
    """
    found = []
    for joint in lamp.joints:
        servo = base.servo(joint.servo, joint.name)
        for name in names:
            prior = base.joint(joint.name, name) if name in JOINT else servo[name]
            unit = (SERVO.get(name) or JOINT[name]).unit
            found.append(Unknown(joint.name, name, prior, SPREAD[name], unit))
    return tuple(found)


def gears_of(lamp: Lamp, base: Calibration) -> tuple[Unknown, ...]:
    """Return each joint's play and the arm's stiffness; nothing where the base calibration has either already.

    Args:
        lamp: Its joints.
        base: What is known before.
    """
    plays = [base.joint(joint.name, "backlash") for joint in lamp.joints]
    if any(plays) or math.isfinite(base.lamp("arm_stiffness")):
        return ()
    return (
        *(Unknown(joint.name, "backlash", *GEARS["backlash"], JOINT["backlash"].unit) for joint in lamp.joints),
        Unknown("", "arm_stiffness", *GEARS["arm_stiffness"], LAMP["arm_stiffness"].unit),
    )


def calibrated(base: Calibration, asked: Sequence[Unknown], z: Array, lamp: Mapping[str, float]) -> Calibration:
    """Return the base calibration with other values.

    Args:
        base: What is known before.
        asked: The unknowns, m of them.
        z: Their values in standard deviations from their priors, shape (m,).
        lamp: Values of the lamp as a whole, by name.
    """
    groups = {name: dict(parameters) for name, parameters in base.groups.items()}
    for unknown, value in zip(asked, z, strict=True):
        group = groups.setdefault(f"joint {unknown.joint}" if unknown.joint else "lamp", {})
        group[unknown.name] = Parameter(unknown.value(float(value)), unknown.unit, None, "")
    for name, value in lamp.items():
        groups["lamp"][name] = Parameter(value, LAMP[name].unit, None, "")
    return replace(base, groups=groups)
