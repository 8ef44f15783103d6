"""Ranks knobs, what may differ between lamp and twin, by how much of the difference each explains by itself.

For every knob: a twin changed by a trial size either way replays the log, the size that fits best is read from the
sensitivity (one weighted Gauss-Newton step), the twin is replayed at that size and, for the best of them, once more
closer still. Noise is no knob of a replay: it is measured in the ticks in which the lamp stands still.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.compare.causes.evidence import NU, SCALES, Evidence, disagreement
from robolamp.compare.causes.knobs import Change, Knob, knobs
from robolamp.dynamixel.registers import RAD_PER_COUNT
from robolamp.lamp import Lamp
from robolamp.log.reader import Run

Array = NDArray[np.float64]

CONTENDERS = 5
"""How many knobs are followed to their best size."""
TURNS = 3
"""How often they are: the first time all of them."""
REWEIGHTED = 4
"""Steps of the reweighted least squares that fits several knobs at once; they settle in three."""
MOST = 4
"""Most causes that are named."""
FORCE_NOISE = 0.005
"""Of a good foot sensor [N]; its readings come in steps of 0.001 N."""
NOISE_WORTH = {"angle": 0.0005, "force": 0.01}
"""Noise that is worth a word [rad, N]: a third of an encoder's step; a thousandth of what a landing weighs."""
CORRELATED = 5.0
"""Neighbouring readings err alike: this many count as one."""
GAIN = 10.0
"""Likelihood gain, correlation counted, below which nothing is claimed: e^10 to 1."""
SHARE = 0.02
"""Share of the difference below which an explanation is not worth a word."""
REST = 0.4
"""How long goals must have stood still for the lamp to be at rest [s]."""
STILL_TICKS = 10
"""Fewer ticks at rest than this tell nothing of noise."""


@dataclass(frozen=True)
class Account:
    """All explanations of a difference, and what they leave.

    Attributes:
        causes: Accounts that are worth a word, the best first.
        unexplained: Share of the difference that none of them explains, 0 to 1; NaN where nothing could be told.
        missing: Why nothing could be told; empty where it could.
        small: Whether the whole difference is no larger than that of two good readings.
    """

    causes: tuple[Explanation, ...] = ()
    unexplained: float = math.nan
    missing: str = ""
    small: bool = False

    @property
    def left(self) -> str:
        """Return how much of the difference the causes leave unexplained, in words."""
        if self.missing:
            return f"What explains the difference is not known: {self.missing}."
        whole = "a difference no larger than that of two good readings" if self.small else "the difference"
        return f"Left unexplained: {self.unexplained * 100:.0f} % of {whole}."


@dataclass(frozen=True)
class Explanation:
    """One knob's best account of the difference.

    Attributes:
        name: As "strength knee" or "encoder noise knee".
        knob: The knob; None for noise.
        joint: Its joint; empty for the lamp as a whole.
        size: That fits best, in the kind's unit.
        gain: How much likelier the readings are than under the calibrated twin (logarithm, correlation counted).
        share: Of the difference that it explains, 0 to 1.
    """

    name: str
    knob: Knob | None
    joint: str
    size: float
    gain: float
    share: float


NOT_ASKED = Account(missing="no twin with a changed number was replayed")
"""Where a diagnosis is not wanted."""


def explain(evidence: Evidence, lamp: Lamp) -> Account:
    """Return the explanations of a log that are large enough to name, and what they leave unexplained.

    The first knob explains most by itself. Each that follows explains most of what those before it leave,
    all their sizes fitted together by the sensitivities found; what only looks like one of them explains nothing more,
    and is not listed. What the calibrated twin explains too if it starts a hair apart is no cause: a knob must explain
    more than the nearest of such twins, by more than these differ among themselves.

    Args:
        evidence: The log and its bank of twins.
        lamp: The lamp's description.
    """
    if evidence.missing:
        return Account(missing=evidence.missing)
    every = told_by(knobs(lamp), evidence)
    value, surveyed = evidence.readings.value, survey(evidence, every)
    base, (cost, furthest) = surveyed[every[0].name][0], evidence.chance
    least = max(GAIN, (furthest - cost) / CORRELATED)
    left = {knob: best for knob in every if abs((best := _best(surveyed[knob.name])).size) >= knob.about.worth}
    slopes = {knob: (best.seen - base.seen) / best.size for knob, best in left.items()}
    picked: list[Knob] = []
    sizes: list[float] = []
    shares: list[tuple[float, float]] = []
    seen = base.seen
    while left and len(picked) < MOST:
        if picked:
            tries = {
                knob: together(value, base.seen, seen, [(slopes[each], *each.bounds) for each in (*picked, knob)])
                for knob in left
            }
        else:
            tries = {knob: ([best.size], best.seen) for knob, best in left.items()}
        costs = {knob: disagreement(value, each[1]) for knob, each in tries.items()}
        knob = min(costs, key=lambda each: costs[each])
        gain, share = (cost - costs[knob]) / CORRELATED, (cost - costs[knob]) / max(base.cost, 1e-9)
        if gain < least or share < SHARE:
            break
        del left[knob]
        picked.append(knob)
        shares.append((gain, share))
        (sizes, seen), cost = tries[knob], costs[knob]
    found = [
        Explanation(knob.name, knob, knob.joint, size, *share)
        for knob, size, share in zip(picked, sizes, shares, strict=True)
        if abs(size) >= knob.about.worth
    ]
    causes = sorted([*found, *noise(evidence)], key=lambda one: -one.share)
    return Account(tuple(causes), max(0.0, 1.0 - sum(one.share for one in causes)), small=small(value, base.seen))


