"""Lanes: what many runs gave, joined and picked, and how runs are dealt out to threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from robolamp.twin.trace import Trace


class Lanes:
    """A dataclass whose fields are arrays over lanes, shape (lanes, ..), and a trace, which may be missing."""

    trace: Trace | None

    @classmethod
    def join(cls, outcomes: Sequence[Self]) -> Self:
        """Return the lanes of all outcomes, one after the other; their traces, too, if all have one."""
        arrays = {name: np.concatenate([getattr(each, name) for each in outcomes]) for name in _arrays(cls)}
        traces = [outcome.trace for outcome in outcomes if outcome.trace is not None]
        return _made(cls, arrays, Trace.join(traces) if len(traces) == len(outcomes) else None)

    def take(self, lanes: NDArray[np.int64]) -> Self:
        """Return some lanes, in that order, without their traces."""
        return _made(type(self), {name: getattr(self, name)[lanes] for name in _arrays(type(self))}, None)


def _made(kind: Any, arrays: dict[str, NDArray[Any]], trace: Trace | None) -> Any:
    return kind(**arrays, trace=trace)


def _arrays(kind: Any) -> list[str]:
    return [item.name for item in fields(kind) if item.name != "trace"]


Outcomes = TypeVar("Outcomes", bound=Lanes)


def joined(outcomes: Sequence[Outcomes]) -> Outcomes:
    """Return the lanes of outcomes of one kind, one after the other; see `Lanes.join`."""
    return type(outcomes[0]).join(outcomes)


def deal(count: int, workers: int, work: Callable[[slice], tuple[Outcomes, int]]) -> tuple[Outcomes, int]:
    """Run lanes on threads.

    Args:
        count: How many lanes.
        workers: How many threads at most.
        work: Runs some of the lanes; returns their outcomes and the physics steps they took.

    Returns:
        All outcomes, in the order of the lanes, without traces; and all physics steps.
    """
    # Dealt out in turn: neighbours are often of one program, and fall, or do not, together.
    workers = min(workers, count)
    shares = [slice(first, None, workers) for first in range(workers)]
    if len(shares) == 1:
        results = [work(shares[0])]
    else:
        with ThreadPoolExecutor(len(shares)) as pool:
            results = list(pool.map(work, shares))
    dealt = np.concatenate([np.arange(count)[share] for share in shares])
    outcomes = [outcome for outcome, _ in results]
    return joined(outcomes).take(np.argsort(dealt)), sum(steps for _, steps in results)
