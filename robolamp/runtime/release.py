"""The end of a run: is every servo's torque off?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.runtime.softly import LOOKS
from robolamp.signals import LampBackend

RELEASE_TIME = 2.0
"""How long servos that do not confirm that their torque is off are told again at the end [s]."""

_AGAIN = 0.1  # s: between two tellings


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
