"""The sensor model: what servos and foot sensor would read of the true state. The hardware does this by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.registers import RAD_PER_COUNT

_FORCE_STEP = 0.001  # hardware/firmware/README.md: the frame carries millinewtons


def measure_angle(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles as the encoders read them [rad], same shape."""
    return np.round(angle / RAD_PER_COUNT) * RAD_PER_COUNT


def measure_force(
    force: NDArray[np.float64], gain: NDArray[np.float64] | float = 1.0, noise: NDArray[np.float64] | float = 0.0
) -> NDArray[np.float64]:
    """Return floor forces as the foot sensor reads them [N], same shape.

    Args:
        force: True forces [N].
        gain: Reading per true force.
        noise: Added to each reading [N].
    """
    return np.round((force * gain + noise) / _FORCE_STEP) * _FORCE_STEP
