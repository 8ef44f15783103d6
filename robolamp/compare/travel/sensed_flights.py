"""Hops by the foot sensor: take-off, landing, flight time, and how far two sides differ in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from robolamp.compare.replays.trajectory import Side
from robolamp.controller.hop_counter import shortest_flight
from robolamp.lamp import Lamp

Array = NDArray[np.float64]

MATCH = 0.15
"""Flights whose middles are further apart than this are not the same hop [s]."""
UNSEEN = 0.06
"""Longest time without a reading of the foot in a flight [s]: half of the shortest that hop makes, three ticks."""
GRAVITY = 9.81
"""[m/s^2]."""


@dataclass(frozen=True)
class Flight:
    """A time off the floor.

    Attributes:
        off: When contact was lost [s], between two readings where the force crosses the threshold.
        on: When it came back [s].
    """

    off: float
    on: float

    @property
    def time(self) -> float:
        """How long it was [s]."""
        return self.on - self.off

    @property
    def apex(self) -> float:
        """Rise of the centre of mass that a flight of this length implies, g t^2 / 8 [m]: leaving and landing alike."""
        return GRAVITY * self.time**2 / 8


@dataclass(frozen=True)
class Hop:
    """One hop of the two sides.

    Attributes:
        lamp: The lamp's flight; None: only the reference hopped.
        twin: The reference's flight; None: only the lamp hopped.
    """

    lamp: Flight | None
    twin: Flight | None

    @property
    def off_late(self) -> float:
        """How much later the lamp takes off [s]; NaN where one of them does not."""
        return self.lamp.off - self.twin.off if self.lamp and self.twin else math.nan

    @property
    def on_late(self) -> float:
        """How much later the lamp lands [s]; NaN where one of them does not."""
        return self.lamp.on - self.twin.on if self.lamp and self.twin else math.nan


def flights(side: Side, lamp: Lamp) -> list[Flight]:
    """Return the flights of one side, from the start of the run on: those that the terminal `hops` counts.

    Contact has the hysteresis of lamp.toml; the moment is read from the line between the two readings around it. How
    long a flight must be counts in whole ticks, as on the lamp, not in those moments.

    Args:
        side: Whose.
        lamp: Gives the thresholds and the shortest flight.
    """
    known = np.isfinite(side.tick)
    time, force = side.tick[known], side.force[known]
    period = float(np.median(np.diff(time))) if time.size > 1 else math.nan
    found: list[Flight] = []
    contact, off, last = True, math.nan, 0
    for before, row in pairwise(np.flatnonzero(np.isfinite(force)).tolist()):
        threshold = lamp.contact_off if contact else lamp.contact_on
        if contact and force[row] <= threshold:
            contact, off, last = False, _crossing(time, force, (before, row), threshold), row - 1
        elif not contact and force[row] > threshold:
            contact, on = True, _crossing(time, force, (before, row), threshold)
            ticks = round((time[row - 1] - time[last]) / period)
            if ticks * period >= shortest_flight(lamp.flight_time, period) and off >= 0.0:
                found.append(Flight(off, on))
    return [flight for flight in found if _seen(flight, time[np.isfinite(force)])]


def _seen(flight: Flight, time: Array) -> bool:
    """Return whether the foot was read all through a flight: where it was not, it may have stood."""
    during = time[(time >= flight.off - UNSEEN) & (time <= flight.on + UNSEEN)]
    return bool((np.diff(during) <= UNSEEN).all())


def _crossing(time: Array, force: Array, rows: tuple[int, int], threshold: float) -> float:
    first, second = rows
    before, after = force[first], force[second]
    share = (threshold - before) / (after - before) if after != before else 1.0
    return float(time[first] + min(max(share, 0.0), 1.0) * (time[second] - time[first]))


def hops(lamp: list[Flight], twin: list[Flight]) -> list[Hop]:
    """Return the hops of both, in order of time: flights that overlap or nearly do are one hop.

    Args:
        lamp: The lamp's flights.
        twin: The reference's.
    """
    left = list(twin)
    found = []
    for flight in lamp:
        middle = (flight.off + flight.on) / 2
        near = min(left, key=lambda other: abs((other.off + other.on) / 2 - middle), default=None)
        if near is not None and abs((near.off + near.on) / 2 - middle) <= MATCH:
            left.remove(near)
            found.append(Hop(flight, near))
        else:
            found.append(Hop(flight, None))
    found += [Hop(None, flight) for flight in left]
    return sorted(found, key=lambda hop: hop.lamp.off if hop.lamp else hop.twin.off if hop.twin else 0.0)
