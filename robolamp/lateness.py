"""When a process served later than it should have: the host was busy with others, or stood still."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

LEAST = 0.005
"""Lateness that is noted [s]. Chosen: a machine with nothing else to do stays below 1 ms, and the least patience that a
lamp's answers are waited for with is more than twice as long where the lamp is emulated."""

_MOST = 2000  # spans that are kept, the newest: more than 10 s of being late at every tick of 50 Hz


class Lateness:
    """Spans of time in which something was due and not done, on `time.monotonic()`, which all processes share.

    Args:
        spans: When it was due, and when it was done [s], in the order of `due`.
    """

    def __init__(self, spans: Iterable[tuple[float, float]] = ()) -> None:
        self._spans: deque[tuple[float, float]] = deque(spans, _MOST)

    @property
    def spans(self) -> list[tuple[float, float]]:
        """When each was due, and when it was done [s]."""
        return list(self._spans)

    def note(self, due: float, done: float) -> None:
        """Take note of something that was done late; a bit of lateness is none.

        Args:
            due: When it should have been done [s].
            done: When it was done [s].
        """
        if done - due >= LEAST:
            self._spans.append((due, done))

    def worst(self, begin: float, end: float) -> float:
        """Return the longest lateness that reaches into a time [s]; 0 where there was none."""
        return max((done - due for due, done in self._spans if done > begin and due < end), default=0.0)

    def total(self, begin: float, end: float) -> float:
        """Return for how much of a time something was due and not done [s]."""
        passed, covered = begin, 0.0
        for due, done in sorted(self._spans):
            covered += max(0.0, min(done, end) - max(due, passed))
            passed = max(passed, min(done, end))
        return covered
