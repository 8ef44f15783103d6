"""Where the links are in a pose."""

from __future__ import annotations

import math
from collections.abc import Sequence

from build123d import Location

from description import BODIES, JOINTS, Shape


def link_places(shape: Shape, angles: Sequence[float]) -> dict[str, Location]:
    """Return where each link is.

    Args:
        shape: The lamp's measures.
        angles: Joint angles from the neutral pose [rad].
    """
    lengths = (shape.foot["axis"], shape.arms["lower"], shape.arms["upper"])
    found = {"base": Location()}
    place = Location()
    for body, height, joint, angle in zip(BODIES[1:], lengths, JOINTS, angles, strict=True):
        place = place * Location((0, 0, height), (0, math.degrees(shape.neutral[joint] + angle), 0))
        found[body] = place
    return found
