"""The odometer's description (sim/lamp/odometer.toml): how far a hop went, from what servos and foot measured of it.

A network of one hidden layer, small enough to be read as text, was learnt from hops on the twin
(`robolamp.evolve.odometry`). `robolamp.controller.odometry` runs it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray

from robolamp.files import Table, parse_toml, read_text, write_atomic

Array = NDArray[np.float64]

TAKEOFF = range(-6, 3)
"""Ticks around the last one on the ground that an odometer looks at."""

LANDING = range(-1, 7)
"""Ticks around the first one on the ground again; after the last of them the hop is measured."""

LEAST_ERROR = 0.001
"""Standard error of a step at least [m], chosen: without it, to stand still would be all that is worth learning."""

_MOST_HIDDEN = 256
_CLIP = 5.0  # standard deviations: how far outside of what it was learnt from a number counts


def feature_names(joints: int) -> tuple[str, ...]:
    """Return what a hop is measured by.

    a0.. angles [rad], w0.. their velocities [rad/s], force and contact (mean floor force [N], share of the time on the
    ground, of a tick) at the ticks of TAKEOFF and LANDING; then the time in the air, without contact before the
    take-off and after the landing, and of it all [s]; the force's integrals over both windows [N s]; the angles that it
    began with [rad].

    Args:
        joints: Number of joints.
    """
    channels = [*(f"a{joint}" for joint in range(joints)), *(f"w{joint}" for joint in range(joints))]
    ticks = [*(f"takeoff{tick:+d}" for tick in TAKEOFF), *(f"landing{tick:+d}" for tick in LANDING)]
    seen = [f"{channel} {tick}" for tick in ticks for channel in (*channels, "force", "contact")]
    whole = ("air", "unloaded before", "unloaded after", "length", "push", "impact")
    return (*seen, *whole, *(f"a{joint} start" for joint in range(joints)))


@dataclass(frozen=True, eq=False)
class Network:
    """One hidden layer of tanh, from features to a hop's length and the logarithm of its error's variance.

    Attributes:
        weights: To the hidden layer, shape (f, h).
        bias: Of the hidden layer, shape (h,).
        outputs: From there, shape (h, 2).
        offset: Of both, shape (2,).
    """

    weights: Array
    bias: Array
    outputs: Array
    offset: Array

    def run(self, inputs: Array) -> tuple[Array, Array]:
        """Return lengths and logarithms of variances, shape (k,), of inputs, shape (k, f).

        Each row is the same to the bit whichever others there are: a product of matrices would not be.
        """
        hidden = np.tanh((inputs[:, :, None] * self.weights).sum(axis=1) + self.bias)
        found = (hidden[:, :, None] * self.outputs).sum(axis=1) + self.offset
        return found[:, 0], found[:, 1]


@dataclass(frozen=True, eq=False)
class Odometer:
    """How far hops go, and how sure that is.

    Attributes:
        joints: Number of joints of the lamp.
        control_period: Time between ticks [s].
        mean: Of each feature over the hops that it was learnt from, shape (f,), as all that follow up to `high`.
        scale: Their standard deviations.
        low: From where on a feature is unlike those ...
        high: ... and up to where.
        network: From scaled features to a hop's length and its error, in units of `hop`.
        hop: Standard deviation of the lengths that it was learnt from [m].
        correlation: Of the errors of two hops of one lamp.
        provenance: What it was learnt from.
        scores: Its error on lamps and controllers that were left out.
        source: The file's text; empty for one that was never in a file.
    """

    joints: int
    control_period: float
    mean: Array
    scale: Array
    low: Array
    high: Array
    network: Network
    hop: float
    correlation: float
    provenance: Mapping[str, Any] = field(default_factory=dict)
    scores: Mapping[str, Any] = field(default_factory=dict)
    source: str = field(default="", repr=False, compare=False)

    def measure(self, features: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return how far hops went.

        Args:
            features: In the order of `feature_names`, shape (k, f).

        Returns:
            Lengths and their standard errors, shape (k,) [m], and which hops are unlike those that it was learnt from:
            of such a one it knows no more than how much hops differ.
        """
        length, log_variance = self.network.run(self.scaled(features))
        unlike = np.any((features < self.low) | (features > self.high), axis=1)
        error = np.hypot(np.exp(log_variance / 2) * self.hop, LEAST_ERROR)
        return length * self.hop, np.where(unlike, np.maximum(error, self.hop), error), unlike

    def scaled(self, features: Array) -> Array:
        """Return features as the network takes them, of the same shape."""
        return np.clip((features - self.mean) / self.scale, -_CLIP, _CLIP)


