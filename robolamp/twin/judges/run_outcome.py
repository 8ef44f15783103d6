"""What runs gave, many at once: the lanes of an outcome joined and picked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from robolamp.twin.trace import Trace


@dataclass(frozen=True)
class RunOutcome:
    """What became of runs: `Outcome` tells of lamps, `FigureOutcome` of other figures.

    Both also tell `error`, `fallen`, `upright`, `hit`, `hit_1997` and `flight_share`. Every array has shape (lanes,)
    unless it says otherwise.

    Attributes:
        goal: Distance of the goal [m].
        duration: Time limit of the run [s].
        nearest: Smallest distance from the goal on the way [m].
        arrival: When it first came to its goal [s]; NaN if it did not.
        hops: Its hops, or jumps.
        tilt: Tilt at the end [rad].
        angles: Joint angles at the end, shape (lanes, n) [rad].
        unstable: The simulation diverged.
        interventions: What the envelope changed.
        trace: What the controllers saw and sent, where that was recorded.
    """

    goal: NDArray[np.float64]
    duration: NDArray[np.float64]
    nearest: NDArray[np.float64]
    arrival: NDArray[np.float64]
    hops: NDArray[np.float64]
    tilt: NDArray[np.float64]
    angles: NDArray[np.float64]
    unstable: NDArray[np.bool_]
    interventions: NDArray[np.int64]
    trace: Trace | None = field(default=None, kw_only=True)

    @classmethod
    def join(
        cls, outcomes: Sequence[RunOutcome], order: NDArray[np.int64] | slice = slice(None), trace: Trace | None = None
    ) -> Self:
        """Return the lanes of outcomes of one kind, one after the other.

        Args:
            outcomes: What to join.
            order: Which lanes of the whole, in which order.
            trace: Theirs; None: those of the outcomes, joined, if all have one.
        """
        kind: Any = type(outcomes[0])
        names = [item.name for item in fields(kind) if item.name != "trace"]
        arrays = {name: np.concatenate([getattr(each, name) for each in outcomes])[order] for name in names}
        traces = [each.trace for each in outcomes if each.trace is not None]
        if trace is None and len(traces) == len(outcomes):
            trace = Trace.join(traces).take(order)
        return kind(**arrays, trace=trace)
