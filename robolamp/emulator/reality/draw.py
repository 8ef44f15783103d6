"""Realities drawn at random: unknown lamps to test calibration on, and single knobs to test a diagnosis on.

`random_reality` changes everything at once, also what no calibration can express, as the spread says (sim/tasks/
spread.toml): the lamps that controllers are scored on are drawn from the same laws. `random_knob` changes one number by
more than lamps of one design differ by.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from robolamp.assets import Assets
from robolamp.emulator.reality.reality import Reality
from robolamp.errors import FileError
from robolamp.lamp import Lamp
from robolamp.twin.variation.spread import load_spread

COPPER = 0.0039
"""By which copper's resistance grows [1/K]."""

_LARGEST_SCALE = 3.0


def random_reality(lamp: Lamp, seed: int, scale: float = 1.0, assets: Assets | None = None) -> Reality:
    """Draw a whole reality.

    Args:
        lamp: The lamp that is bent.
        seed: The same seed, lamp, spread and scale give the same reality.
        scale: Every deviation from the twin, times this, 0 to 3; of play and stiffness, from the spread's medians.
        assets: Where the spread is; by default where sim/ is.

    Raises:
        ValueError: The scale is outside that range.
        FileError: The spread is malformed.
    """
    if not 0.0 <= scale <= _LARGEST_SCALE:
        raise ValueError(f"scale: {scale} is not a number from 0 to {_LARGEST_SCALE:g}")
    return Reality(
        name=f"random:{seed}" if scale == 1.0 else f"random:{seed}:{scale:g}",
        resistance_per_kelvin=min(scale, 1.0) * COPPER,
        **load_spread(assets or Assets()).draw(seed, len(lamp.joints), scale),
    )


@dataclass(frozen=True)
class Knob:
    """A reality in which exactly one thing differs from the twin.

    Attributes:
        kind: One of `KINDS`.
        joint: The joint that is bent; None: the whole lamp.
        value: What the knob is at, as the reality's key has it.
        unit: Of the value; "1" for a factor.
        reality: The reality.
    """

    kind: str
    joint: str | None
    value: float
    unit: str
    reality: Reality


@dataclass(frozen=True)
class _Kind:
    """One knob: an attribute of `Reality`, how large it is drawn, and its unit."""

    attribute: str
    draw: Callable[[np.random.Generator], float]
    unit: str = "1"
    of_a_joint: bool = False


def _either(low: float, high: float) -> Callable[[np.random.Generator], float]:
    """Return what draws a size between two, of either sign."""
    return lambda rng: float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


def _factor(low: float, high: float) -> Callable[[np.random.Generator], float]:
    """Return what draws a factor that is off by between two ratios, up or down."""
    return lambda rng: float(math.exp(rng.choice([-1.0, 1.0]) * rng.uniform(math.log(low), math.log(high))))


def _between(low: float, high: float) -> Callable[[np.random.Generator], float]:
    return lambda rng: float(rng.uniform(low, high))


KINDS: Mapping[str, _Kind] = MappingProxyType(
    {
        "delay": _Kind("delay", _between(0.004, 0.010), "s"),
        "strength": _Kind("strength", _between(0.60, 0.85), of_a_joint=True),
        "friction": _Kind("friction", _between(1.5, 2.5), of_a_joint=True),
        "backlash": _Kind("backlash", _between(0.015, 0.040), "rad", of_a_joint=True),
        "floor_friction": _Kind("floor_friction", _between(0.3, 0.6)),
        "mass": _Kind("mass", _factor(1.08, 1.25)),
        "supply_sag": _Kind("resistance", _between(0.3, 0.8), "Ohm"),
        "supply_voltage": _Kind("supply", _between(-1.0, -0.4), "V"),
        "foot_gain": _Kind("foot_gain", _factor(1.15, 1.5)),
        "foot_offset": _Kind("foot_offset", _either(0.3, 1.0), "N"),
        "latency": _Kind("latency", _between(0.004, 0.010), "s"),
        "jitter": _Kind("jitter", _between(0.002, 0.005), "s"),
        "encoder_offset": _Kind("encoder_offset", _either(0.03, 0.08), "rad", of_a_joint=True),
        "encoder_noise": _Kind("encoder_noise", _between(0.004, 0.010), "rad", of_a_joint=True),
        "compliance": _Kind("stiffness", _between(5.0, 10.0), "Nm/rad"),
        "tilt": _Kind("floor_tilt", _either(0.03, 0.08), "rad"),
    }
)
"""Kinds of knob: what is bent, drawn clearly beyond what lamps of one design differ by."""


def random_knob(kind: str, lamp: Lamp, seed: int) -> Knob:
    """Change exactly one knob by a random size; for a joint's knob, the joint is random too.

    Args:
        kind: One of `KINDS`.
        lamp: The lamp that is bent.
        seed: The same seed, lamp and kind give the same reality.

    Raises:
        ValueError: There is no such kind.
    """
    if kind not in KINDS:
        raise ValueError(f"kind: {kind!r} is not one of {', '.join(KINDS)}")
    knob = KINDS[kind]
    rng = np.random.default_rng([seed, 2])
    index, value = int(rng.integers(len(lamp.joints))), knob.draw(rng)
    none = replace(Reality.none(lamp), name=f"knob:{kind}:{seed}", seed=seed)
    bent: Any = value
    if knob.of_a_joint:
        bent = np.array(np.broadcast_to(getattr(none, knob.attribute), len(lamp.joints)), float)
        bent[index] = value
    joint = lamp.names[index] if knob.of_a_joint else None
    return Knob(kind, joint, value, knob.unit, replace(none, **{knob.attribute: bent}))


def drawn(name: str, lamp: Lamp, assets: Assets) -> Reality | None:
    """Return the reality that "random:SEED[:SCALE]" or "knob:KIND:SEED" names; None where it names none of these.

    Args:
        name: The name.
        lamp: The lamp that is bent.
        assets: Where the spread is.

    Raises:
        FileError: It begins so, and goes on wrongly; or the spread is malformed.
    """
    head, _, rest = name.partition(":")
    parts = rest.split(":")
    if not rest or head not in ("random", "knob"):
        return None
    try:
        if head == "random" and len(parts) <= 2:
            scale = _scale(parts[1]) if len(parts) == 2 else 1.0
            return random_reality(lamp, _seed(parts[0]), scale, assets)
        if head == "knob" and len(parts) == 2:
            return random_knob(parts[0], lamp, _seed(parts[1])).reality
    except ValueError as error:
        raise FileError(str(error), name) from None
    expected = "random:SEED or random:SEED:SCALE" if head == "random" else "knob:KIND:SEED"
    raise FileError(f"expected {expected}, as {'random:7' if head == 'random' else 'knob:backlash:7'}", name)


def _scale(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"scale: {text!r} is not a number from 0 to {_LARGEST_SCALE:g}") from None


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**32:
        raise ValueError(f"seed: {text!r} is not a whole number from 0 to {2**32 - 1}")
    return int(text)
