"""Soft start and release: where every joint is, the first goal, and at the end who still holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import BusError, SafetyError
from robolamp.lamp import Lamp
from robolamp.runtime.clock import PERIOD
from robolamp.signals import LampBackend

Array = NDArray[np.float64]

LOOKS = 5
"""Observations taken to see every joint before torque goes on, and every torque off at the end."""

RELEASE_TIME = 2.0
"""How long servos that do not confirm that their torque is off are told again at the end [s]."""

_AGAIN = 0.1  # s: between two tellings


def present_pose(backend: LampBackend, lamp: Lamp) -> Array:
    """Return where every joint is, shape (n,) [rad], in a few looks at most.

    Raises:
        BusError: A joint's angle was in none of them.
    """
    angle = backend.observe().angle
    for _ in range(LOOKS - 1):
        if np.isfinite(angle).all():
            break
        angle = backend.observe().angle
    if not np.isfinite(angle).all():
        silent = ", ".join(name for name, value in zip(lamp.names, angle, strict=True) if np.isnan(value))
        raise BusError(f"no angle from {silent} in {LOOKS} readings; torque stays off")
    return angle


def first_goal(angle: Array, lamp: Lamp, period: float) -> Array:
    """Return the goal that holds the joints where they are, inside their limits, shape (n,) [rad].

    Args:
        angle: Where they are, shape (n,) [rad].
        lamp: Its limits.
        period: Control period [s].

    Raises:
        SafetyError: It would jump: what is outside the limits is brought to them in one tick.
    """
    goals = np.clip(angle, lamp.lower, lamp.upper)
    step = lamp.slew * max(period, PERIOD)
    for joint, value, goal, most in zip(lamp.joints, angle, goals, step, strict=True):
        if abs(goal - value) > most:
            raise SafetyError(
                f"{joint.name} stands at {value:.2f} rad, outside {joint.lower:g} to {joint.upper:g} rad by more "
                f"than the {most:.2f} rad that its slew limit allows a tick; put the lamp upright by hand",
                str(lamp.path),
            )
    return goals


def still_held(backend: LampBackend, *, powered: bool) -> dict[str, str]:
    """Return the joints whose torque is not confirmed to be off, told again until it is or `RELEASE_TIME` is over.

    Args:
        backend: The lamp, told already.
        powered: Whether its torque may have been on: if not, one that does not answer is none to worry about, and none
            is told again.

    Returns:
        "still" or, of one that does not answer, "perhaps still", by joint.
    """
    clock = backend.clock
    torque = _torque(backend)
    end = clock.now() + RELEASE_TIME
    while powered and torque.any() and clock.now() < end:
        clock.sleep_until(clock.now() + _AGAIN)
        backend.torque(False)
        torque = _torque(backend)
    return {
        name: "still" if state > 0 else "perhaps still"
        for name, state in zip(backend.joints, torque, strict=True)
        if state > 0 or (state < 0 and powered)
    }


def _torque(backend: LampBackend) -> NDArray[np.int64]:
    """Return Torque Enable of each servo, the last of a few looks: 1 on, 0 off, -1 unknown."""
    for _ in range(LOOKS - 1):
        torque = backend.observe().health.torque
        if not torque.any():
            return torque
    return backend.observe().health.torque
