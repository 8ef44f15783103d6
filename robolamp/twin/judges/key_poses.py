"""Key poses: how far a lamp was from the pose that somebody wanted to see at a certain time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class KeyPose:
    """A pose to be in at a time.

    Attributes:
        time: Since the run began [s].
        angles: Joint angles, from the foot up [rad].
    """

    time: float
    angles: tuple[float, ...]


class PoseErrors:
    """Compares many lanes with key poses while they run.

    Args:
        poses: The key poses; one after the end of a run is compared with the run's last angles.
        lanes: Number of lanes.
        timestep: Physics step [s].
    """

    def __init__(self, poses: Sequence[KeyPose], lanes: int, timestep: float) -> None:
        self._share = 1.0 / max(len(poses), 1)
        self._due: dict[int, list[NDArray[np.float64]]] = {}
        for pose in poses:
            self._due.setdefault(round(pose.time / timestep), []).append(np.array(pose.angles))
        self._error = np.zeros(lanes)

    def at(self, step: int) -> bool:
        """Whether a pose is due after that many physics steps."""
        return step in self._due

    def compare(self, step: int, angles: NDArray[np.float64]) -> None:
        """Compare the poses that are due after that many physics steps.

        Args:
            step: Physics steps since the run began.
            angles: True joint angles, shape (lanes, joints) [rad].
        """
        for wanted in self._due.pop(step, ()):
            self._error += self._share * np.abs(angles - wanted).mean(axis=1)

    def finish(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compare what is still due with the last angles.

        Args:
            angles: True joint angles at the end, shape (lanes, joints) [rad].

        Returns:
            Mean over the poses of the mean |angle - wanted|, shape (lanes,) [rad]; 0 without poses.
        """
        for step in sorted(self._due):
            self.compare(step, angles)
        return self._error
