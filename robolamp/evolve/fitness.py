"""Fitness terms: what can be wrong with a run, each as a number; lower is better."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from robolamp.twin.judge import Outcome

Term = Callable[[Outcome], NDArray[np.float64]]
"""Takes an outcome of many lanes and gives one number a lane, shape (lanes,)."""

_TERMS: dict[str, Term] = {}
FLIGHT_SHARE_WANTED = 0.7
"""Share of the travel in flight at which a run no longer counts as shuffling."""
HOPELESS = 1e6
"""Fitness of a run of which no number can be made."""


def term(name: str) -> Callable[[Term], Term]:
    """Register a fitness term under the name that task files use.

    Args:
        name: Key in a task's [main] or [style].
    """

    def register(function: Term) -> Term:
        _TERMS[name] = function
        return function

    return register


def terms() -> Mapping[str, Term]:
    """Return every registered term by name."""
    return _TERMS


@term("distance")
def _distance(outcome: Outcome) -> NDArray[np.float64]:
    return np.abs(outcome.error) / np.abs(outcome.goal)


@term("miss")
def _miss(outcome: Outcome) -> NDArray[np.float64]:
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
def _posture(outcome: Outcome) -> NDArray[np.float64]:
    return np.minimum(np.abs(outcome.angles).mean(axis=1), 1.0)


def weighted(outcome: Outcome, weights: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the weighted sum of terms, shape (lanes,); `HOPELESS` where it is not finite.

    Args:
        outcome: What the lanes did.
        weights: Weight of each term, by name.
    """
    total = np.zeros(len(outcome.goal))
    for name, weight in weights.items():
        total += weight * _TERMS[name](outcome)
    return np.where(np.isfinite(total), total, HOPELESS)