def small(value: Array, predicted: Array) -> bool:
    """Return whether readings are no further from a prediction than two good readings may be from each other.

    Args:
        value: Whitened readings, shape (K,).
        predicted: Whitened predictions, shape (K,).
    """
    count = np.count_nonzero(np.isfinite(value - predicted))
    return disagreement(value, predicted) <= disagreement(np.ones(count), np.zeros(count))


def told_by(every: Sequence[Knob], *evidence: Evidence) -> list[Knob]:
    """Return the knobs that the log can show: a joint that did not move shows nothing of its motor.

    Args:
        every: The knobs.
        evidence: The logs; in one of them it must have moved.
    """
    moved = np.any([each.moved for each in evidence], axis=0)
    return [
        knob for knob in every if not knob.about.moving or (moved[knob.index] if knob.about.each else bool(moved.any()))
    ]


def together(
    value: Array, base: Array, seen: Array, slopes: Sequence[tuple[Array, float, float]]
) -> tuple[list[float], Array]:
    """Return the sizes that fit best when several knobs change at once, by their slopes, and the readings they predict.

    Args:
        value: Whitened readings, shape (K,).
        base: What the calibrated twin reads, shape (K,).
        seen: What is read with the best so far: readings that are far from it weigh little, shape (K,).
        slopes: Of each knob: change of the readings per size, shape (K,), and the smallest and largest size that is
            believed.
    """
    columns = np.stack([slope for slope, _, _ in slopes], axis=1)
    low, high = np.array([bounds for _, *bounds in slopes]).T
    there = np.isfinite(value) & np.isfinite(columns).all(axis=1)
    sizes = np.zeros(len(slopes))
    for _ in range(REWEIGHTED):
        weight = np.sqrt((NU + 1) / (NU + (value - seen)[there] ** 2))
        sizes = _bounded(columns[there] * weight[:, None], (value - base)[there] * weight, low, high)
        seen = base + columns @ sizes
    return sizes.tolist(), seen


def _bounded(columns: Array, wanted: Array, low: Array, high: Array) -> Array:
    """Return the least-squares sizes inside their bounds: one that would leave them stays there, the others follow."""
    sizes, free = np.zeros(len(low)), np.ones(len(low), np.bool_)
    while free.any():
        rest = wanted - columns[:, ~free] @ sizes[~free]
        sizes[free] = np.linalg.lstsq(columns[:, free], rest, rcond=None)[0]
        outside = free & ((sizes < low) | (sizes > high))
        sizes = np.clip(sizes, low, high)
        if not outside.any():
            break
        free &= ~outside
    return sizes


@dataclass(frozen=True)
class Trial:
    """One size of one knob.

    Attributes:
        size: In the kind's unit.
        seen: What the twin with this size reads, whitened, shape (K,).
        cost: How far the log disagrees with it.
    """

    size: float
    seen: Array
    cost: float


def survey(evidence: Evidence, every: list[Knob]) -> dict[str, list[Trial]]:
    """Return how well the log agrees with each knob at the sizes that were tried; the first is size 0.

    Args:
        evidence: The log and its bank of twins.
        every: The knobs.
    """
    value = evidence.readings.value
    trials = {knob: _trials(knob, evidence) for knob in every}
    changes = [Change(), *(knob.change(size) for knob in every for size in trials[knob])]
    predicted = iter(evidence.predict(changes))
    seen = next(predicted)
    base = Trial(0.0, seen, disagreement(value, seen))
    tried = {knob.name: [base] for knob in every}
    for knob in every:
        for size in trials[knob]:
            seen = next(predicted)
            tried[knob.name].append(Trial(size, seen, disagreement(value, seen)))
    chosen = every
    for turn in range(TURNS):
        aims = [(knob, size) for knob in chosen for size in _aims(knob, value, tried[knob.name], turn)]
        for (knob, size), seen in zip(aims, evidence.predict([knob.change(size) for knob, size in aims]), strict=True):
            tried[knob.name].append(Trial(size, seen, disagreement(value, seen)))
        chosen = sorted(every, key=lambda knob: _best(tried[knob.name]).cost)[:CONTENDERS]
    return tried


