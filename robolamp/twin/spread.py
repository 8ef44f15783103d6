"""The spread: how lamps of one design differ, to draw lamps from (sim/tasks/spread.toml)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.files import Table, read_toml
from robolamp.twin.lamp_model import Bend

CUT = 3.0
"""No draw is further out than this many standard deviations."""


@dataclass(frozen=True)
class Spread:
    """Standard deviations of a lamp's differences; see `Bend` for what they change.

    Attributes:
        strength: Relative, each joint on its own.
        friction: Relative, each joint on its own.
        mass: Relative.
        floor: Relative.
        delay: [s].
        supply: [V].
    """

    strength: float
    friction: float
    mass: float
    floor: float
    delay: float
    supply: float

    def draw(self, rng: np.random.Generator, joints: int, scale: float = 1.0) -> Bend:
        """Draw one lamp.

        Args:
            rng: Where randomness comes from.
            joints: Number of joints.
            scale: Every standard deviation, times this.
        """

        def normal(count: int) -> NDArray[np.float64]:
            return scale * np.clip(rng.standard_normal(count), -CUT, CUT)

        each, whole = normal(2 * joints), normal(4)
        return Bend(
            strength=1 + self.strength * each[:joints],
            friction=np.maximum(1 + self.friction * each[joints:], 0.0),
            mass=1 + self.mass * float(whole[0]),
            floor=max(1 + self.floor * float(whole[1]), 0.05),
            delay=self.delay * float(whole[2]),
            supply=self.supply * float(whole[3]),
        )


def load_spread(assets: Assets) -> Spread:
    """Read sim/tasks/spread.toml.

    Raises:
        FileError: The file is missing or malformed.
    """
    path = assets.path("sim/tasks/spread.toml")
    root = Table(read_toml(path), str(path))
    root.integer("schema", 1, 1)
    spread = Spread(
        strength=root.number("strength", 0.0, 0.3),
        friction=root.number("friction", 0.0, 0.3),
        mass=root.number("mass", 0.0, 0.3),
        floor=root.number("floor", 0.0, 0.3),
        delay=root.number("delay", 0.0, 0.01, "s"),
        supply=root.number("supply", 0.0, 1.0, "V"),
    )
    root.done()
    return spread
