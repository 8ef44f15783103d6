"""What the foot felt since the last tick: the sensor samples faster than the controller runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class FootWindow:
    """Sums up a tick's samples of the floor force, lane by lane.

    Args:
        lanes: Number of lanes.
        contact_on: Force above which the foot is on the ground [N].
        contact_off: Force below which it no longer is [N].
    """

    def __init__(self, lanes: int, contact_on: float, contact_off: float) -> None:
        self._on, self._off = contact_on, contact_off
        self._contact = np.ones(lanes, bool)
        self._force, self._grounded = np.zeros(lanes), np.zeros(lanes)
        self._samples = 0

    def add(self, force: Array | float) -> None:
        """Take a sample of each lane, shape (lanes,) [N]."""
        self._contact = force > np.where(self._contact, self._off, self._on)
        self._force += force
        self._grounded += self._contact
        self._samples += 1

    def take(self) -> tuple[Array, Array]:
        """Return what came since the last call, and begin anew.

        Returns:
            Mean force [N] and share of the samples with the foot on the ground, shape (lanes,); NaN where none came.
        """
        count = self._samples or np.nan
        found = self._force / count, self._grounded / count
        self._force, self._grounded, self._samples = np.zeros_like(self._force), np.zeros_like(self._grounded), 0
        return found
