"""Hops counted against hops flown: what the lamp counted as a hop, and whether it flew."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robolamp.compare.pauses import origin
from robolamp.log.reader import Run, Truth
from robolamp.twin.judge import HOP_CLEARANCE, HOP_LANDING_TILT

FLOWN = 0.08
"""Shortest time off the floor of a hop that flies [s]: those of the shipped hops last 120 to 150 ms, rebounds after a
tilted landing 44 to 56 ms, and crouching unloads the foot for 44 ms (measured on the emulator)."""


@dataclass(frozen=True)
class HopCount:
    """What became of the hops that a lamp counted.

    Attributes:
        counted: How many it counted by its foot sensor.
        air: How long each was off the floor by that sensor, to a control period [s]; NaN where it was not read.
        seen: Whether its foot left the ground at all by that sensor; else the log does not say what was counted.
        flown: How many flew in truth; None: nobody knows.
        clear: How high the foot's lowest point came each time that it left the floor, by the truth [m].
    """

    counted: int
    air: tuple[float, ...]
    seen: bool
    flown: int | None
    clear: tuple[float, ...] = ()

    @property
    def short(self) -> int:
        """How many were too short for a hop that flies, by the sensor."""
        return sum(time < FLOWN for time in self.air)

    @property
    def text(self) -> str:
        """Return what is wrong with the count, in words; empty where nothing is known to be."""
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
        """Return the numbers it is seen in."""
        return "; ".join(self._evidence())

    def _evidence(self) -> Iterator[str]:
        if self.flown is not None:
            highest = ", ".join(f"{height * 1e3:.1f}" for height in self.clear) or "none"
            yield (
                f"by the truth a hop clears {HOP_CLEARANCE * 1e3:g} mm and lands within "
                f"{math.degrees(HOP_LANDING_TILT):g} degrees of flat; the foot came up by {highest} mm"
            )
        times = ", ".join(f"{time * 1e3:.0f}" for time in self.air if math.isfinite(time))
        if times:
            yield f"by the foot sensor it was in the air for {times} ms; a flight lasts 120 to 150, a rebound 44 to 56"


def count_hops(run: Run, truth: Truth | None) -> HopCount:
    """Return what became of the hops that a lamp counted.

    Args:
        run: The lamp's log.
        truth: What it truly did; None: nobody knows.
    """
    air = []
    for row in (np.flatnonzero(np.diff(run.hops) > 0) + 1).tolist():
        stood = np.flatnonzero(run.contact[:row])
        # The first tick without contact counts from 0, and the one with contact again is a hop's: as the lamp does it.
        left = int(stood[-1]) + 1 if stood.size else row
        known = np.isfinite(run.foot_force[left : row + 1]).all()
        air.append(float(run.scheduled[row] - run.scheduled[left]) if known else math.nan)
    flown, clear = (None, ()) if truth is None else _flown(run, truth)
    return HopCount(int(run.hops[-1]), tuple(air), not run.contact.all(), flown, clear)


def _flown(run: Run, truth: Truth) -> tuple[int, tuple[float, ...]]:
    """Return how many hops flew since the controller's first tick, and how high the foot came each time [m]."""
    at = run.at(truth.log_time)
    during = (at >= origin(run)) & (at <= run.write_done[-1])
    time, clearance, pitch = at[during], truth.clearance[during], truth.pitch[during]
    aloft = np.concatenate([[False], truth.force[during] <= 0.0, [False]])
    flown, clear = 0, []
    for off, on in np.flatnonzero(np.diff(aloft.astype(np.int8))).reshape(-1, 2).tolist():
        if on == time.size:
            continue  # it has not landed
        height = float(clearance[off:on].max())
        clear.append(height)
        long = time[on] - time[off] >= FLOWN
        flown += bool(long and height >= HOP_CLEARANCE and abs(pitch[on]) <= HOP_LANDING_TILT)
    return flown, tuple(height for height in clear if height >= HOP_CLEARANCE / 4)
