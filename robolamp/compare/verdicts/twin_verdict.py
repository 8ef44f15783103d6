"""Does the twin explain a run? Inside the tolerances, outside, or cannot say; and why, in words.

Nothing that was not measured is inside: a value that is missing makes the verdict "cannot say", or "outside" where what
is missing is itself a difference (a reading, a hop).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from robolamp.compare.align import MIN_SAMPLES, STILL, JointError
from robolamp.compare.pauses import origin, pauses, silent
from robolamp.compare.replays.trajectory import Side, compared
from robolamp.compare.run_ending import EARLY_ENDS, Ending
from robolamp.compare.travel.sensed_flights import Hop
from robolamp.compare.verdicts.ensemble import Apart, Spread
from robolamp.compare.verdicts.tolerances import Tolerances
from robolamp.log.reader import Run
from robolamp.signals import ASKED_AGAIN

INSIDE, OUTSIDE, CANNOT_SAY = "inside", "outside", "cannot say"
_LEAST_SHARE = 0.5  # chosen: with fewer of its readings than this a joint's motion is not known


@dataclass(frozen=True)
class Verdict:
    """Whether the twin explains a run.

    Attributes:
        exceeded: What is outside its tolerance, a sentence each; empty where nothing is.
        unknown: Why one cannot say whether the rest is inside; empty: one can.
        driven: Whether the controller drove at all: without that there is nothing to explain.
    """

    exceeded: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    driven: bool = True

    @property
    def word(self) -> str:
        """Return "inside", "outside" or "cannot say": a measured difference counts, whatever else is unknown."""
        if self.exceeded and self.driven:
            return OUTSIDE
        return CANNOT_SAY if self.unknown else INSIDE

    @property
    def why(self) -> tuple[str, ...]:
        """Return the reasons; empty for "inside"."""
        return self.exceeded + self.unknown if self.driven else self.unknown


def verdict_of(
    run: Run,
    endings: Sequence[Ending],
    joints: Sequence[JointError],
    hops: Sequence[Hop],
    lamp: Side,
    other: Side,
    allowed: Tolerances,
    spread: Spread | None = None,
    reference: Run | None = None,
) -> Verdict:
    """Return whether the reference (twin or other run) explains what the lamp did.

    With the twin as reference, an unmeasured travel makes it "cannot say". Of two logs, travel counts only where both
    are known. What is outside, but no further apart than replays that start a hair apart, makes it "cannot say".

    Args:
        run: The lamp's log.
        endings: How the run ended, and the other one, where two logs are compared.
        joints: The differences, joint by joint.
        hops: The hops of both.
        lamp: What the lamp did.
        other: Its reference: what the twin or the other lamp did.
        allowed: The tolerances.
        spread: How far replays that start a hair apart are from each other; None: not at all.
        reference: The other one's log, where two logs are compared.
    """
    rows = compared(run) & ~silent(run)  # a port that was away for a while is no reading that went missing
    missing = np.count_nonzero(~np.isfinite(run.angle[rows]), axis=0).tolist()
    alike = spread.apart if spread else Apart(np.zeros(len(joints)), 0.0, 0.0, 0)
    apart = [
        *_joints(joints, allowed, alike), *_hops(hops, allowed, lamp, other, alike),
        *_travel(lamp, other, allowed, alike),
    ]  # fmt: skip
    exceeded = [*_fell(lamp, other), *(each.text for each in apart if not each.alike), *_gaps(run, allowed)]
    if reference:
        exceeded += [f"{other.name}: {text}" for text in _gaps(reference, allowed)]
    chance = [
        f"{each.text}; replays that start a hair apart differ by up to {each.alike}" for each in apart if each.alike
    ]
    unknown = [*_ended(endings, other), *chance, *_unknown(run, joints, missing, lamp, other, rows)]
    if len(endings) == 1 and not math.isfinite(lamp.travel - other.travel):
        unknown.append("travel unknown: nothing measured how far the lamp came")
    return Verdict(tuple(exceeded), tuple(unknown), driven=endings[0].drove > 0.0)


def _fell(lamp: Side, other: Side) -> Iterator[str]:
    if lamp.fell and other.fell:
        yield f"the {lamp.name} fell, and so did the {other.name}: what lies on the floor is not compared"
    elif lamp.fell or other.fell:
        fell, stood = (lamp, other) if lamp.fell else (other, lamp)
        yield f"the {fell.name} fell" + ("" if stood.fell is None else f", the {stood.name} did not")


@dataclass(frozen=True)
class _Excess:
    """A difference that is larger than allowed: what it is, and how far replays differ in it if they do as much."""

    text: str
    alike: str = ""


def _joints(joints: Sequence[JointError], allowed: Tolerances, alike: Apart) -> Iterator[_Excess]:
    for joint, replays in zip(joints, alike.mae.tolist(), strict=True):
        if joint.after.mae > allowed.joint_mae:
            yield _Excess(
                f"{joint.name}: MAE {joint.after.mae * 1e3:.1f} mrad with the lag removed, "
                f"allowed {allowed.joint_mae * 1e3:.1f} mrad",
                f"{replays * 1e3:.1f} mrad" if joint.after.mae <= replays else "",
            )
        if abs(joint.lag) > allowed.lag:
            yield _Excess(f"{joint.name}: lag {joint.lag * 1e3:+.1f} ms, allowed {allowed.lag * 1e3:.1f} ms")


def _hops(hops: Sequence[Hop], allowed: Tolerances, lamp: Side, other: Side, alike: Apart) -> Iterator[_Excess]:
    single = sum(hop.lamp is None or hop.twin is None for hop in hops)
    often = f"{alike.single} hop{'s' * (alike.single != 1)}" if single <= alike.single else ""
    for number, hop in enumerate(hops, start=1):
        if hop.lamp is None or hop.twin is None:
            yield _Excess(f"hop {number}: only on the {other.name if hop.lamp is None else lamp.name}", often)
        for word, late in (("takes off", hop.off_late), ("lands", hop.on_late)):
            if abs(late) > allowed.hop:
                yield _Excess(
                    f"hop {number}: {word} {abs(late) * 1e3:.0f} ms {'late' if late > 0 else 'early'}, "
                    f"allowed {allowed.hop * 1e3:.0f} ms",
                    f"{alike.late * 1e3:.0f} ms" if abs(late) <= alike.late else "",
                )


def _travel(lamp: Side, other: Side, allowed: Tolerances, alike: Apart) -> Iterator[_Excess]:
    difference = lamp.travel - other.travel
    if abs(difference) > allowed.travel:
        yield _Excess(
            f"travel: {lamp.name} {lamp.travel * 1e2:.1f} cm, {other.name} {other.travel * 1e2:.1f} cm, "
            f"allowed difference {allowed.travel * 1e2:.1f} cm",
            f"{alike.travel * 1e2:.1f} cm" if abs(difference) <= alike.travel else "",
        )


def _gaps(run: Run, allowed: Tolerances) -> Iterator[str]:
    """Yield what is missing in a log, and its faults."""
    rows = compared(run) & ~silent(run)
    of = int(np.count_nonzero(rows))
    readings = [*zip(run.joints, run.angle[rows].T, strict=True), ("foot", run.foot_force[rows])]
    for name, values in readings:
        gone = int(np.count_nonzero(~np.isfinite(values)))
        if gone > allowed.missing * of:
            yield f"{name}: {gone} of {of} readings are missing, allowed {allowed.missing:.1%}"
    yield from _lost(run, allowed)
    yield from _faults(run, allowed)


def _lost(run: Run, allowed: Tolerances) -> Iterator[str]:
    """Yield a reason if ticks that ran are not in the log: nobody knows what the lamp did in them."""
    driven = run.phase == "run"
    lost = int((np.diff(run.index) - 1)[driven[1:] | driven[:-1]].sum())
    of = int(np.count_nonzero(driven)) + lost
    if lost > allowed.missing * of:
        yield f"{lost} of {of} ticks are missing in the log, allowed {allowed.missing:.1%}"


def _faults(run: Run, allowed: Tolerances) -> Iterator[str]:
    """Yield the faults while the controller drove: the twin has none.

    A servo that answered only when asked again left no gap: that is a fault where it is more often than allowed.
    """
    gone = silent(run)
    rows = np.flatnonzero((run.phase == "run") & ~gone)
    if not rows.size:
        return
    away = [(run.log_time[np.flatnonzero(~gone[: each.last + 1])[-1]], run.log_time[each.next]) for each in pauses(run)]
    faults = Counter(text for row in rows for text in run.faults[row])
    begin, end = run.log_time[rows[0]], run.log_time[rows[-1]] + int(run.control_period * 1e9)
    told = {
        text
        for when, level, text in run.events
        if level != "info"
        and begin <= when <= end
        and not text.startswith(EARLY_ENDS)
        and not any(left < when <= back for left, back in away)
    }
    for text in sorted(told - set(faults)):
        if not any(fault in text for fault in faults):
            faults[text] = 1
    for text in [f"{joint}: {ASKED_AGAIN}" for joint in run.joints]:
        if faults[text] <= allowed.asked_again * rows.size:
            del faults[text]
    for text, count in faults.most_common(3):
        yield f"a fault while the controller drove: {text}" + (f" ({count} ticks)" if count > 1 else "")
    if len(faults) > 3:
        yield f"{len(faults) - 3} more kind{'s' * (len(faults) > 4)} of fault while it drove"


def _ended(endings: Sequence[Ending], other: Side) -> Iterator[str]:
    for ending, whose in zip(endings, ("the run", other.name), strict=False):
        if ending.cut:
            yield f"{whose}: {ending.wrong}"


def _unknown(
    run: Run, joints: Sequence[JointError], missing: Sequence[int], lamp: Side, other: Side, rows: np.ndarray
) -> Iterator[str]:
    driven = int(np.count_nonzero((run.phase == "run") & ~silent(run)))
    ticks, end = int(np.count_nonzero(rows)), float(run.scheduled[rows][-1]) - origin(run)
    if driven < MIN_SAMPLES:  # what else is in the log stands for nothing that the controller did
        yield f"too few readings: {driven} tick{'s' * (driven != 1)} of the controller"
    for joint, gone in zip(joints, missing, strict=True):
        there = min(joint.samples, joint.of - gone)
        if ticks >= MIN_SAMPLES and there < max(MIN_SAMPLES, _LEAST_SHARE * joint.of):
            yield f"too few readings: {joint.name}, {there} of {joint.of}"
    known = [math.isfinite(joint.lag) for joint in joints]
    if not any(known):
        yield "lag unknown: no joint moved enough, and enough alike, to measure it"
    else:
        for index, joint in enumerate(joints):
            if not known[index] and any(_moves(side, index, end) for side in (lamp, other)):
                yield f"{joint.name}: lag unknown, the two moved too differently"


def _moves(side: Side, joint: int, end: float) -> bool:
    """Return whether a joint moves while the controller drives: from 0 to `end` on a side's clock [s]."""
    time = side.time[:, joint]
    driven = side.angle[(time >= 0.0) & (time <= end), joint]
    known = driven[np.isfinite(driven)]
    return known.size > 0 and float(known.std()) >= STILL
