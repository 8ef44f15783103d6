"""Lamps drawn around a calibration: by what its fit leaves open, and by how lamps of one design differ.

A calibration that was fitted keeps the covariance of what the recordings told (`[provenance.covariance]`). A lamp is
then drawn from that, correlations included, and sim/tasks/spread.toml adds what the fit does not speak of; which of the
two draws what is in sim/tasks/README.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import JOINT, LAMP, SERVO, Calibration, Parameter
from robolamp.errors import FileError
from robolamp.lamp import Lamp
from robolamp.twin.actuators.gears import RIGID
from robolamp.twin.bend import Bend
from robolamp.twin.variation.spread import CUT, Law, Spread, load_spread

Array = NDArray[np.float64]

_ALONE = ("foot_gain", "contact_softness", "line_delay")  # of the whole lamp: drawn by their own standard errors
_BEND = {field.name for field in fields(Bend)}
_GEARS = {"backlash", "stiffness"}
_FITTED = {
    "strength": "torque_constant", "friction": "coulomb", "coulomb": "coulomb", "viscous": "viscous",
    "stribeck": "stribeck", "stribeck_velocity": "stribeck_velocity", "load_friction": "load_external",
    "armature": "armature", "link_mass": "link_mass",
}  # fmt: skip
"""By key of the spread: the parameter of a joint that takes its place where it was fitted."""
_WHOLE = {"foot_gain": "foot_gain", "floor_softness": "contact_softness", "resistance": "supply_resistance"}
"""The same of the whole lamp."""

_ROUGH = 1e-4  # what a file's rounding to six digits may do to the eigenvalues of a correlation matrix


@dataclass(frozen=True)
class Covariance:
    """What a fit leaves open.

    Attributes:
        groups: Group of each parameter in the calibration ("joint knee", or a servo model), m of them.
        names: Its name there.
        root: A matrix whose product with its transpose is the covariance, shape (m, m).
    """

    groups: tuple[str, ...]
    names: tuple[str, ...]
    root: Array

    def told(self, group: str, name: str) -> bool:
        """Whether a parameter is among them."""
        return (group, name) in zip(self.groups, self.names, strict=True)


class LampLaw:
    """How lamps are drawn around a calibration.

    Args:
        lamp: The lamp's description.
        calibration: Its numbers.
        assets: Where the spread is.
        spread: A file, or the name of one in sim/tasks/.

    Attributes:
        source: What lamps are drawn from, in words.
        calibrated: The calibrated lamp, as `draw` gives one: of the same kind, to stand beside those in a fleet.

    Raises:
        FileError: The spread or the calibration's covariance is malformed.
    """

    def __init__(self, lamp: Lamp, calibration: Calibration, assets: Assets, spread: str = "spread") -> None:
        self._lamp, self._calibration = lamp, calibration
        self._covariance = covariance_of(calibration, lamp)
        laws = load_spread(assets, spread)
        self.source = f"{laws.name}.toml"
        if self._covariance is not None:
            laws, self.source = self._beside(laws), f"{calibration.name}'s covariance and {self.source}"
        self._spread = replace(laws, laws={key: law for key, law in laws.laws.items() if key in _BEND})

        yields = bool(laws.laws.keys() & _GEARS) and math.isinf(calibration.lamp("arm_stiffness"))
        self.calibrated = calibration, Bend(stiffness=RIGID) if yields else Bend()

    def draw(self, rng: np.random.Generator, scale: float = 1.0) -> tuple[Calibration, Bend]:
        """Draw one lamp: the numbers to build it with, and how it is bent.

        Args:
            rng: Where randomness comes from.
            scale: Every standard deviation, times this.
        """
        bend = Bend(**self._spread.draw(int(rng.integers(2**32)), len(self._lamp.joints), scale))
        found = self._covariance
        if found is None:
            return self._calibration, bend

        def normal(count: int) -> Array:
            return scale * np.clip(rng.standard_normal(count), -CUT, CUT)

        groups = {name: dict(parameters) for name, parameters in self._calibration.groups.items()}
        for group, name, off in zip(found.groups, found.names, found.root @ normal(len(found.names)), strict=True):
            legal = SERVO.get(name) or JOINT[name]
            groups[group][name] = _moved(groups[group][name], float(off), legal.low, legal.high)
        for name, off in zip(_ALONE, normal(len(_ALONE)), strict=True):
            parameter = groups["lamp"].get(name)
            if parameter is not None and parameter.stderr is not None:
                error = parameter.stderr * float(off)
                groups["lamp"][name] = _moved(parameter, error, LAMP[name].low, LAMP[name].high)
        told = {key: [self._told(joint.name, name) for joint in self._lamp.joints] for key, name in _FITTED.items()}
        kept = {key: np.where(joints, 1.0, getattr(bend, key)) for key, joints in told.items() if any(joints)}
        return replace(self._calibration, groups=groups), replace(bend, **kept)

    def _beside(self, spread: Spread) -> Spread:
        """Return what is drawn beside the covariance of parameters: of the whole lamp, by its values' own errors."""
        laws = dict(spread.laws)
        if all(self._told(name, "delay") for name in self._lamp.names):
            laws.pop("delay", None)
        for key, name in _WHOLE.items():
            if self._error(name):
                laws.pop(key, None)
        joints = {f"joint {name}" for name in self._lamp.names}
        if self._covariance and joints & set(self._covariance.groups):  # recordings said what play and bending it has
            laws = {key: law for key, law in laws.items() if key not in _GEARS}
        if "mass" in laws and self._error("mass_scale"):
            laws["mass"] = Law("factor", self._error("mass_scale", relative=True))
        # A desk and a supply are not the lamp: they may be others tomorrow.
        for key, fitted in (
            ("floor_friction", Law("factor", self._error("floor_friction", relative=True))),
            ("supply", Law("normal", self._error("supply_voltage"))),
        ):
            if key in laws and fitted.low > max(laws[key].low, laws[key].high):
                laws[key] = fitted
        return replace(spread, laws=laws)

    def _told(self, joint: str, name: str) -> bool:
        return self._covariance is not None and self._covariance.told(f"joint {joint}", name)

    def _error(self, name: str, *, relative: bool = False) -> float:
        """Return the standard error of a value of the whole lamp; 0 where it has none."""
        parameter = self._calibration.groups["lamp"].get(name)
        if parameter is None or parameter.stderr is None:
            return 0.0
        return parameter.stderr / parameter.value if relative else parameter.stderr


