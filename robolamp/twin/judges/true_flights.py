"""What an emulated lamp truly flew in a run, from its truth log: flights, and which of them are hops as judged.

The foot sensor counts flights; whether they cleared the floor and landed flat, only the truth tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robolamp.controller.hop_counter import shortest_flight
from robolamp.lamp import Lamp
from robolamp.log.reader import Run, Truth
from robolamp.twin.judges.lamp_judge import HOP_CLEARANCE, HOP_LANDING_TILT


@dataclass(frozen=True)
class Flight:
    """A time off the floor as long as a flight.

    Attributes:
        off: When the foot left the floor [s], on the run's clock, to half the time between the truth's samples.
        on: When it came back [s].
        clearance: Largest height of the foot's lowest point [m].
        tilt: Of the foot at the landing [rad].
        way: Path length of the base centre along x [m].
    """

    off: float
    on: float
    clearance: float
    tilt: float
    way: float

    @property
    def hop(self) -> bool:
        """Whether it cleared the floor and landed flat enough for a hop."""
        return self.clearance >= HOP_CLEARANCE and self.tilt <= HOP_LANDING_TILT


@dataclass(frozen=True)
class Flown:
    """What a lamp flew.

    Attributes:
        flights: Every flight from the start of phase "run" to the last tick, in order of time.
        travel: Path length of the base centre along x in that time [m].
    """

    flights: tuple[Flight, ...]
    travel: float

    @property
    def hops(self) -> int:
        """How many hops it flew."""
        return sum(flight.hop for flight in self.flights)

    @property
    def flight_share(self) -> float:
        """Part of the travel spent in hops; NaN below 1 cm of travel."""
        return sum(flight.way for flight in self.flights if flight.hop) / self.travel if self.travel >= 0.01 else np.nan


def flown(run: Run, truth: Truth, lamp: Lamp) -> Flown:
    """Return what an emulated lamp truly flew.

    Args:
        run: The log of the run.
        truth: What truly happened in it.
        lamp: Tells from which time on a flight is one.
    """
    time = run.at(truth.log_time)
    driven = np.flatnonzero(run.phase == "run")
    begin = run.scheduled[driven[0] if driven.size else 0]
    keep = (time >= begin) & (time <= run.write_done[-1])
    time, x, clearance, tilt = (a[keep] for a in (time, truth.base_x, truth.clearance, np.abs(truth.pitch)))
    if time.size < 2:
        return Flown((), 0.0)
    period = float(np.median(np.diff(time)))
    moments = time - period / 2  # a sample's force is the largest since the one before
    path = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(x)))))
    carried = np.flatnonzero(truth.force[keep] > 0.0)
    found = []
    for last, landing in pairwise(carried.tolist()):
        off, on = float(moments[last]), float(moments[landing])
        if landing - last > 1 and on - off >= shortest_flight(lamp.flight_time, period):
            way = float(np.interp(on, time, path) - np.interp(off, time, path))
            highest = float(clearance[last + 1 : landing].max())
            found.append(Flight(off, on, highest, float(tilt[landing]), way))
    return Flown(tuple(found), float(path[-1]))
