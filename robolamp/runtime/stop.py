"""Requests to stop a run: Ctrl-C, SIGTERM and SIGHUP counted, not raised, so that the lamp is landed first."""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What asks for a stop."""


class StopRequest:
    """Counts requests to stop; as a context manager it takes over the process's stop signals (main thread only).

    Attributes:
        asked: Called whenever the requests are counted; True is a first request, never a second. None: nobody is.
    """

    def __init__(self) -> None:
        self.asked: Callable[[], bool] | None = None
        self._requests = 0
        self._before: dict[signal.Signals, Any] = {}

    @property
    def requests(self) -> int:
        """How many have come. The first lands the lamp, the second turns its torque off at once."""
        if not self._requests and self.asked and self.asked():
            self._requests = 1
        return self._requests

    def request(self) -> None:
        """Ask for a stop, as a signal does."""
        self._requests += 1

    def __enter__(self) -> StopRequest:
        self._before = {number: signal.signal(number, self._signalled) for number in SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def _signalled(self, number: int, frame: FrameType | None) -> None:
        self._requests += 1
