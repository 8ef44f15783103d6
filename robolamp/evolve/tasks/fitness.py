"""Fitness terms: each measures one thing that can be wrong with a run; lower is better."""

from __future__ import annotations

import runpy
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import FileError, RobolampError
from robolamp.figure import LAMP
from robolamp.files import MOST_TOML, read_text
from robolamp.twin.judges.figure_judge import FigureOutcome
from robolamp.twin.judges.lamp_judge import Outcome
from robolamp.twin.judges.run_outcome import RunOutcome

Term = Callable[[Any], NDArray[np.float64]]
"""Takes an outcome of many lanes (`Outcome` of the lamp, `FigureOutcome` of other figures) and gives one number a lane,
not below 0, shape (lanes,).

It judges what was done: what the envelope had to change (`interventions`) is hidden from it, because a run may be
taken over from another controller that sent the same goals."""

_TERMS: dict[str, Term] = {}
FLIGHT_SHARE_WANTED = 0.7
"""Share of the travel in flight at which a run no longer counts as shuffling."""
HOPELESS = 1e6
"""Fitness of a run of which no number can be made."""
NEEDS = {"pole": "[pole]", "pose": "[[poses]]", "timing": "cases.goal_time"}
"""Terms that ask for a part of the task file."""


_FIGURES_TOO = ("distance", "miss", "arrival", "posture")
_FIGURES_ONLY = ("collision", "idle", "angles", "velocities", "tilt")


def term(name: str) -> Callable[[Term], Term]:
    """Register a fitness term under the name that task files use.

    Args:
        name: Key in a task's [main] or [style].

    Raises:
        RobolampError: One of robolamp's own has that name.
    """

    def register(function: Term) -> Term:
        if name in _TERMS and _TERMS[name].__module__ == __name__ != function.__module__:
            raise RobolampError("is a term of robolamp's own; choose another name", f"fitness term {name!r}")
        _TERMS[name] = function
        return function

    return register


def terms() -> Mapping[str, Term]:
    """Return every registered term by name."""
    return _TERMS


def terms_of(figure: str) -> tuple[str, ...]:
    """Return the names of the terms that judge a figure: robolamp's own for it, and every one of the user's.

    Args:
        figure: "lamp", or another.
    """
    own = {name for name, function in _TERMS.items() if function.__module__ == __name__}
    others = own.difference(_FIGURES_TOO, _FIGURES_ONLY) if figure != LAMP else _FIGURES_ONLY
    return tuple(name for name in _TERMS if name not in others)


@term("distance")
def _distance(outcome: RunOutcome) -> NDArray[np.float64]:
    return np.abs(outcome.error) / np.abs(outcome.goal)


@term("miss")
def _miss(outcome: RunOutcome) -> NDArray[np.float64]:
    return np.minimum(np.abs(outcome.error), 0.3) / 0.05


@term("fall")
def _fall(outcome: Outcome) -> NDArray[np.float64]:
    return outcome.fallen.astype(np.float64)


@term("shuffle")
def _shuffle(outcome: Outcome) -> NDArray[np.float64]:
    return np.maximum(FLIGHT_SHARE_WANTED - np.nan_to_num(outcome.flight_share), 0.0)


@term("landing")
def _landing(outcome: Outcome) -> NDArray[np.float64]:
    return outcome.bad_landings


@term("restless")
def _restless(outcome: Outcome) -> NDArray[np.float64]:
    return np.minimum(outcome.motion, 0.05) / 0.05


@term("posture")
def _posture(outcome: RunOutcome) -> NDArray[np.float64]:
    return np.minimum(np.abs(outcome.angles).mean(axis=1), 1.0)


@term("arrival")
def _arrival(outcome: RunOutcome) -> NDArray[np.float64]:
    return np.where(np.isnan(outcome.arrival), 1.0, outcome.arrival / outcome.duration)


@term("travel_after")
def _travel_after(outcome: Outcome) -> NDArray[np.float64]:
    return np.minimum(outcome.travel_after / np.abs(outcome.goal), 1.0)


@term("pole")
def _pole(outcome: Outcome) -> NDArray[np.float64]:
    return outcome.pole.astype(np.float64)


