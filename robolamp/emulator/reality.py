"""Realities: how an emulated lamp differs from its twin, so that a comparison of the two has something to find.

A TOML file of sim/lamp/realities/; every value is optional, and off unless it is given:

    name = "worn"
    seed = 1                     # of all noise

    [joint.knee]                 # a joint of hardware/lamp.toml
    strength = 0.92              # torque constant, times this
    friction = 1.3               # all friction of its servo, times this
    encoder_noise = 0.001        # rad, standard deviation of each reading

    [line]
    latency = 0.0                # s, how late every instruction reaches the servos
    jitter = 0.0003              # s, mean of how much later still (exponential)

    [supply]
    resistance = 0.0             # Ohm, of cable and battery: the supply sags under load
    drain = 0.0                  # V/s, by which it falls as time goes

    [foot]
    gain = 1.0                   # sensor reading, times this
    offset = 0.0                 # N, added to each reading
    drift = 0.0                  # N/s, by which the offset grows
    noise = 0.03                 # N, standard deviation of each reading

    [lamp]
    floor_friction = 1.0         # sliding friction of foot on floor, times this
    mass = 1.0                   # all masses, times this
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.files import Table, read_toml
from robolamp.lamp import Lamp

NONE = "none"
"""Name of the reality that is the twin itself."""

FOLDER = "sim/lamp/realities"
"""Where realities are found by name."""


@dataclass(frozen=True)
class Reality:
    """How an emulated lamp differs from its twin; arrays have shape (n,) over its joints.

    Attributes:
        name: The reality's name.
        strength: Torque constants, times this.
        friction: All friction of the servos, times this.
        encoder_noise: Standard deviation of each angle reading [rad].
        latency: How late every instruction reaches the servos [s].
        jitter: Mean of how much later still [s].
        resistance: Of the supply [Ohm].
        drain: By how much the supply falls as time goes [V/s].
        foot_gain: Foot sensor reading, times this.
        foot_offset: Added to each force reading [N].
        foot_drift: By how much that grows [N/s].
        foot_noise: Standard deviation of each force reading [N].
        floor_friction: Sliding friction of foot on floor, times this.
        mass: All masses, times this.
        seed: Of all noise.
    """

    name: str
    strength: NDArray[np.float64]
    friction: NDArray[np.float64]
    encoder_noise: NDArray[np.float64]
    latency: float = 0.0
    jitter: float = 0.0
    resistance: float = 0.0
    drain: float = 0.0
    foot_gain: float = 1.0
    foot_offset: float = 0.0
    foot_drift: float = 0.0
    foot_noise: float = 0.0
    floor_friction: float = 1.0
    mass: float = 1.0
    seed: int = 0

    @classmethod
    def none(cls, lamp: Lamp) -> Reality:
        """Return the reality that is the twin itself."""
        n = len(lamp.joints)
        return cls(NONE, np.ones(n), np.ones(n), np.zeros(n))


def load_reality(name: str | Path, lamp: Lamp, assets: Assets) -> Reality:
    """Read a reality.

    Args:
        name: "none", a file, or the name of one in sim/lamp/realities/.
        lamp: Names the joints a reality may bend.
        assets: Where to look.

    Raises:
        FileError: No such file or name, an unknown key or joint, or a value outside its range.
    """
    if str(name) == NONE:
        return Reality.none(lamp)
    path = assets.named(name, FOLDER, "reality")
    root = Table(read_toml(path), str(path))
    title, seed = root.text("name"), root.integer("seed", 0, 2**32 - 1, default=0)
    joints = root.table("joint", default={})
    for joint in joints.names():
        if joint not in lamp.names:
            raise joints.fail(joint, f"no such joint; expected one of {', '.join(lamp.names)}")
    own = [joints.table(joint, default={}) for joint in lamp.names]
    line, supply, foot, whole = (root.table(key, default={}) for key in ("line", "supply", "foot", "lamp"))
    reality = Reality(
        name=title,
        strength=np.array([table.number("strength", 0.1, 2.0, default=1.0) for table in own]),
        friction=np.array([table.number("friction", 0.0, 10.0, default=1.0) for table in own]),
        encoder_noise=np.array([table.number("encoder_noise", 0.0, 0.1, "rad", default=0.0) for table in own]),
        latency=line.number("latency", 0.0, 0.05, "s", default=0.0),
        jitter=line.number("jitter", 0.0, 0.05, "s", default=0.0),
        resistance=supply.number("resistance", 0.0, 1.0, "Ohm", default=0.0),
        drain=supply.number("drain", 0.0, 0.1, "V/s", default=0.0),
        foot_gain=foot.number("gain", 0.0, 10.0, default=1.0),
        foot_offset=foot.number("offset", -10.0, 10.0, "N", default=0.0),
        foot_drift=foot.number("drift", -1.0, 1.0, "N/s", default=0.0),
        foot_noise=foot.number("noise", 0.0, 10.0, "N", default=0.0),
        floor_friction=whole.number("floor_friction", 0.05, 5.0, default=1.0),
        mass=whole.number("mass", 0.2, 5.0, default=1.0),
        seed=seed,
    )
    for table in (root, *own, line, supply, foot, whole):
        table.done()
    return reality
