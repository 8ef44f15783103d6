"""For tests in real time: how late is a bare sleeper beside them, and what comes true in its own time."""

from __future__ import annotations

import contextlib
import functools
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import pytest

from robolamp.lateness import Lateness

T = TypeVar("T")

NAP = 0.002  # s
ATTEMPTS = 20


class NotReached(AssertionError):
    """An attempt did not come as far as what it tests, for want of time: it says nothing."""


class Sleeper:
    """A thread that does nothing but sleep: what it is late by, this computer is."""

    def __init__(self) -> None:
        self.late = Lateness()
        self._awake = threading.Event()
        self._thread = threading.Thread(target=self._sleep, name="sleeper")

    def __enter__(self) -> Sleeper:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._awake.set()
        self._thread.join()

    def lost(self, began: float) -> float:
        """How much of the time since then it was late for [s]."""
        time.sleep(2 * NAP)  # what it is late by now is noted when it wakes
        return self.late.total(began, time.monotonic())

    def _sleep(self) -> None:
        while not self._awake.is_set():
            due = time.monotonic() + NAP
            time.sleep(NAP)
            self.late.note(due, time.monotonic())


def waited(pid: int) -> float:
    """How long a process was ready to run and had no processor [s], all its threads together; 0 where nobody says."""
    found = 0
    for stat in Path("/proc").glob(f"{pid}/task/*/schedstat"):
        with contextlib.suppress(OSError):  # a thread that ended meanwhile
            found += int(stat.read_text().split()[1])  # proc(5): ns on the run queue
    return found * 1e-9


def undisturbed(attempt: Callable[[], T], patience: float) -> T:
    """Return what an attempt returns; one that fails is repeated if a bare sleeper beside it was late, and only then.

    One that raises `NotReached` is repeated whether or not it was.

    Args:
        attempt: Something in real time.
        patience: Lateness that it bears [s].
    """
    with Sleeper() as sleeper:
        for left in reversed(range(ATTEMPTS)):
            began = time.monotonic()
            try:
                return attempt()
            except (Exception, pytest.fail.Exception) as error:
                time.sleep(2 * NAP)
                late = sleeper.late.worst(began, time.monotonic()) > patience
                if not left or not (late or isinstance(error, NotReached)):
                    raise
    raise AssertionError("not reached")


def bears(patience: float) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a test in real time: `undisturbed`."""

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def repeated(**fixtures: object) -> None:
            undisturbed(lambda: test(**fixtures), patience)

        return repeated

    return decorate


def eventually(true: Callable[[], bool], within: float = 60.0) -> bool:
    """Whether something comes true; the machine may be busy."""
    deadline = time.monotonic() + within
    while not true():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True