@term("pose")
def _pose(outcome: Outcome) -> NDArray[np.float64]:
    return np.minimum(outcome.pose_error, 1.0)


@term("timing")
def _timing(outcome: Outcome) -> NDArray[np.float64]:
    late = np.abs(outcome.arrival - outcome.goal_time) / outcome.duration
    return np.where(np.isnan(outcome.arrival), 1.0, np.minimum(late, 1.0))


# Kwasnicka & Wozniak, Pseudocode 3: a collision is counted INSTEAD OF timing, angles and velocities.


@term("collision")
def _collision(outcome: FigureOutcome) -> NDArray[np.float64]:
    return (~np.isnan(outcome.collision)).astype(np.float64)


def _unless_collided(outcome: FigureOutcome, value: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isnan(outcome.collision), np.clip(value, 0.0, 1.0), 0.0)


@term("idle")
def _idle(outcome: FigureOutcome) -> NDArray[np.float64]:
    return _unless_collided(outcome, outcome.idle / outcome.duration)


@term("angles")
def _angles(outcome: FigureOutcome) -> NDArray[np.float64]:
    return _unless_collided(outcome, np.abs(outcome.angles).sum(axis=1))


@term("velocities")
def _velocities(outcome: FigureOutcome) -> NDArray[np.float64]:
    return _unless_collided(outcome, np.abs(outcome.velocities).sum(axis=1))


@term("tilt")
def _tilt(outcome: FigureOutcome) -> NDArray[np.float64]:
    return outcome.tilt / np.pi


def load_terms(path: Path) -> None:
    """Run a user's Python file, which registers fitness terms with `@term`.

    Raises:
        FileError: The file is missing, fails, or registers nothing.
    """
    before = dict(_TERMS)
    read_text(path, MOST_TOML)  # refuses what is no file, or would be read without end
    try:
        runpy.run_path(str(path), run_name="robolamp_terms")
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror or error}", str(path)) from None
    except RobolampError:
        raise
    except (Exception, SystemExit) as error:  # whatever the user's own code may raise
        raise FileError(f"fails{_line_of(error, str(path))}: {_told(error)}", str(path)) from None
    if before == _TERMS:
        raise FileError("registers no fitness term; expected a function under @term(NAME)", str(path))


def _told(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _line_of(error: BaseException, path: str) -> str:
    if isinstance(error, SyntaxError):
        return f" at line {error.lineno}"
    step, found = error.__traceback__, ""
    while step is not None:
        if step.tb_frame.f_code.co_filename == path:
            found = f" at line {step.tb_lineno}"
        step = step.tb_next
    return found


def weighted(outcome: RunOutcome, weights: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the weighted sum of terms, shape (lanes,); `HOPELESS` at most, and where it is no number.

    Args:
        outcome: What the lanes did.
        weights: Weight of each term, by name.

    Raises:
        RobolampError: A term failed, or gave something below 0, or not one number a lane.
    """
    total = np.zeros(len(outcome.goal))
    shown = replace(outcome, interventions=np.zeros_like(outcome.interventions), trace=None)
    for name, weight in weights.items():
        value = _value(name, shown)
        if value.shape != total.shape:
            raise RobolampError(f"gave shape {value.shape}; expected {total.shape}", f"fitness term {name!r}")
        if (value < 0.0).any():
            raise RobolampError(f"gave {value.min():g}; expected nothing below 0", f"fitness term {name!r}")
        total += weight * value
    return np.where(total < HOPELESS, total, HOPELESS)  # also where it is no number


def _value(name: str, outcome: RunOutcome) -> NDArray[np.float64]:
    function = _TERMS[name]
    try:
        value = np.asarray(function(outcome))
        if value.dtype.kind not in "biuf":
            raise TypeError(f"gave {value.dtype}; expected numbers")
        return value.astype(np.float64)
    except Exception as error:  # whatever the user's own code may raise
        line = _line_of(error, function.__code__.co_filename)
        raise RobolampError(f"fails{line}: {_told(error)}", f"fitness term {name!r}") from None
