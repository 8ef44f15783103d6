"""How far the twin can predict a run: replays that start a hair apart.

A twin that bends, or has play, is chaotic: of two replays of one log that hardly differ where they begin, one may take
a hop that the other does not. Nobody knows how the lamp stood to less than a step of its encoders and the play of its
gears, so that each of these replays may be the lamp's. The one nearest to the lamp is the replay that is shown and
judged, and a difference counts against the lamp where it is also larger than those of the replays among themselves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from robolamp.compare.align import find_lag, measure
from robolamp.compare.replays.goal_replay import Replay, Starts
from robolamp.compare.replays.trajectory import Side, compared, of_replay
from robolamp.compare.travel.sensed_flights import Flight, flights, hops
from robolamp.compare.verdicts.tolerances import Tolerances
from robolamp.dynamixel.registers import RAD_PER_COUNT
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.twin.lamp_model import TwinModel

Array = NDArray[np.float64]

STARTS = 12
"""How many replays there are. Chosen: a lamp that is like its twin is further off than all of them in 1 of 13 runs."""
LATE = 0.0005
"""How much earlier or later than the log says a goal may reach the servos [s]: what is not worth a word (the knob
"delay" of `robolamp.compare.causes.knobs`)."""
WINDOW = 0.2
"""Over which the spread of replays is averaged (RMS), as a lamp's distance from them is [s]."""
_GRID = 5  # physics steps between two looks at how far replays are apart
_SEED = 1
_LEAST = 1e-9  # a tolerance of 0 allows this much


@dataclass(frozen=True)
class Apart:
    """How far two motions are apart.

    Attributes:
        mae: Mean absolute difference of each joint, shape (n,) [rad]; NaN where it is not known.
        travel: Difference of travel [m]; NaN where it is not known.
        late: Largest difference of a take-off or a landing of a hop that both made [s].
        single: How many hops only one of the two made.
        fell: Whether only one of the two fell.
    """

    mae: Array
    travel: float
    late: float
    single: int
    fell: bool = False

    def score(self, allowed: Tolerances) -> float:
        """Return the largest difference by what is allowed, plus one for each hop that only one of the two made.

        Args:
            allowed: The tolerances.
        """
        if self.fell:
            return math.inf
        shares = [
            *(self.mae / max(allowed.joint_mae, _LEAST)).tolist(),
            self.travel / max(allowed.travel, _LEAST),
            self.late / max(allowed.hop, _LEAST),
        ]
        return self.single + max((share for share in shares if math.isfinite(share)), default=0.0)


@dataclass(frozen=True)
class Spread:
    """How far replays that start a hair apart are from each other.

    Attributes:
        apart: The largest differences among them, quantity by quantity.
        horizon: From when on they are further apart than a joint may be from its twin, since the controller's first
            tick [s]; NaN: never.
    """

    apart: Apart
    horizon: float = math.nan


def starts(twin: TwinModel) -> Starts:
    """Return replays that start a hair apart, the same each time.

    The first begins as the log says; the others are drawn uniformly from what it cannot tell: where the joints stand,
    to half a step of the encoder and half the play either way, and when goals reach the servos, to LATE either way.

    Args:
        twin: The lamp.
    """
    reach = RAD_PER_COUNT / 2 + twin.gears.play / 2
    random = np.random.default_rng(_SEED)
    nudge = random.uniform(-reach, reach, (STARTS, len(reach)))
    late = random.uniform(-LATE, LATE, STARTS)
    nudge[0], late[0] = 0.0, 0.0
    return Starts(nudge, late)


def nearest(run: Run, lamp: Lamp, ours: Side, replays: Sequence[Replay], allowed: Tolerances) -> tuple[int, Spread]:
    """Return which replay is nearest to what the lamp did, and how far each is from the one nearest to itself.

    Args:
        run: The log.
        lamp: The lamp's description.
        ours: What the lamp did.
        replays: Replays of the log that start a hair apart.
        allowed: The tolerances, which say what is far.
    """
    sides = [of_replay(run, each) for each in replays]
    landed = [flights(side, lamp) for side in sides]
    scores = [each.score(allowed) for each in _from_lamp(run, ours, flights(ours, lamp), sides, landed)]
    pairs = _pairs(run, replays, sides, landed)
    closest = [
        min((pairs[min(one, other), max(one, other)] for other in range(len(sides)) if other != one),
            key=lambda pair: pair.score(allowed))
        for one in range(len(sides))
    ]  # fmt: skip
    return int(np.argmin(scores)), Spread(_largest(closest), _horizon(run, replays, allowed))


