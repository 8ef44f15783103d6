"""Realities drawn at random: unknown lamps to test calibration on, and single knobs to test a diagnosis on.

`random_reality` changes everything at once, also what no calibration can express. With scale 1 it draws, for each joint
on its own or for the whole lamp (N: normal, cut off at 2.5 standard deviations; U: uniform; exp: of what follows):

| what | drawn as | why so |
| --- | --- | --- |
| strength | exp N(-0.05, 0.05) | motors of one batch, weaker with age |
| friction | exp N(0.05, 0.10) | gears wear and gather dirt |
| coulomb, viscous, load_friction | exp N(0, 0.12) each | identifications of one model differ so |
| stribeck, stribeck_velocity | exp N(0, 0.25), exp N(0, 0.2) | the same |
| armature | exp N(0, 0.1) | the same |
| link mass | exp N(0, 0.04) | prints and screws |
| backlash | U(1, 9) mrad | ROBOTIS prints 4 mrad (0.25 deg) for its larger servos; plastic gears have more |
| encoder nonlinearity, phase | U(0, 6) mrad, any | a magnet off its axis; AS5601's datasheet allows 17 mrad |
| encoder noise, offset | U(0.2, 1.2) mrad, N(0, 4) mrad | steps of 1.5 mrad; a zero pose set by eye |
| servo delay | N(0, 1) ms | |
| air | N(28, 4) degC, windings as copper | |
| line latency, jitter | U(0, 1) ms, U(0, 0.5) ms | USB adapters |
| supply voltage, resistance, drain | N(0, 0.1) V, U(0.02, 0.2) Ohm, U(0, 1) mV/s | cable, connector, battery |
| foot gain, offset, drift | N(1, 0.03), N(0, 0.05) N, N(0, 1) mN/s | load cells |
| foot noise, dead time | U(10, 50) mN, U(0, 4) ms | |
| floor friction, tilt, softness | exp N(0, 0.15), N(0, 8) mrad, 1 + U(0, 1.5) | desks |
| stiffness behind each servo | exp U(ln 20, ln 50) Nm/rad | servo horns on printed parts |

All of it is chosen, not measured. `scale` multiplies each deviation from off (and divides the stiffness).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.emulator.reality.reality import AIR, Reality
from robolamp.errors import FileError
from robolamp.lamp import Lamp

COPPER = 0.0039
"""By which copper's resistance grows [1/K]."""

_CUT = 2.5  # standard deviations
_LARGEST_SCALE = 3.0


def random_reality(lamp: Lamp, seed: int, scale: float = 1.0) -> Reality:
    """Draw a whole reality; the table at the top says from what.

    Args:
        lamp: The lamp that is bent.
        seed: The same seed, lamp and scale give the same reality.
        scale: Every deviation from the twin, times this: 0 (the twin itself) to 3.

    Raises:
        ValueError: The scale is outside that range.
    """
    if not 0.0 <= scale <= _LARGEST_SCALE:
        raise ValueError(f"scale: {scale} is not a number from 0 to {_LARGEST_SCALE:g}")
    rng = np.random.default_rng([seed, 1])
    n = len(lamp.joints)

    def normal(deviation: float, mean: float = 0.0, size: int = n) -> NDArray[np.float64]:
        return scale * (mean + deviation * np.clip(rng.standard_normal(size), -_CUT, _CUT))

    def uniform(low: float, high: float, size: int = n) -> NDArray[np.float64]:
        return scale * rng.uniform(low, high, size)

    def one(values: NDArray[np.float64]) -> float:
        return float(values[0])

    stiffness = math.exp(rng.uniform(math.log(20.0), math.log(50.0)))
    return Reality(
        name=f"random:{seed}" if scale == 1.0 else f"random:{seed}:{scale:g}",
        seed=seed,
        strength=np.exp(normal(0.05, -0.05)),
        friction=np.exp(normal(0.10, 0.05)),
        coulomb=np.exp(normal(0.12)),
        viscous=np.exp(normal(0.12)),
        load_friction=np.exp(normal(0.12)),
        stribeck=np.exp(normal(0.25)),
        stribeck_velocity=np.exp(normal(0.2)),
        armature=np.exp(normal(0.1)),
        link_mass=np.exp(normal(0.04)),
        backlash=uniform(1e-3, 9e-3),
        encoder_nonlinearity=uniform(0.0, 6e-3),
        encoder_phase=rng.uniform(-math.pi, math.pi, n),
        encoder_noise=uniform(0.2e-3, 1.2e-3),
        encoder_offset=normal(4e-3),
        delay=one(normal(1e-3, size=1)),
        temperature=AIR + one(normal(4.0, -2.0, size=1)),
        resistance_per_kelvin=min(scale, 1.0) * COPPER,
        latency=one(uniform(0.0, 1e-3, 1)),
        jitter=one(uniform(0.0, 0.5e-3, 1)),
        supply=one(normal(0.1, size=1)),
        resistance=one(uniform(0.02, 0.2, 1)),
        drain=one(uniform(0.0, 1e-3, 1)),
        foot_gain=1.0 + one(normal(0.03, size=1)),
        foot_offset=one(normal(0.05, size=1)),
        foot_drift=one(normal(1e-3, size=1)),
        foot_noise=one(uniform(0.01, 0.05, 1)),
        foot_dead_time=one(uniform(0.0, 4e-3, 1)),
        floor_friction=math.exp(one(normal(0.15, size=1))),
        floor_tilt=one(normal(8e-3, size=1)),
        floor_softness=1.0 + one(uniform(0.0, 1.5, 1)),
        stiffness=stiffness / scale if scale else math.inf,
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
        "compliance": _Kind("stiffness", _between(8.0, 20.0), "Nm/rad"),
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


def drawn(name: str, lamp: Lamp) -> Reality | None:
    """Return the reality that "random:SEED[:SCALE]" or "knob:KIND:SEED" names; None where it names none of these.

    Args:
        name: The name.
        lamp: The lamp that is bent.

    Raises:
        FileError: It begins so, and goes on wrongly.
    """
    head, _, rest = name.partition(":")
    parts = rest.split(":")
    if not rest or head not in ("random", "knob"):
        return None
    try:
        if head == "random" and len(parts) <= 2:
            return random_reality(lamp, _seed(parts[0]), _scale(parts[1]) if len(parts) == 2 else 1.0)
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
