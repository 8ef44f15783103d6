"""A recording as a gesture: few key frames instead of many samples, and how far they are from it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robolamp.ease import EASES, MINIMUM_JERK
from robolamp.errors import SafetyError
from robolamp.lamp import Lamp
from robolamp.pose.gesture import Frame, Gesture

Array = NDArray[np.float64]

STILL = 0.03
"""A hand that holds a joint moves it by less than this [rad]: chosen, twice what a servo's play and a pulse do."""

APPROACH = 1.2
"""Time to the first pose of a recording, a radian that it is from the neutral one [s/rad]: at most 1.6 rad/s."""

_SHORTEST = 0.5  # of that approach [s]
_DIGITS = 3  # of what a gesture file says of angles [rad] and times [s]
_STEP = 0.04  # between two places where a key frame may be [s]: a hand does nothing in less
_WAY = 3.0  # longest time between two key frames [s]


@dataclass(frozen=True)
class Simplified:
    """A gesture made of a recording.

    Attributes:
        gesture: The gesture.
        worst: The furthest that a joint of it is from the recording [rad].
        mean: Mean absolute distance [rad].
        length: Of the recording without its still ends [s].
    """

    gesture: Gesture
    worst: float
    mean: float
    length: float


def simplify(name: str, time: Array, angle: Array, lamp: Lamp, tolerance: float, most: int) -> Simplified:
    """Return a gesture of few key frames that does what was recorded.

    Each way between two frames has the ease that fits it best. Of all choices of frames it is one of the fewest with
    no joint further from the recording than the tolerance, and of those the nearest to it (dynamic programming). Where
    the most frames are too few for that, it is the nearest with so many.

    Args:
        name: The gesture's.
        time: When it was measured, rising, shape (k,) [s].
        angle: Joint angles, shape (k, n) [rad]; rows with a gap (NaN) are left out.
        lamp: The lamp; what is outside its limits is brought to them.
        tolerance: How far a joint may be off [rad].
        most: Most frames.

    Raises:
        SafetyError: Nothing moved.
    """
    there = np.isfinite(angle).all(axis=1)
    time, angle = time[there], angle[there]
    unit = 10.0**_DIGITS
    lower, upper = np.ceil(lamp.lower * unit) / unit, np.floor(lamp.upper * unit) / unit
    angle = np.clip(angle, lower, upper)
    if len(time) < 2 or not (np.ptp(angle, axis=0) > STILL).any():
        raise SafetyError("no joint was moved; nothing is recorded", name)
    begin = int(np.argmax((np.abs(angle - angle[0]) > STILL).any(axis=1)))
    end = len(time) - int(np.argmax((np.abs(angle[::-1] - angle[-1]) > STILL).any(axis=1)))
    kept = slice(max(begin - 1, 0), min(end + 1, len(time)))
    time, angle = time[kept] - time[kept][0], angle[kept]
    ways = _ways(time, angle)
    keys = _fewest(ways, len(time), tolerance, most)
    lead = max(_SHORTEST, APPROACH * float(np.abs(angle[0]).max()))
    frames = [Frame(round(lead, _DIGITS), angle[0].round(_DIGITS), MINIMUM_JERK)]
    for one, other in itertools.pairwise(keys):
        at = round(lead + float(time[other]), _DIGITS)
        frames.append(Frame(at, angle[other].round(_DIGITS), ways[one][other].ease))
    gesture = Gesture(name, lamp.names, tuple(frames))
    motion = gesture.motion()
    off = np.abs(np.array([motion(lead + at) for at in time.tolist()]) - angle)
    return Simplified(gesture, float(off.max()), float(off.mean()), float(time[-1]))


class _Way(NamedTuple):
    """From one key frame to another: the worst error of the ease that fits best [rad], and that ease."""

    error: float
    ease: str


_Ways = dict[int, dict[int, _Way]]
"""By sample from which and sample to which."""


def _ways(time: Array, angle: Array) -> _Ways:
    stride = max(1, round(_STEP / float(np.median(np.diff(time)))))
    places = [*range(0, len(time) - 1, stride), len(time) - 1]
    ways: _Ways = {place: {} for place in places}
    for number, one in enumerate(places):
        for other in places[number + 1 :]:
            if ways[one] and time[other] - time[one] > _WAY:
                break
            share = (time[one : other + 1] - time[one]) / (time[other] - time[one])
            off, way = angle[one : other + 1] - angle[one], angle[other] - angle[one]
            ways[one][other] = min(
                _Way(float(np.abs(off - ease.curve(share)[:, None] * way).max()), name) for name, ease in EASES.items()
            )
    return ways


def _fewest(ways: _Ways, samples: int, tolerance: float, most: int) -> list[int]:
    """Return the samples that become key frames, the first and the last among them."""
    last = samples - 1
    nearest: list[dict[int, tuple[float, int]]] = [{0: (0.0, 0)}]  # by frames: the error up to a sample, and from where
    while last not in nearest[-1] or (nearest[-1][last][0] > tolerance and len(nearest) < most):
        found: dict[int, tuple[float, int]] = {}
        for one, (error, _) in nearest[-1].items():
            for other, way in ways[one].items():
                whole = max(error, way.error)
                if other not in found or whole < found[other][0]:
                    found[other] = (whole, one)
        nearest.append(found)
    keys = [last]
    for step in reversed(nearest[1:]):
        keys.append(step[keys[-1]][1])
    return keys[::-1]
