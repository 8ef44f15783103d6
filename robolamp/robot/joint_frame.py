"""Converts between joint angles and servo angles: sign, zero, and the jump at a full turn."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robolamp.lamp import Lamp

Array = NDArray[np.float64]


def wrapped(angle: Array) -> Array:
    """Return angles brought into (-pi, pi] by whole turns [rad]; NaN stays NaN."""
    return math.pi - np.mod(math.pi - angle, 2 * math.pi)


class JointFrame:
    """Converts between joint and servo terms: joint = sign * (servo - zero).

    Args:
        lamp: Gives signs and zeros.
    """

    def __init__(self, lamp: Lamp) -> None:
        self.sign = np.array([float(joint.sign) for joint in lamp.joints])
        self.zero = np.array([joint.zero for joint in lamp.joints])

    def joint_angle(self, servo_angle: Array) -> Array:
        """Return joint angles in (-pi, pi], shape (n,) [rad].

        Args:
            servo_angle: As the servos report them, any turn, shape (n,) [rad].
        """
        return wrapped(self.sign * (servo_angle - self.zero))

    def servo_angle(self, joint_angle: Array) -> Array:
        """Return servo angles, shape (n,) [rad]; outside 0 to 2 pi where the joint's range crosses the seam.

        Args:
            joint_angle: Shape (n,) [rad].
        """
        return self.zero + self.sign * joint_angle
