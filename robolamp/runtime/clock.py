"""Time in a run: the computer's clock, whether the computer slept, control periods, and ticks that keep to one."""

from __future__ import annotations

import time
from typing import Protocol, runtime_checkable

from robolamp.errors import SafetyError
from robolamp.lamp import Lamp
from robolamp.signals import Clock

PERIOD = 0.02
"""Control period where the controller gives none [s]: 50 Hz."""

MAX_PERIOD = 0.1
"""Longest control period [s]: half the 0.2 s of silence after which the servos' Bus Watchdog stops them."""

WIRE_SHARE = 0.8
"""Largest share of the period that a tick's packets may take on the servo bus; the rest is for everything else."""

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


def check_period(period: float, lamp: Lamp, wire: float) -> None:
    """Check that a lamp can be driven at a control period.

    Args:
        period: [s].
        lamp: Its description.
        wire: How long a tick's packets are on the servo bus [s].

    Raises:
        SafetyError: It cannot.
    """
    if period > MAX_PERIOD:
        raise SafetyError(
            f"control_period = {period:g} s is longer than {MAX_PERIOD:g} s: the servos' Bus Watchdog stops them after "
            f"{2 * MAX_PERIOD:g} s of silence"
        )
    if wire > WIRE_SHARE * period:
        raise SafetyError(
            f"a tick takes {wire * 1e3:.1f} ms on the servo bus at bus.baud = {lamp.bus_baud}, more than "
            f"{WIRE_SHARE:.0%} of control_period = {period:g} s; raise the baud rate (of the servos too) or the period",
            str(lamp.path),
        )


def least_period(wire: float) -> float:
    """Return the shortest control period that a bus has time for [s].

    Args:
        wire: How long a tick's packets are on it [s].
    """
    return wire / WIRE_SHARE


class Schedule:
    """Ticks at absolute times, so that lateness does not add up; those that are past already are skipped.

    Args:
        clock: What they are timed by.
        period: From one to the next [s].
    """

    def __init__(self, clock: Clock, period: float) -> None:
        self._clock, self._period = clock, period
        self._origin = 0.0
        self._slot = 0

    @property
    def due(self) -> float:
        """When the next tick is due [s]."""
        return self._origin + self._slot * self._period

    def begin(self) -> None:
        """Let the first tick be now."""
        self._origin, self._slot = self._clock.now(), 0

    def wait(self) -> tuple[float, float, int]:
        """Wait for the next tick.

        Returns:
            When it was due and when it began [s], and how many before it were skipped.
        """
        due = self.due
        self._clock.sleep_until(due)
        began = self._clock.now()
        missed = int((began - due) / self._period)
        self._slot += missed + 1
        return due + missed * self._period, began, missed
