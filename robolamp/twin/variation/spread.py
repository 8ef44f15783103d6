"""The spread: how lamps of one design differ, as laws to draw lamps from (sim/tasks/spread.toml, spread-narrow.toml).

The twin's random lamps and the emulator's random realities draw from the same laws. Each key has randomness of its own,
so a law that is added or changed leaves what the others draw as it was.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.files import Table, read_toml

CUT = 3.0
"""No draw is further out than this many standard deviations."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """How one number differs from lamp to lamp; z is standard normal, cut off at `CUT`.

    Attributes:
        kind: "normal": sd z is added. "relative": times 1 + sd z, at least 0.05. "factor": times exp(sd z). "median":
            median exp(sd z). "between": evenly from low to high.
        low: The standard deviation sd, the median, or the least.
        high: The greatest; with "median", the standard deviation of the logarithm.
    """

    kind: str
    low: float
    high: float = 0.0

    def draw(self, rng: np.random.Generator, count: int, off: float, scale: float) -> Array:
        """Draw numbers, shape (count,).

        Args:
            rng: Where randomness comes from.
            count: How many.
            off: What does not differ.
            scale: Every deviation from that, times this; with a median, from the median.
        """
        if self.kind == "between":
            return off + scale * (rng.uniform(self.low, self.high, count) - off)
        z = np.clip(rng.standard_normal(count), -CUT, CUT)
        if self.kind == "normal":
            return off + scale * self.low * z
        if self.kind == "relative":
            return np.maximum(1.0 + scale * self.low * z, 0.05)
        if self.kind == "factor":
            return np.exp(scale * self.low * z)
        return self.low * np.exp(scale * self.high * z)


@dataclass(frozen=True)
class _Key:
    """Of a key: whether each joint has its own, what does not differ (NaN: a law has a median), its unit, the most."""

    each: bool
    off: float
    unit: str
    most: float


_KEYS: Mapping[str, _Key] = {
    "strength": _Key(True, 1.0, "", 0.3),
    "friction": _Key(True, 1.0, "", 0.5),
    "coulomb": _Key(True, 1.0, "", 0.5),
    "viscous": _Key(True, 1.0, "", 0.5),
    "stribeck": _Key(True, 1.0, "", 0.5),
    "stribeck_velocity": _Key(True, 1.0, "", 0.5),
    "load_friction": _Key(True, 1.0, "", 0.5),
    "armature": _Key(True, 1.0, "", 0.3),
    "link_mass": _Key(True, 1.0, "", 0.3),
    "backlash": _Key(True, math.nan, "rad", 0.03),
    "encoder_offset": _Key(True, 0.0, "rad", 0.05),
    "encoder_nonlinearity": _Key(True, 0.0, "rad", 0.03),
    "encoder_noise": _Key(True, 0.0, "rad", 0.03),
    "delay": _Key(False, 0.0, "s", 0.01),
    "temperature": _Key(False, 30.0, "degC", 20.0),
    "latency": _Key(False, 0.0, "s", 0.01),
    "jitter": _Key(False, 0.0, "s", 0.01),
    "supply": _Key(False, 0.0, "V", 1.0),
    "resistance": _Key(False, 0.0, "Ohm", 0.5),
    "drain": _Key(False, 0.0, "V/s", 0.05),
    "foot_gain": _Key(False, 1.0, "", 0.3),
    "foot_offset": _Key(False, 0.0, "N", 1.0),
    "foot_drift": _Key(False, 0.0, "N/s", 0.1),
    "foot_noise": _Key(False, 0.0, "N", 0.5),
    "foot_dead_time": _Key(False, 0.0, "s", 0.03),
    "floor_friction": _Key(False, 1.0, "", 0.3),
    "floor_tilt": _Key(False, 0.0, "rad", 0.05),
    "floor_softness": _Key(False, 1.0, "", 3.0),
    "mass": _Key(False, 1.0, "", 0.3),
    "sideways": _Key(False, 0.0, "m", 0.005),
    "stiffness": _Key(False, math.nan, "Nm/rad", 1000.0),
}
"""Every key of a file of a spread: an attribute of `robolamp.emulator.reality.reality.Reality`."""


@dataclass(frozen=True)
class Spread:
    """How lamps of one design differ.

    Attributes:
        name: Of its file.
        laws: By key; a key that has none does not differ.
    """

    name: str
    laws: Mapping[str, Law]

    def draw(self, seed: int, joints: int, scale: float = 1.0) -> dict[str, Any]:
        """Draw one lamp: values of `Bend` or `Reality` by name, of joints in shape (joints,).

        Args:
            seed: The same seed, number of joints and scale draw the same lamp.
            joints: Number of joints.
            scale: Every deviation, times this.
        """
        drawn: dict[str, Any] = {"seed": seed}
        for name, law in self.laws.items():
            key, rng = _KEYS[name], np.random.default_rng([seed, zlib.crc32(name.encode())])
            values = law.draw(rng, joints if key.each else 1, key.off, scale)
            drawn[name] = values if key.each else float(values[0])
        if "encoder_nonlinearity" in drawn:
            rng = np.random.default_rng([seed, zlib.crc32(b"encoder_phase")])
            drawn["encoder_phase"] = rng.uniform(-math.pi, math.pi, joints)
        return drawn


def load_spread(assets: Assets, name: str = "spread") -> Spread:
    """Read the file of a spread.

    Args:
        assets: Where it is.
        name: A file, or the name of one in sim/tasks/.

    Raises:
        FileError: The file is missing or malformed.
    """
    tasks = tuple(path.stem for path in assets.all("sim/tasks") if not path.stem.startswith("spread"))
    path = assets.named(name, "sim/tasks", "spread", exclude=tasks)
    root = Table(read_toml(path), str(path))
    root.integer("schema", 2, 2)
    laws = {key: _law(root, key) for key in root.names() if key != "schema"}
    return Spread(path.stem, laws)


def _law(root: Table, name: str) -> Law:
    key = _KEYS.get(name)
    if key is None:
        raise root.fail(name, f"no such key; expected one of {', '.join(_KEYS)}")
    table, kinds = root.table(name), ["median"]
    if not math.isnan(key.off):
        kinds = ["low", "factor", "relative"] if key.off == 1.0 else ["low", "normal"]
    given = [kind for kind in kinds if kind in table]
    if len(given) != 1:
        raise root.fail(name, f"expected a table with {' or '.join(kinds)}")
    kind = given[0]
    most = key.most + 1.0 if kind == "low" and key.off == 1.0 else key.most  # of a factor itself, not of its deviation
    first = table.number(kind, 0.0, most, key.unit)
    second = 0.0
    if kind == "low":
        second = table.number("high", first, most, key.unit)
    if kind == "median":
        second = table.number("factor", 0.0, 1.0)
    table.done()
    return Law("between" if kind == "low" else kind, first, second)
