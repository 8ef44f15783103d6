"""Control periods: which ones a lamp can be driven at, and ticks that keep to one."""

from __future__ import annotations

from robolamp.dynamixel.wire import wire_time
from robolamp.errors import SafetyError
from robolamp.lamp import Lamp
from robolamp.signals import Clock

PERIOD = 0.02
"""Control period where the controller gives none [s]: 50 Hz."""

MAX_PERIOD = 0.1
"""Longest control period [s]: half the 0.2 s of silence after which the servos' Bus Watchdog stops them."""

WIRE_SHARE = 0.8
"""Largest share of the period that a tick's packets may take on the servo bus; the rest is for everything else."""


def check_period(period: float, lamp: Lamp) -> None:
    """Check that a lamp can be driven at a control period.

    Args:
        period: [s].
        lamp: Gives the number of servos and the baud rate.

    Raises:
        SafetyError: It cannot.
    """
    if period > MAX_PERIOD:
        raise SafetyError(
            f"control_period = {period:g} s is longer than {MAX_PERIOD:g} s: the servos' Bus Watchdog stops them after "
            f"{2 * MAX_PERIOD:g} s of silence"
        )
    wire = wire_time("tick", len(lamp.joints), lamp.bus_baud)
    if wire > WIRE_SHARE * period:
        raise SafetyError(
            f"a tick takes {wire * 1e3:.1f} ms on the servo bus at bus.baud = {lamp.bus_baud}, more than "
            f"{WIRE_SHARE:.0%} of control_period = {period:g} s; raise the baud rate (of the servos too) or the period",
            str(lamp.path),
        )


def least_period(lamp: Lamp) -> float:
    """Return the shortest control period that a lamp's bus has time for [s].

    Args:
        lamp: Gives the number of servos and the baud rate.
    """
    return wire_time("tick", len(lamp.joints), lamp.bus_baud) / WIRE_SHARE


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