def covariance_of(calibration: Calibration, lamp: Lamp) -> Covariance | None:
    """Return the covariance that a calibration's fit left; None where it was not fitted, or nothing was told.

    Args:
        calibration: The calibration.
        lamp: Whose joints it may name.

    Raises:
        FileError: It is malformed.
    """
    table = calibration.provenance.get("covariance")
    if table is None:
        return None

    def fail(what: str) -> FileError:
        return FileError(f"provenance.covariance: {what}", str(calibration.path))

    if not isinstance(table, Mapping) or not isinstance(table.get("parameters"), list):
        raise fail("no list of `parameters`")
    places = [_place(label, calibration, lamp) for label in table["parameters"]]
    if not places:
        return None
    matrix = _square(table.get("matrix"), len(places))
    if matrix is None:
        raise fail(f"`matrix` is not {len(places)} rows of {len(places)} numbers")
    for label, place in zip(table["parameters"], places, strict=True):
        if place is None:
            raise fail(f"{label!r} is no parameter that this file holds")
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not (scale > 0).all():
        raise fail("`matrix` has a diagonal that is not above 0")
    correlation = matrix / np.outer(scale, scale)
    if np.abs(correlation - correlation.T).max() > _ROUGH:
        raise fail("`matrix` is not symmetric")
    sizes, axes = np.linalg.eigh(correlation)
    if sizes.min() < -_ROUGH:
        raise fail("`matrix` is not positive semidefinite")
    root = scale[:, None] * axes * np.sqrt(np.maximum(sizes, 0.0))
    return Covariance(tuple(place[0] for place in places if place), tuple(place[1] for place in places if place), root)


def _square(rows: Any, count: int) -> Array | None:
    """Return rows as a matrix; None where they are not one of that size."""
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return matrix if matrix.shape == (count, count) and np.isfinite(matrix).all() else None


def _place(label: Any, calibration: Calibration, lamp: Lamp) -> tuple[str, str] | None:
    """Return the group and name of a parameter in a calibration: "knee.coulomb", or "coulomb" of the one servo."""
    joint, _, name = str(label).rpartition(".")
    if joint:
        group = f"joint {joint}"
        known = joint in lamp.names
    else:
        models = [key for key in calibration.groups if key != "lamp" and not key.startswith("joint ")]
        group, known = models[0] if models else "", len(models) == 1
        if name in JOINT:  # of a servo's bench: no joint of the lamp
            group = "joint bench"
    known = known and name in {**SERVO, **JOINT} and name in calibration.groups.get(group, {})
    return (group, name) if known else None


def _moved(parameter: Parameter, off: float, low: float, high: float) -> Parameter:
    return replace(parameter, value=min(max(parameter.value + off, low), high))
