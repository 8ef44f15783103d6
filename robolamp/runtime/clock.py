"""The computer's clock, to schedule ticks on."""

from __future__ import annotations

import time

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


def _sleep_until(deadline: float) -> None:
    left = deadline - time.monotonic()
    if left > _SPIN:
        time.sleep(left - _SPIN)
    while time.monotonic() < deadline:
        pass
