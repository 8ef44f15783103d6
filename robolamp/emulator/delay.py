"""The servos' delay where the plant keeps it: the same as MuJoCo's `delay` with linear interpolation."""

from __future__ import annotations

import math
from collections import deque


class DelayLine:
    """Gives back what it was given a while ago.

    Args:
        delay: How long ago [s].
        timestep: Time between two values [s].
    """

    def __init__(self, delay: float, timestep: float) -> None:
        steps = delay / timestep
        self._whole = math.floor(steps)
        self._part = steps - self._whole
        self._values: deque[float] = deque(maxlen=self._whole + 2)
        self.reset(0.0)

    def reset(self, value: float) -> None:
        """Forget everything but one value."""
        self._values.extend([value] * (self._whole + 2))

    def push(self, value: float) -> float:
        """Take the next value, and return the one of `delay` ago, interpolated."""
        self._values.append(value)
        older, newer = self._values[0], self._values[1]
        return newer + self._part * (older - newer)