@lru_cache(maxsize=4)
def parse_odometer(text: str, where: str) -> Odometer:
    """Read an odometer from the text of its file.

    Args:
        text: The text.
        where: What it came from, for messages.

    Raises:
        FileError: It is malformed; the message names the key.
    """
    root = Table(parse_toml(text, where), where)
    root.integer("schema", 1, 1)
    joints, layer, table = root.integer("joints", 1, 16), root.table("hidden"), root.table("features")
    bias = _numbers(layer, "bias")
    hidden = len(bias)
    if not 1 <= hidden <= _MOST_HIDDEN:
        raise layer.fail("bias", f"has {hidden} numbers; expected 1 to {_MOST_HIDDEN}")
    names = feature_names(joints)
    if set(table.names()) != set(names):
        odd = sorted(set(table.names()) ^ set(names))[0]
        raise table.fail(odd, f"{'missing' if odd in names else 'unknown'}; expected those of {joints} joints")
    rows = np.stack([_numbers(table, name, 4 + hidden) for name in names])
    bad = np.flatnonzero(~(rows[:, 1] > 0))
    if len(bad):
        raise table.fail(names[bad[0]], f"its standard deviation {rows[bad[0], 1]:g} is not above 0")
    odometer = Odometer(
        joints=joints,
        control_period=root.number("control_period", 0.002, 0.1, "s"),
        mean=rows[:, 0],
        scale=rows[:, 1],
        low=rows[:, 2],
        high=rows[:, 3],
        network=Network(
            weights=rows[:, 4:],
            bias=bias,
            outputs=np.stack([_numbers(layer, "length", hidden), _numbers(layer, "log_variance", hidden)], axis=1),
            offset=_numbers(layer, "offset", 2),
        ),
        hop=root.number("hop", 1e-6, 10.0, "m"),
        correlation=root.number("correlation", 0.0, 1.0),
        provenance=root.table("provenance", default={}).raw(),
        scores=root.table("scores", default={}).raw(),
        source=text,
    )
    for each in (root, layer, table):
        each.done()
    return odometer


def _numbers(table: Table, key: str, count: int | None = None) -> Array:
    values = table.array(key)
    legal = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if not legal or not np.isfinite(values).all() or (count is not None and len(values) != count):
        raise table.fail(key, f"is not {'a list of' if count is None else count} finite numbers")
    return np.array(values, np.float64)


def load_odometer(path: Path) -> Odometer:
    """Read an odometer's file.

    Args:
        path: The file.

    Raises:
        FileError: It is missing or malformed.
    """
    return parse_odometer(read_text(path), str(path))


def format_odometer(odometer: Odometer) -> str:
    """Return an odometer as the text of its file."""
    document = tomlkit.document()
    document.add(tomlkit.comment("How far each hop of the lamp went, from what its servos and its foot measured:"))
    document.add(tomlkit.comment("made by `robolamp odometer fit`. sim/lamp/README.md explains it."))
    document["schema"] = 1
    document["joints"] = odometer.joints
    document["control_period"] = tomlkit.item(odometer.control_period).comment("s")
    document["hop"] = tomlkit.item(_short(odometer.hop)).comment("m: the unit of lengths and errors below")
    document["correlation"] = tomlkit.item(_short(odometer.correlation)).comment("of errors of one lamp's hops")
    for key, content in (("scores", odometer.scores), ("provenance", odometer.provenance)):
        if content:
            document[key] = dict(content)
    hidden = tomlkit.table()
    network = odometer.network
    rows = (("bias", network.bias), ("length", network.outputs[:, 0]), ("log_variance", network.outputs[:, 1]))
    for key, values in (*rows, ("offset", network.offset)):
        hidden[key] = [_short(value) for value in values]
    document["hidden"] = hidden
    features = tomlkit.table()
    features.add(tomlkit.comment("mean, standard deviation, lowest, highest; weights to the hidden layer"))
    table = np.column_stack([odometer.mean, odometer.scale, odometer.low, odometer.high, network.weights])
    for name, row in zip(feature_names(odometer.joints), table, strict=True):
        features[name] = [_short(value) for value in row]
    document["features"] = features
    return tomlkit.dumps(document)


def _short(value: float) -> float:
    return float(f"{value:.5g}")


def save_odometer(odometer: Odometer, path: Path) -> None:
    """Write an odometer's file, atomically.

    Args:
        odometer: The odometer.
        path: Where to.

    Raises:
        FileError: It cannot be written.
    """
    write_atomic(path, format_odometer(odometer))
