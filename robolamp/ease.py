"""Eases: how a movement from one pose to the next is spread over its time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any


@dataclass(frozen=True)
class Ease:
    """A curve from 0 at 0 to 1 at 1 that never goes back.

    Attributes:
        curve: Share of the way, at a share of the time from 0 to 1 or an array of such.
        fastest: Its steepest slope: the peak speed by the mean speed.
    """

    curve: Callable[[Any], Any]
    fastest: float

    def __call__(self, share: float) -> float:
        """Return the share of the way.

        Args:
            share: Elapsed share of the time; held at the ends outside 0 to 1.
        """
        return self.curve(min(max(share, 0.0), 1.0))


LINEAR, SLOW, MINIMUM_JERK = "linear", "slow in and out", "minimum jerk"

EASES: Mapping[str, Ease] = MappingProxyType(
    {
        LINEAR: Ease(lambda s: s, 1.0),
        SLOW: Ease(lambda s: s * s * (3.0 - 2.0 * s), 1.5),
        MINIMUM_JERK: Ease(lambda s: s * s * s * (10.0 - 15.0 * s + 6.0 * s * s), 1.875),
    }
)
"""By name. Slow in and out is at rest at both ends (a cubic, as animators' key frames have it); minimum jerk is without
acceleration there, too (Flash and Hogan 1985): how an arm moves."""
