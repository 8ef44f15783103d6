"""Hops counted against hops flown: what the lamp counted as a hop, and whether it flew."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robolamp.controller.hop_counter import shortest_flight
from robolamp.lamp import Lamp
from robolamp.log.reader import Run, Truth
from robolamp.twin.judges.lamp_judge import HOP_CLEARANCE, HOP_LANDING_TILT
from robolamp.twin.judges.true_flights import flown


@dataclass(frozen=True)
class HopCount:
    """How many of the hops that a lamp counted flew.

    Attributes:
        counted: How many it counted by its foot sensor.
        air: How long each was off the floor by that sensor, to a control period [s]; NaN where it was not read.
        seen: Whether its foot left the ground at all by that sensor; else the log does not say what was counted.
        least: Shortest time off the floor that is a flight [s].
        flown: How many flew in truth; None: nobody knows.
        clear: How high the foot's lowest point came in each flight, by the truth [m].
    """

    counted: int
    air: tuple[float, ...]
    seen: bool
    least: float
    flown: int | None
    clear: tuple[float, ...] = ()

    @property
    def short(self) -> int:
        """How many were too short for a hop that flies, by the sensor."""
        return sum(time < self.least for time in self.air)

    @property
    def text(self) -> str:
        """Return what is wrong with the count, in words; empty if nothing is known to be wrong."""
        if not self.seen:
            return ""
        hops = f"{self.counted} hop was" if self.counted == 1 else f"{self.counted} hops were"
        if self.flown is not None:
            return f"{hops} counted, {self.flown} flew" if self.flown != self.counted else ""
        if not self.short:
            return ""
        return f"{hops} counted, {self.short} of them too short to have flown"

    @property
    def evidence(self) -> str:
        """Return the numbers that show it."""
        return "; ".join(self._evidence())

    def _evidence(self) -> Iterator[str]:
        if self.flown is not None:
            highest = ", ".join(f"{height * 1e3:.1f}" for height in self.clear) or "none"
            yield (
                f"by the truth a hop clears {HOP_CLEARANCE * 1e3:g} mm and lands within "
                f"{math.degrees(HOP_LANDING_TILT):g} degrees of flat; in its flights the foot came up by {highest} mm"
            )
        times = ", ".join(f"{time * 1e3:.0f}" for time in self.air if math.isfinite(time))
        if times:
            yield f"by the foot sensor it was in the air for {times} ms; a flight lasts 120 to 150, a rebound 44 to 56"


def count_hops(run: Run, truth: Truth | None, lamp: Lamp) -> HopCount:
    """Return how many of the hops that a lamp counted flew.

    Args:
        run: The lamp's log.
        truth: What it truly did; None: nobody knows.
        lamp: Tells from which time on a flight is one.
    """
    air = []
    for row in (np.flatnonzero(np.diff(run.hops) > 0) + 1).tolist():
        stood = np.flatnonzero(run.contact[:row])
        # The first tick without contact counts from 0, and the one with contact again is a hop's: as the lamp does it.
        left = int(stood[-1]) + 1 if stood.size else row
        known = np.isfinite(run.foot_force[left : row + 1]).all()
        air.append(float(run.scheduled[row] - run.scheduled[left]) if known else math.nan)
    least = shortest_flight(lamp.flight_time, run.control_period)
    seen = not run.contact.all()
    if truth is None:
        return HopCount(int(run.hops[-1]), tuple(air), seen, least, None)
    truly = flown(run, truth, lamp)
    clear = tuple(flight.clearance for flight in truly.flights)
    return HopCount(int(run.hops[-1]), tuple(air), seen, least, truly.hops, clear)