def _trials(knob: Knob, evidence: Evidence) -> tuple[float, ...]:
    """Return the sizes that are tried first: of a slow line also what the answers say, which hops may hide."""
    told = knob.kind == "latency" and evidence.held_up >= knob.about.worth
    return (*knob.about.trials, knob.within(evidence.held_up)) if told else knob.about.trials


def _best(tried: list[Trial]) -> Trial:
    return min(tried, key=lambda trial: trial.cost)


def _aims(knob: Knob, value: Array, tried: list[Trial], turn: int) -> list[float]:
    """Return sizes that should fit better: a Gauss-Newton step from the best so far, and later twice that step."""
    best = _best(tried)
    other = min((each for each in tried if each.size != best.size), key=lambda each: abs(each.size - best.size))
    step = _step(value - best.seen, (other.seen - best.seen) / (other.size - best.size))
    steps = (step,) if turn == 0 else (step, 2 * step)
    return [knob.within(best.size + each) for each in steps]


def _step(residual: Array, slope: Array) -> float:
    """Return the change of size that fits a residual best, readings that are far off weighing little."""
    there = np.isfinite(residual) & np.isfinite(slope)
    residual, slope = residual[there], slope[there]
    weight = (NU + 1) / (NU + residual**2)
    curve = float((weight * slope**2).sum())
    return float((weight * slope * residual).sum()) / curve if curve > 0 else 0.0


def noise(evidence: Evidence) -> list[Explanation]:
    """Return the noise of encoders and foot sensor that is large enough to name, measured in ticks at rest.

    Args:
        evidence: The log and its bank of twins.
    """
    base = evidence.predict([Change()])[0]
    run, parts, value = evidence.run, evidence.readings.parts, evidence.readings.value
    still = resting(run)
    n = len(run.joints)
    found = []
    for index, joint in enumerate((*run.joints, "")):
        what = "angle" if joint else "force"
        series = np.full(run.index.size, np.nan)  # from one rest to the next nothing follows
        series[still] = run.angle[still, index] if joint else run.foot_force[still]
        known = RAD_PER_COUNT / np.sqrt(12) if joint else FORCE_NOISE
        ratio = max(roughness(series) / known, 1.0)
        size = known * float(np.sqrt(ratio**2 - 1))
        gain = still.size * (0.5 * (ratio**2 - 1) - np.log(ratio))
        if gain < GAIN or size < NOISE_WORTH[what]:
            continue
        part = parts[what]
        where = slice(part.start + index, part.stop, n) if joint else part
        stretch = float(np.hypot(1.0, size / SCALES[what]))
        before = disagreement(value[where], base[where])
        share = (before - disagreement(value[where], base[where], stretch)) / max(disagreement(value, base), 1e-9)
        name = f"encoder noise {joint}" if joint else "foot noise"
        found.append(Explanation(name, None, joint, size, gain, max(share, 0.0)))
    return found


def resting(run: Run) -> NDArray[np.int64]:
    """Return the ticks in which nothing has moved for a while: goals alike for REST seconds, shape (R,).

    Args:
        run: The log.
    """
    window = max(1, round(REST / run.control_period))
    same = np.all(np.abs(np.diff(run.goal, axis=0)) < 1e-6, axis=1)
    length = np.zeros(run.index.size, np.int64)
    for tick in range(1, run.index.size):
        length[tick] = (length[tick - 1] + 1) * same[tick - 1]
    return np.flatnonzero(length >= window)


def roughness(series: Array) -> float:
    """Return the standard deviation of white noise in a series that hardly moves: that of its second differences.

    Args:
        series: Evenly sampled, shape (R,); NaN where missing.

    Returns:
        NaN-free: 0 where there are too few samples to tell. White noise of deviation s has second differences of
        deviation s sqrt(6). What is off by more than four deviations, by their median (1.4826 makes it one), is a knock
        or a late settling, and left out; the median alone would tell no noise between one encoder step and the next.
    """
    bends = np.diff(series, 2)
    bends = bends[np.isfinite(bends)]
    if bends.size < STILL_TICKS:
        return 0.0
    kept = bends[np.abs(bends) <= 4 * 1.4826 * np.median(np.abs(bends))]
    return float(np.sqrt(np.mean(kept**2) / 6.0))
