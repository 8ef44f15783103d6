"""Requests to stop a run: Ctrl-C, SIGTERM and their like counted, not raised, so that the lamp is landed first."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""What asks for a stop, whoever handled it before."""

_NAMES = "ABRT ALRM VTALRM PROF USR1 USR2 IO PWR STKFLT XCPU"
ENDING: tuple[int, ...] = (
    *(getattr(signal, f"SIG{name}") for name in _NAMES.split() if hasattr(signal, f"SIG{name}")),
    *(range(signal.SIGRTMIN, signal.SIGRTMAX + 1) if hasattr(signal, "SIGRTMIN") else ()),
)
"""What else would end the process where nobody handles it, and therefore asks for a stop there. (signal(7), "Standard
signals" and "Real-time signals". Left out are those of a program that broke, such as SIGSEGV, and those that Python
ignores, such as SIGPIPE.)"""


class StopRequest:
    """Counts requests to stop; as a context manager it takes over the process's stop signals (main thread only).

    Attributes:
        asked: Called whenever the requests are counted; True is a first request, never a second. None: nobody is.
    """

    def __init__(self) -> None:
        self.asked: Callable[[], bool] | None = None
        self._requests = 0
        self._interrupts = False
        self._before: dict[int, Any] = {}

    @property
    def requests(self) -> int:
        """How many have come. The first lands the lamp, the second turns its torque off at once."""
        if not self._requests and self.asked and self.asked():
            self._requests = 1
        return self._requests

    def request(self) -> None:
        """Ask for a stop, as a signal does."""
        self._requests += 1

    @contextlib.contextmanager
    def interrupting(self) -> Iterator[None]:
        """While a person is waited for and nothing moves: a request raises KeyboardInterrupt, there and at once."""
        self._interrupts = True
        try:
            if self._requests:
                raise KeyboardInterrupt
            yield
        finally:
            self._interrupts = False

    def __enter__(self) -> StopRequest:
        free = [number for number in ENDING if signal.getsignal(number) == signal.SIG_DFL]
        self._before = {number: signal.signal(number, self._signalled) for number in (*SIGNALS, *free)}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def _signalled(self, number: int, frame: FrameType | None) -> None:
        self._requests += 1
        if self._interrupts:
            raise KeyboardInterrupt
