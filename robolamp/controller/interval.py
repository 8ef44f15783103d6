"""Intervals: which values a subexpression can take, in exactly the arithmetic of the interpreters.

Rounding to nearest never turns two numbers around, so the ends of a sum, difference, product or quotient, computed in
doubles, hold every value that the interpreters can come to. No margin is needed and none is given.
"""

from __future__ import annotations

import math
import sys

Interval = tuple[float, float, bool]
"""Smallest value, largest value (both may be infinite; zeros of either sign are one), and whether it may be NaN."""

_LARGEST, _SMALLEST = sys.float_info.max, math.ulp(0.0)
_INFINITE = math.inf
EVERYTHING: Interval = (-_INFINITE, _INFINITE, True)
FINITE: Interval = (-_LARGEST, _LARGEST, False)
"""What a terminal can be of which nothing more is known."""

NOT_NEGATIVE: Interval = (0.0, _LARGEST, False)
_SWITCH: Interval = (0.0, 1.0, False)
RANGES: dict[str, Interval] = {
    "t": NOT_NEGATIVE,
    "contact": _SWITCH,
    "air_time": NOT_NEGATIVE,
    "ground_time": NOT_NEGATIVE,
    "hops": NOT_NEGATIVE,
    "goal_dist": (_SMALLEST, _LARGEST, False),
    "goal_time": NOT_NEGATIVE,
    "goal_met": _SWITCH,
}
"""Terminals that are bounded by what they mean (`robolamp.controller.terminals`)."""
WHOLE = frozenset({"contact", "hops", "goal_met"})
"""Terminals that are whole numbers."""


def add(a: Interval, b: Interval) -> Interval:
    """Return what a + b can be."""
    low, high = a[0] + b[0], a[1] + b[1]
    if low > -_INFINITE and high < _INFINITE:
        return low, high, a[2] or b[2]
    opposed = (a[1] == _INFINITE and b[0] == -_INFINITE) or (a[0] == -_INFINITE and b[1] == _INFINITE)
    # An end that is NaN itself (infinity less infinity) tells nothing.
    low, high = -_INFINITE if math.isnan(low) else low, _INFINITE if math.isnan(high) else high
    return low, high, a[2] or b[2] or opposed


def subtract(a: Interval, b: Interval) -> Interval:
    """Return what a - b can be."""
    return add(a, (-b[1], -b[0], b[2]))


def multiply(a: Interval, b: Interval) -> Interval:
    """Return what a * b can be."""
    ends = (a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])
    nan = a[2] or b[2]
    if not _unbounded(a) and not _unbounded(b):
        return min(ends), max(ends), nan
    known = [0.0 if math.isnan(end) else end for end in ends]  # infinity times 0: NaN, but 0 right beside it
    opposed = (_unbounded(a) and b[0] <= 0.0 <= b[1]) or (_unbounded(b) and a[0] <= 0.0 <= a[1])
    return min(known), max(known), nan or opposed


def divide(a: Interval, b: Interval) -> Interval:
    """Return what protected division a % b can be: 1 where b is 0."""
    if b == (0.0, 0.0, False):
        return 1.0, 1.0, False
    values = [1.0] if b[0] <= 0.0 <= b[1] else []
    if b[0] < 0.0:
        end = min(b[1], -_SMALLEST)
        values += [a[0] / b[0], a[0] / end, a[1] / b[0], a[1] / end]
    if b[1] > 0.0:
        end = max(b[0], _SMALLEST)
        values += [a[0] / b[1], a[0] / end, a[1] / b[1], a[1] / end]
    nan = a[2] or b[2] or (_unbounded(a) and _unbounded(b))
    known = [value for value in values if not math.isnan(value)]
    return (min(known), max(known), nan) if known else EVERYTHING


def union(a: Interval, b: Interval) -> Interval:
    """Return what either can be."""
    return min(a[0], b[0]), max(a[1], b[1]), a[2] or b[2]


def both(a: Interval, b: Interval) -> Interval:
    """Return what is in both."""
    return max(a[0], b[0]), min(a[1], b[1]), a[2] and b[2]


def whole(a: Interval) -> Interval:
    """Return the whole numbers of a finite interval."""
    return float(math.ceil(a[0])), float(math.floor(a[1])), a[2]


def below(value: float) -> float:
    """Return the next double below."""
    return math.nextafter(value, -_INFINITE)


def above(value: float) -> float:
    """Return the next double above."""
    return math.nextafter(value, _INFINITE)


def _unbounded(a: Interval) -> bool:
    return a[0] == -_INFINITE or a[1] == _INFINITE
