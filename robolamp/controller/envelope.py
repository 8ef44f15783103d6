"""The envelope: what a controller asks for, made safe to send; one code for the lanes of the twin and for the lamp."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Envelope:
    """Keeps goals finite, inside the joints' limits, and no faster than the slew limit.

    Args:
        lower: Smallest goals, shape (joints,) [rad].
        upper: Largest goals, shape (joints,) [rad].
        slew: Fastest change of a goal, shape (joints,) [rad/s].
        period: Control period [s].
        start: Goals at the first tick, shape (lanes, joints) [rad].
    """

    def __init__(
        self,
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        slew: NDArray[np.float64],
        period: float,
        start: NDArray[np.float64],
    ) -> None:
        self._lower = lower
        self._upper = upper
        self._step = slew * period
        self.goal = start.astype(np.float64, copy=True)
        lanes = len(start)
        self.not_finite = np.zeros(lanes, np.int64)
        self.limited = np.zeros(lanes, np.int64)
        self.slewed = np.zeros(lanes, np.int64)

    def apply(self, wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the goals to send, and count what had to be changed.

        A value that is not finite repeats the joint's last goal.

        Args:
            wanted: What the controller asks for, shape (lanes, joints) [rad]; may hold NaN and infinities.

        Returns:
            Goals, shape (lanes, joints) [rad].
        """
        finite = np.isfinite(wanted)
        held = np.where(finite, wanted, self.goal)
        inside = np.clip(held, self._lower, self._upper)
        # Plus 0.0: a goal of -0.0 becomes 0.0, so that goals that are alike are alike to the bit.
        slow = np.clip(inside, self.goal - self._step, self.goal + self._step) + 0.0
        self.not_finite += np.count_nonzero(~finite, axis=1)
        self.limited += np.count_nonzero(inside != held, axis=1)
        self.slewed += np.count_nonzero(slow != inside, axis=1)
        self.goal = slow
        return slow

    def select(self, keep: NDArray[np.int64]) -> None:
        """Keep only these lanes, in this order.

        Args:
            keep: Lane indices.
        """
        for name in ("goal", "not_finite", "limited", "slewed"):
            setattr(self, name, getattr(self, name)[keep])
