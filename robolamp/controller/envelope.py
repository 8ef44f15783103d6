"""The envelope: what a controller asks for, made safe to send.

`bounded` is the rule, for one goal. `Envelope` keeps to it on the lamp, without numba; `robolamp.controller.kernels`
compiles the same lines for the twin's many lanes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robolamp.signals import Interventions


def bounded(wanted: float, last: float, lower: float, upper: float, step: float) -> tuple[float, bool, bool, bool]:
    """Return the goal to send, and what had to be changed: it was not finite, outside its limits, too fast.

    A value that is not finite repeats the last goal.

    Args:
        wanted: What the controller asks for [rad].
        last: The goal sent last [rad].
        lower: Smallest goal [rad].
        upper: Largest goal [rad].
        step: Largest change of a goal in a control period [rad].
    """
    finite = math.isfinite(wanted)
    held = wanted if finite else last
    inside = min(max(held, lower), upper)
    slow = min(max(inside, last - step), last + step)
    # Plus 0.0: a goal of -0.0 becomes 0.0, so that goals that are alike are alike to the bit.
    return slow + 0.0, not finite, inside != held, slow != inside


class Envelope:
    """Keeps a lamp's goals finite, inside the joints' limits, and no faster than the slew limit.

    Args:
        lower: Smallest goals, shape (n,) [rad].
        upper: Largest goals, shape (n,) [rad].
        slew: Fastest change of a goal, shape (n,) [rad/s].
        period: Control period [s].
        start: Goals at the first tick, shape (n,) [rad].
    """

    def __init__(
        self,
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        slew: NDArray[np.float64],
        period: float,
        start: NDArray[np.float64],
    ) -> None:
        self._limits = [limit.tolist() for limit in (lower, upper, slew * period)]
        self._goal = start.tolist()
        self._changed = np.zeros(3, np.int64)

    @property
    def interventions(self) -> Interventions:
        """How often goals had to be changed so far."""
        return Interventions(*self._changed.tolist())

    def apply(self, wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the goals to send, shape (n,) [rad], and count what had to be changed.

        Args:
            wanted: What the controller asks for, shape (n,) [rad]; may hold NaN and infinities.
        """
        found = map(bounded, wanted.tolist(), self._goal, *self._limits)
        self._goal, *changed = map(list, zip(*found, strict=True))
        self._changed += np.sum(changed, axis=1)
        return np.array(self._goal)
