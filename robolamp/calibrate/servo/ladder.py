"""What a fit may free: parameters with their priors, and the ladder of models from Coulomb friction to all terms."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.calibration import JOINT, SERVO

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prior:
    """How far a servo's own value may well lie from the base calibration's.

    Attributes:
        spread: One standard deviation: of a scaled parameter the logarithm's, of a shifted one in its unit.
        scaled: Whether it is scaled (and stays above 0) or shifted.
    """

    spread: float
    scaled: bool = False


PRIORS: Mapping[str, Prior] = {
    "torque_constant": Prior(0.20, scaled=True),
    "resistance": Prior(0.20, scaled=True),
    "armature": Prior(0.40, scaled=True),
    "viscous": Prior(1.0, scaled=True),
    "coulomb": Prior(1.0, scaled=True),
    "delay": Prior(0.005),
    "encoder_offset": Prior(0.02),
    "stribeck": Prior(0.01),
    "stribeck_velocity": Prior(1.0, scaled=True),
    "load_motor": Prior(0.15),
    "load_external": Prior(0.15),
    "load_external_stribeck": Prior(0.15),
    "load_motor_stribeck": Prior(0.15),
    "saturation": Prior(0.2),
    "supply_resistance": Prior(0.3),
    "resistance_temperature": Prior(0.01),
    "viscous_temperature": Prior(0.05),
    "asymmetry": Prior(0.1),
    "stribeck_exponent": Prior(0.4, scaled=True),
}
"""Published identifications of one servo model spread by about as much; the last rows are estimates."""


@dataclass(frozen=True)
class Rung:
    """A step of the ladder.

    Attributes:
        name: What is added.
        parameters: The parameters it frees beside those of the rungs that are kept; some may be free already.
    """

    name: str
    parameters: tuple[str, ...]


LADDER = (
    Rung(
        "Coulomb and viscous friction",
        ("torque_constant", "resistance", "armature", "viscous", "coulomb", "delay", "encoder_offset"),
    ),
    Rung("friction grows with load", ("load_motor", "load_external")),
    Rung("the motor saturates", ("saturation",)),
    Rung("Stribeck", ("stribeck", "stribeck_velocity")),
    Rung("Stribeck grows with load", ("load_external_stribeck", "load_motor_stribeck", "stribeck_velocity")),
    Rung("the supply sags", ("supply_resistance",)),
    Rung("temperature", ("resistance_temperature", "viscous_temperature")),
    Rung("direction", ("asymmetry",)),
    Rung("shape of Stribeck", ("stribeck_exponent",)),
)
"""From the simplest model to all terms."""

_OFF = {"stribeck_velocity": 0.2}  # what a term that is off is held at, where that is not 0 or the default


def switched_off(base: Mapping[str, float]) -> dict[str, float]:
    """Return a base calibration's values with every term above the first rung off."""
    legal = {**SERVO, **JOINT}
    values = {**base, "encoder_offset": base.get("encoder_offset", 0.0)}
    for name in (name for rung in LADDER[1:] for name in rung.parameters):
        values[name] = _OFF.get(name, legal[name].default or 0.0)
    return values


class Chart:
    """Coordinates of a fit: each parameter as standard deviations of its prior.

    Args:
        names: Free parameters, n of them.
        base: The base calibration's values, the centres of the priors.
        held: Values of everything that is not free.
    """

    def __init__(self, names: Sequence[str], base: Mapping[str, float], held: Mapping[str, float]) -> None:
        legal = {**SERVO, **JOINT}
        self.names = tuple(names)
        self.held = dict(held)
        self._scaled = np.array([PRIORS[name].scaled for name in names])
        self.spread = np.array([PRIORS[name].spread for name in names])
        # A scaled parameter needs a centre above 0.
        self.centre = np.array([max(base.get(name, 0.0), 1e-6) if PRIORS[name].scaled else base.get(name, 0.0)
                                for name in names])  # fmt: skip
        self._low = np.array([legal[name].low for name in names])
        self._high = np.array([legal[name].high for name in names])
        limits = [self.coordinates(bound) for bound in (self._low, self._high)]
        self.low, self.high = np.maximum(limits[0], -8.0), np.minimum(limits[1], 8.0)

    def coordinates(self, values: Array) -> Array:
        """Return coordinates of values, shape (n,)."""
        with np.errstate(divide="ignore"):
            scaled = np.log(np.maximum(values, 0.0) / np.where(self._scaled, self.centre, 1.0))
        return np.where(self._scaled, scaled, values - self.centre) / self.spread

    def values(self, z: Array) -> Array:
        """Return the values at coordinates of shape (..., n)."""
        scaled = self.centre * np.exp(np.where(self._scaled, z * self.spread, 0.0))
        return np.clip(np.where(self._scaled, scaled, self.centre + z * self.spread), self._low, self._high)

    def slope(self, z: Array) -> Array:
        """Return the change of each value per coordinate, shape (n,)."""
        return self.spread * np.where(self._scaled, self.values(z), 1.0)

    def complete(self, z: Array) -> dict[str, float]:
        """Return all parameters by name at coordinates of shape (n,)."""
        return {**self.held, **dict(zip(self.names, self.values(z).tolist(), strict=True))}


def correlation_words(names: Sequence[str], free: Array, weak: float = 0.6) -> list[list[str]]:
    """Return the groups of parameters that data cannot tell apart.

    Args:
        names: The parameters, n of them.
        free: Covariance in units of the priors (prior included), shape (n, n); 1 means nothing was learnt.
        weak: Standard deviation, in units of the prior, from which a combination counts as not learnt.

    Returns:
        For each combination that is not learnt though its members move together, their names, the largest share first.
    """
    sizes, axes = np.linalg.eigh(free)
    groups = []
    for size, axis in zip(sizes[::-1], axes.T[::-1], strict=True):
        members = [index for index in np.argsort(-np.abs(axis)) if abs(axis[index]) > 0.4]
        if math.sqrt(max(size, 0.0)) > weak and len(members) > 1:
            groups.append([names[index] for index in members])
    return groups
