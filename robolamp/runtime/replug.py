"""A port that was unplugged: waiting for it to come back."""

from __future__ import annotations

from collections.abc import Callable

from robolamp.runtime.stop import StopRequest
from robolamp.signals import Clock

REPLUG_TIME = 10.0
"""How long a port that was unplugged has to come back [s]."""

_LOOK = 0.1  # s: between two attempts to open it


def came_back(reconnect: Callable[[], bool], clock: Clock, stop: StopRequest) -> bool:
    """Wait up to `REPLUG_TIME` for a port, and return whether it came back before that and before a stop was asked for.

    Args:
        reconnect: Tries to open it; returns whether it is there.
        clock: The lamp's.
        stop: Watched for requests to stop.
    """
    end = clock.now() + REPLUG_TIME
    while not reconnect():
        if clock.now() > end or stop.requests:
            return False
        clock.sleep_until(clock.now() + _LOOK)
    return True
