"""The computer's clock, to schedule ticks on, and how long it stood still because the computer slept."""

from __future__ import annotations

import time
from typing import Protocol, runtime_checkable

from robolamp.signals import Clock

SLEEP = 0.2
"""Sleep of the computer that is one [s]: as much silence as the servos' Bus Watchdogs allow."""

# A clock that goes on while the computer sleeps, which time.monotonic() does not: on Linux, and on macOS.
_AWAKE_OR_NOT = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC_RAW", time.CLOCK_MONOTONIC))
_LOOKS = 3

_SPIN = 0.0002  # s: the kernel wakes a sleeper 0.05 to 0.1 ms late; the rest is waited out


class MonotonicClock:
    """The time since the computer started; not disturbed when the wall clock is set."""

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def sleep_until(self, time: float) -> None:
        """Return at that time, to about 0.01 ms, or at once where it has passed.

        Args:
            time: On this clock [s].
        """
        _sleep_until(time)

    def slept(self) -> float:
        """Return for how long the computer has slept since it started [s]."""
        # Whatever comes between the two clocks makes it less, never more: the largest of a few is the truth.
        return max(time.clock_gettime(_AWAKE_OR_NOT) - time.monotonic() for _ in range(_LOOKS))


@runtime_checkable
class SleepingClock(Protocol):
    """A clock of something that may sleep."""

    def slept(self) -> float:
        """Return for how long it has slept so far [s]."""
        ...


class Sleep:
    """Notices that a computer slept: its clock stood still, while the lamp's servos went on.

    Args:
        clock: Of the computer; one that does not tell of sleep never sleeps, as virtual time.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock if isinstance(clock, SleepingClock) else None
        self._before = self._clock.slept() if self._clock else 0.0

    def reason(self) -> str:
        """Return that the computer slept and for how long since this was made; empty: it did not."""
        slept = self._clock.slept() - self._before if self._clock else 0.0
        return f"the computer slept for {slept:.{0 if slept >= 10.0 else 1}f} s" if slept > SLEEP else ""


def _sleep_until(deadline: float) -> None:
    left = deadline - time.monotonic()
    if left > _SPIN:
        time.sleep(left - _SPIN)
    while time.monotonic() < deadline:
        pass
