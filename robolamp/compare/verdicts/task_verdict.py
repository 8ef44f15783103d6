"""Did the lamp do its task? Done, not done, or cannot say; and why, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robolamp.compare.align import STILL
from robolamp.compare.run_ending import Ending
from robolamp.compare.travel.landing import Landing
from robolamp.compare.verdicts.controller_alone import Alone
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.log.run_context import PLAYED
from robolamp.twin.judges.lamp_judge import HOP_LANDING_TILT, REST_MOTION, REST_WINDOW

DONE, NOT_DONE, CANNOT_SAY = "done", "not done", "cannot say"


@dataclass(frozen=True)
class Task:
    """Whether a run did its task, and why.

    Attributes:
        word: "done", "not done" or "cannot say".
        why: What that rests on: where it landed first, then what was wrong or is not known, then its hops.
    """

    word: str
    why: tuple[str, ...]


def task_of(run: Run, lamp: Lamp, ending: Ending, landing: Landing, alone: Alone, allowed: float) -> Task:
    """Return whether a run did its task: at rest within `allowed` of the goal, upright, at the end of a whole run.

    A gesture's task is to be played to its end where the lamp stands.

    If nobody knows where it landed, the answer can only be "not done" or "cannot say".

    Args:
        run: The log.
        lamp: The lamp's description.
        ending: How the run ended.
        landing: What is known of where it landed.
        alone: What its controller does alone on the twin.
        allowed: Distance from the goal that is there [m].
    """
    against = [*_against(run, landing, allowed), *_signs(run, lamp, landing, alone)]
    if ending.wrong:
        against.append(ending.wrong)
    unknown = []
    stays = plays_in_place(run)
    if stays and abs(landing.travel) > allowed:
        against.append(f"it was to stay where it stood, allowed {cm(allowed)}")
    if not math.isfinite(run.goal_m) and not stays:
        unknown.append("the log names no goal")
    if not math.isfinite(landing.travel) and not stays:
        unknown.append("nothing measured where it landed")
    word = NOT_DONE if against else CANNOT_SAY if unknown else DONE
    well = [] if against or unknown or math.isnan(landing.motion) else ["at rest and upright"]
    if stays and not against:
        well.insert(0, "played to its end")
    return Task(word, (*_landed(run, landing), *well, *against, *unknown, _hops(run, landing, alone)))


def plays_in_place(run: Run) -> bool:
    """Return whether a run is of gestures alone: the lamp is sent nowhere."""
    return math.isnan(run.goal_m) and any(run.context.get(kind) for kind in PLAYED)


def _landed(run: Run, landing: Landing) -> Iterator[str]:
    if math.isfinite(landing.travel):
        goal = run.goal_m
        where = f" for a goal of {cm(goal)} ({(landing.travel - goal) * 100:+.1f} cm)" if math.isfinite(goal) else ""
        yield f"landed at {cm(landing.travel)}{where}"


def _against(run: Run, landing: Landing, allowed: float) -> Iterator[str]:
    """Yield what is known to be wrong with where and how it landed."""
    if landing.fell:
        yield "fell"
    off = abs(landing.travel - run.goal_m)
    if off > allowed:
        yield f"{cm(off)} off, allowed {cm(allowed)}"
    elif off >= abs(landing.travel):
        yield "no nearer to the goal than to where it stood"
    if landing.motion > REST_MOTION:
        yield f"not at rest: it moved by {cm(landing.motion)} in the controller's last {REST_WINDOW:g} s"
    if landing.tilt > HOP_LANDING_TILT and not landing.fell:
        yield f"not upright: it leans by {math.degrees(landing.tilt):.0f} degrees"


def _signs(run: Run, lamp: Lamp, landing: Landing, alone: Alone) -> Iterator[str]:
    """Yield signs in the lamp's own sensors that it failed, where there is no truth log; a ruler shows no fall."""
    if landing.fell is not None:
        return
    rows = run.phase == "run"
    if rows.any() and not _moved(run.angle[rows]):
        yield "no joint moved"
    last = run.foot_force[run.began >= run.began[-1] - REST_WINDOW]
    last = last[np.isfinite(last)]
    if last.size and np.median(last) < lamp.contact_off:
        yield "its foot does not press on the floor at the end: it fell, or was lifted"
    if rows.any() and run.hops[-1] == 0 and alone.flown and not math.isfinite(landing.travel):
        yield f"it counted no hop, where its controller alone on the twin takes {alone.flown}"


def _moved(angle: np.ndarray) -> bool:
    """Return whether any joint moved; True where none is known."""
    known = angle[np.isfinite(angle).all(axis=1)]
    return not len(known) or bool((known.std(axis=0) >= STILL).any())


def _hops(run: Run, landing: Landing, alone: Alone) -> str:
    counted = int(run.hops[-1])
    said = f"counted {counted} hop{'s' * (counted != 1)}"
    if landing.flown is not None:
        return f"{said}, {landing.flown} flew"
    return said if alone.why else f"{said} (its controller alone on the twin: {alone.hops})"


def cm(metres: float) -> str:
    """Return a length in words: "4.4 cm", or "unknown"."""
    return f"{round(metres * 100, 1) + 0.0:.1f} cm" if math.isfinite(metres) else "unknown"
