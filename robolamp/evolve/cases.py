"""Fitness cases: goal distances that are well spread but on no grid (Gritz & Hahn 1997, section 3.6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import RobolampError

_SETS = 1000  # a set may jam, its gaps all too small for one more: then a new one is begun ...
_DARTS = 50  # ... after this many throws a goal


def poisson_disk(rng: np.random.Generator, count: int, low: float, high: float, spacing: float) -> NDArray[np.float64]:
    """Draw goals by dart throwing: a sample too close to an earlier one is thrown again.

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
