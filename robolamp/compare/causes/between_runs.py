"""What changed between two runs: each knob is wrong in both alike, or changed between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.compare.causes.evidence import Evidence, disagreement
from robolamp.compare.causes.knobs import Knob, knobs
from robolamp.compare.causes.ranking import (
    CORRELATED,
    GAIN,
    MOST,
    SHARE,
    Account,
    Explanation,
    Trial,
    noise,
    small,
    survey,
    together,
    told_by,
)
from robolamp.lamp import Lamp

Array = NDArray[np.float64]


def changed(now: Evidence, before: Evidence, lamp: Lamp) -> Account:
    """Return what changed from one run to another, the change that explains most first; sizes are later minus earlier.

    Knobs are taken one by one, the one first that explains most of what is left of both runs: either as a change,
    which affects the later run alone, or as an error of the twin in both. The latter explains its part of the
    difference too, but is not returned.

    Args:
        now: The run that is judged.
        before: The run it is compared with.
        lamp: The lamp's description.
    """
    if missing := now.missing or before.missing:
        return Account(missing=missing)
    every = told_by(knobs(lamp), now, before)
    late, early = survey(now, every), survey(before, every)
    value = np.concatenate([now.readings.value, before.readings.value])
    base = np.concatenate([late[every[0].name][0].seen, early[every[0].name][0].seen])
    columns: dict[tuple[Knob, bool], Array] = {}
    for knob in every:
        ours, theirs = _slope(late[knob.name], knob), _slope(early[knob.name], knob)
        columns[knob, True] = np.concatenate([ours, np.where(np.isnan(theirs), np.nan, 0.0)])
        columns[knob, False] = np.concatenate([ours, theirs])
    picked: list[tuple[Knob, bool]] = []
    gains: list[tuple[float, float]] = []
    sizes: list[float] = []
    seen, cost = base, disagreement(value, base)
    whole = max(cost, 1e-9)
    nearest, furthest = np.sum([now.chance, before.chance], axis=0).tolist()
    least, cost = max(GAIN, (furthest - nearest) / CORRELATED), min(cost, nearest)
    while len(picked) < 2 * MOST:
        tries = {
            key: together(value, base, seen, [(columns[each], *_bounds(*each)) for each in (*picked, key)])
            for key in columns
            if key not in picked
        }
        costs = {key: disagreement(value, each[1]) for key, each in tries.items()}
        key = min(costs, key=lambda each: costs[each])
        gain, share = (cost - costs[key]) / CORRELATED, (cost - costs[key]) / whole
        if gain < least or share < SHARE:
            break
        picked.append(key)
        gains.append((gain, share))
        (sizes, seen), cost = tries[key], costs[key]
    found = [
        Explanation(knob.name, knob, knob.joint, size, *gain)
        for (knob, change), size, gain in zip(picked, sizes, gains, strict=True)
        if change and abs(size) >= knob.about.worth
    ]
    found.sort(key=lambda one: -one.share)
    was = {one.name: one.size for one in noise(before)}
    noisier = [one for one in noise(now) if one.size > 2 * was.get(one.name, 0.0)]
    explained = sum(share for _, share in gains) + sum(one.share for one in noisier)
    return Account((*found[:MOST], *noisier), max(0.0, 1.0 - explained), small=small(value, base))


def _bounds(knob: Knob, change: bool) -> tuple[float, float]:
    """Return the smallest and largest size of a knob, or of its change from one believed size to another."""
    low, high = knob.bounds
    return (low - high, high - low) if change else (low, high)


def _slope(tried: list[Trial], knob: Knob) -> Array:
    """Return the change of the readings per size: over the best size where it is one, else over the first trial."""
    best = min(tried, key=lambda trial: trial.cost)
    trial = best if abs(best.size) >= knob.about.worth else tried[1]
    return (trial.seen - tried[0].seen) / trial.size
