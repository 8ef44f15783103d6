"""Selection: who becomes a parent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def tournament(rng: np.random.Generator, fitness: NDArray[np.float64], size: int) -> int:
    """Return the winner of a tournament: the lowest fitness of `size` individuals drawn with replacement.

    Args:
        rng: Where randomness comes from.
        fitness: Shape (population,), lower is better.
        size: Individuals drawn.
    """
    drawn = rng.integers(len(fitness), size=size)
    return int(drawn[np.argmin(fitness[drawn])])
