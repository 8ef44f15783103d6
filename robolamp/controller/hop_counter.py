"""The hop counter: contact of the foot, how long it lasts or is gone, and the hops, over many lanes or one.

A hop is a flight and the landing after it. What is shorter than lamp.toml's `foot.flight_time` is no flight: the foot
rebounds after a landing, and a lamp that crouches unloads it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.lamp import Lamp
from robolamp.odometer import Odometer


def shortest_flight(flight_time: float, period: float) -> float:
    """Return from which sum of whole periods on a time without contact is a flight [s].

    Sampled, a time T spans from T - period to T + period: what lasts `flight_time` or longer is always a flight where
    that is a whole number of periods; what is shorter by a period or more, never.

    Args:
        flight_time: Shortest flight [s].
        period: Time between samples [s]; a quarter of it forgives what sums of it lack by rounding.
    """
    return flight_time - period / 4


@dataclass(frozen=True)
class SignalLimits:
    """What the derived signals need to know of the lamp.

    Attributes:
        period: Control period [s].
        contact_on: Foot force above which the foot is on the ground [N].
        contact_off: Foot force below which it no longer is [N].
        flight_time: Shortest time without contact that is a flight [s].
        odometer: Measures hops; None: the lamp has none.
    """

    period: float
    contact_on: float
    contact_off: float
    flight_time: float
    odometer: Odometer | None = None

    @classmethod
    def of(cls, lamp: Lamp, period: float) -> SignalLimits:
        """Return those of a lamp.

        Args:
            lamp: The lamp.
            period: Control period [s].
        """
        return cls(period, lamp.contact_on, lamp.contact_off, lamp.flight_time, lamp.odometer)


class HopCounter:
    """Counts hops, lane by lane. A flight counts at the first contact after it; the first contact of all is the start.

    Args:
        lanes: Number of lanes.
        limits: Thresholds and period.

    Attributes:
        contact: Whether the foot is on the ground, shape (lanes,).
        air_time: Time since contact was lost, 0 on the ground, shape (lanes,) [s].
        ground_time: Time since contact was made, 0 in the air, shape (lanes,) [s].
        hops: Hops so far, shape (lanes,).
    """

    def __init__(self, lanes: int, limits: SignalLimits) -> None:
        self._limits = limits
        self._least = shortest_flight(limits.flight_time, limits.period)
        self._begun = False
        self.contact = np.ones(lanes, bool)
        self.air_time = np.zeros(lanes)
        self.ground_time = np.zeros(lanes)
        self.hops = np.zeros(lanes)

    def update(self, force: NDArray[np.float64], elapsed: int = 1) -> None:
        """Take one reading.

        Args:
            force: Foot force, shape (lanes,) [N].
            elapsed: Control periods since the last reading; more than 1 where some were missed.
        """
        before = self.contact
        self.contact = force > np.where(before, self._limits.contact_off, self._limits.contact_on)
        if self._begun:
            passed = self._limits.period * elapsed
            landed = self.contact & ~before
            self.hops = self.hops + (landed & (self.air_time >= self._least))
            same = self.contact == before
            self.air_time = np.where(self.contact, 0.0, np.where(same, self.air_time + passed, passed))
            self.ground_time = np.where(self.contact, np.where(same, self.ground_time + passed, passed), 0.0)
        self._begun = True