def between(run: Run, lamp: Lamp, replays: Sequence[Replay], allowed: Tolerances) -> Spread:
    """Return how far two replays of a log that start a hair apart may be from each other.

    Args:
        run: The log.
        lamp: The lamp's description.
        replays: The replays.
        allowed: The tolerances.
    """
    sides = [of_replay(run, each) for each in replays]
    pairs = _pairs(run, replays, sides, [flights(side, lamp) for side in sides])
    return Spread(_largest(list(pairs.values())), _horizon(run, replays, allowed))


def _from_lamp(
    run: Run, ours: Side, flown: list[Flight], sides: Sequence[Side], landed: Sequence[list[Flight]]
) -> list[Apart]:
    """Return how far replays are from the lamp, without the lag, which all of them have in common."""
    rows = compared(run)
    own = [ours.trace(joint).part(*_stretch(ours.time[rows, joint])) for joint in range(len(run.joints))]
    lags = [find_lag(sides[0].trace(joint), trace) for joint, trace in enumerate(own)]
    found = []
    for side, theirs in zip(sides, landed, strict=True):
        errors = [
            measure(side.trace(joint), trace, lag if math.isfinite(lag) else 0.0)[0].mae
            for joint, (trace, lag) in enumerate(zip(own, lags, strict=True))
        ]
        found.append(_apart(np.array(errors), ours, side, flown, theirs))
    return found


def _stretch(time: Array) -> tuple[float, float]:
    known = time[np.isfinite(time)]
    return (float(known.min()), float(known.max()) + 1e-6) if known.size else (0.0, 0.0)


def _pairs(
    run: Run, replays: Sequence[Replay], sides: Sequence[Side], landed: Sequence[list[Flight]]
) -> dict[tuple[int, int], Apart]:
    angle = _driven(run, replays)[1]
    return {
        (one, other): _apart(
            np.abs(angle[one] - angle[other]).mean(axis=0), sides[one], sides[other], landed[one], landed[other]
        )
        for one, other in combinations(range(len(sides)), 2)
    }


def _apart(mae: Array, one: Side, other: Side, ours: list[Flight], theirs: list[Flight]) -> Apart:
    late, single = 0.0, 0
    for hop in hops(ours, theirs):
        if hop.lamp is None or hop.twin is None:
            single += 1
        else:
            late = max(late, abs(hop.off_late), abs(hop.on_late))
    fell = one.fell is not None and bool(one.fell) != bool(other.fell)
    return Apart(mae, abs(one.travel - other.travel), late, single, fell)


def _largest(pairs: Sequence[Apart]) -> Apart:
    """Return the largest differences; pairs of which only one fell have nothing to compare."""
    upright = [pair for pair in pairs if not pair.fell]
    if not upright:
        return Apart(np.zeros(len(pairs[0].mae)), 0.0, 0.0, 0)
    return Apart(
        np.max([pair.mae for pair in upright], axis=0),
        max(pair.travel for pair in upright),
        max(pair.late for pair in upright),
        max(pair.single for pair in upright),
    )


def _driven(run: Run, replays: Sequence[Replay]) -> tuple[Array, Array]:
    """Return moments in which the controller drove, shape (k,) [s], and all replays' angles then, shape (r, k, n)."""
    rows, time = compared(run), replays[0].time
    first, last = np.searchsorted(time, [run.scheduled[rows][0], run.scheduled[rows][-1]]).tolist()
    there = slice(first, last, _GRID)
    return time[there] - float(run.scheduled[rows][0]), np.array([each.angle[there] for each in replays])


def _horizon(run: Run, replays: Sequence[Replay], allowed: Tolerances) -> float:
    time, angle = _driven(run, replays)
    if time.size < 2:
        return math.nan
    width = min(max(1, round(WINDOW / float(time[1] - time[0]))), time.size)
    two = 2.0 * angle.var(axis=0, ddof=1).max(axis=1)  # of a joint, from one replay to another
    level = np.sqrt(np.convolve(two, np.full(width, 1.0 / width), mode="valid"))
    outside = np.flatnonzero(level > allowed.joint_mae)
    return float(time[outside[0]]) if outside.size else math.nan
