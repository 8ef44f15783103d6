"""Fitness cases: goal distances that are evenly spread, but not on a grid (Gritz & Hahn 1997, section 3.6)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import RobolampError

_SETS = 1000  # a set may jam, its gaps all too small for one more: then a new one is begun ...
_DARTS = 50  # ... after this many throws a goal


def poisson_disk(rng: np.random.Generator, count: int, low: float, high: float, spacing: float) -> NDArray[np.float64]:
    """Draw goals by dart throwing: a sample too close to an earlier one is drawn again.

    Args:
        rng: Where randomness comes from.
        count: How many.
        low: Smallest goal [m].
        high: Largest goal [m].
        spacing: Smallest distance between two [m].

    Returns:
        Goals in ascending order, shape (count,) [m].

    Raises:
        RobolampError: They do not fit.
    """
    for _ in range(_SETS):
        goals: list[float] = []
        for _ in range(_DARTS * count):
            goal = float(rng.uniform(low, high))
            if all(abs(goal - other) >= spacing for other in goals):
                goals.append(goal)
                if len(goals) == count:
                    return np.sort(np.array(goals))
    raise RobolampError(f"{count} goals {spacing:g} m apart do not fit between {low:g} and {high:g} m", "cases")


def poisson_disk_plane(
    rng: np.random.Generator,
    count: int,
    distance: tuple[float, float],
    direction: tuple[float, float],
    spacing: float,
) -> NDArray[np.float64]:
    """Draw points of the plane by dart throwing, evenly over a sector of a ring.

    Args:
        rng: Where randomness comes from.
        count: How many.
        distance: Smallest and largest distance from the origin [m].
        direction: Smallest and largest direction, from x towards y [rad].
        spacing: Smallest distance between two [m].

    Returns:
        Distance [m] and direction [rad] of each, in the order of their directions, shape (count, 2).

    Raises:
        RobolampError: They do not fit.
    """
    for _ in range(_SETS):
        points: list[tuple[float, float]] = []
        for _ in range(_DARTS * count):
            radius = math.sqrt(rng.uniform(distance[0] ** 2, distance[1] ** 2))  # evenly over the area
            radius = min(max(radius, distance[0]), distance[1])  # the root may round past an end
            angle = float(rng.uniform(*direction))
            if all(abs(_polar(radius, angle) - _polar(*other)) >= spacing for other in points):
                points.append((radius, angle))
                if len(points) == count:
                    return np.array(sorted(points, key=lambda point: point[1]))
    where = f"{distance[0]:g} to {distance[1]:g} m away, from {direction[0]:g} to {direction[1]:g} rad"
    raise RobolampError(f"{count} goals {spacing:g} m apart do not fit {where}", "cases")


def _polar(radius: float, angle: float) -> complex:
    return complex(radius * math.cos(angle), radius * math.sin(angle))
