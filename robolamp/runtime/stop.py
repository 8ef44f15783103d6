"""Requests to stop a run: Ctrl-C, SIGTERM and SIGHUP counted, not raised, so that the lamp is landed first."""

from __future__ import annotations

import signal
from types import FrameType, TracebackType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What asks for a stop."""


class StopRequest:
    """Counts requests to stop; as a context manager it takes over the process's stop signals (main thread only).

    Attributes:
        requests: How many have come. The first lands the lamp, the second turns its torque off at once.
    """

    def __init__(self) -> None:
        self.requests = 0
        self._before: dict[signal.Signals, Any] = {}

    def request(self) -> None:
        """Ask for a stop, as a signal does."""
        self.requests += 1

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
        self.requests += 1
