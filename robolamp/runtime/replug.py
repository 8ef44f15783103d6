"""A port that was unplugged: waiting for it to come back."""

from __future__ import annotations

from collections.abc import Callable

from robolamp.runtime.stop import StopRequest
from robolamp.signals import Clock

REPLUG_TIME = 10.0
"""How long a port that was unplugged has to come back [s]."""

AGAIN_TIME = 60.0
"""How long servos may fall silent again and again before the lamp is back where it was [s]: a plug that is loose."""

_LOOK = 0.1  # s: between two attempts to go on


def came_back(attempt: Callable[[], bool], clock: Clock, stop: StopRequest) -> bool:
    """Wait up to `REPLUG_TIME` for a port, and return whether it came back before that and before a stop was asked for.

    Args:
        attempt: Tries to open it and to go on; returns whether that could be done.
        clock: The lamp's.
        stop: Watched for requests to stop.
    """
    end = clock.now() + REPLUG_TIME
    while not attempt():
        if clock.now() > end or stop.requests:
            return False
        clock.sleep_until(clock.now() + _LOOK)
    return True
