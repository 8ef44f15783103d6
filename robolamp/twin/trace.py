"""Traces: what controllers saw and sent, tick by tick, and which other controllers would have sent the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.kernels import bound_lanes
from robolamp.controller.program import Program, ProgramSet
from robolamp.figure import Driven


@dataclass(frozen=True)
class Trace:
    """What each lane's controller saw and sent.

    Attributes:
        inputs: Terminal values in the programs' order, shape (lanes, ticks, terminals); 0 after a lane's end.
        goals: Goals as sent, after the envelope, shape (lanes, ticks, joints) [rad]; 0 after a lane's end.
        ticks: How many ticks each lane ran, shape (lanes,): fewer than the others where it fell.
    """

    inputs: NDArray[np.float64]
    goals: NDArray[np.float64]
    ticks: NDArray[np.int64]

    @classmethod
    def blank(cls, lanes: int, ticks: int, terminals: int, joints: int) -> Trace:
        """Return room for a recording.

        Args:
            lanes: Number of lanes.
            ticks: Most ticks that a lane can run.
            terminals: Number of terminals.
            joints: Number of joints.
        """
        return cls(np.zeros((lanes, ticks, terminals)), np.zeros((lanes, ticks, joints)), np.zeros(lanes, np.int64))

    @classmethod
    def join(cls, traces: Sequence[Trace]) -> Trace:
        """Return the lanes of all traces, one after the other; they must agree in every other length."""
        return cls(
            np.concatenate([trace.inputs for trace in traces]),
            np.concatenate([trace.goals for trace in traces]),
            np.concatenate([trace.ticks for trace in traces]),
        )

    def take(self, lanes: NDArray[np.int64] | slice) -> Trace:
        """Return some lanes: views of them for a slice, copies for indices."""
        return Trace(self.inputs[lanes], self.goals[lanes], self.ticks[lanes])

    def record(self, lanes: NDArray[np.int64], inputs: NDArray[np.float64], goals: NDArray[np.float64]) -> None:
        """Write the next tick of some lanes, which must all have run equally many.

        Args:
            lanes: Which of them still run, shape (k,).
            inputs: Of all lanes, shape (lanes, terminals).
            goals: Of all lanes, shape (lanes, joints) [rad].
        """
        tick = self.ticks[lanes[0]]
        self.inputs[lanes, tick] = inputs[lanes]
        self.goals[lanes, tick] = goals[lanes]
        self.ticks[lanes] += 1


def follows(
    programs: Sequence[Program], program: NDArray[np.int64], trace: Trace, lamp: Driven, period: float
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Tell which programs would have sent, to the bit, what was sent on a recorded lane.

    What a lamp does depends on the goals it is sent and on nothing else of its controller, and what a controller
    sends depends on what it sees. A program that answers every recorded input as the recorded one did meets the next
    input, too: its run on that lamp to that goal is the recorded run, without simulating it.

    Args:
        programs: The controllers, compiled for the terminals that were recorded.
        program: Which of them is asked about on each lane, shape (lanes,).
        trace: The recorded lanes.
        lamp: The lamp, or the figure, they were recorded on: its limits make the envelope.
        period: Control period [s].

    Returns:
        Whether it follows, shape (lanes,); and what the envelope would have changed of what it asks for
        (`Outcome.interventions`), shape (lanes,), 0 where it does not follow.
    """
    compiled = ProgramSet(programs)
    count, joints = len(trace.ticks), len(lamp.joints)
    same, interventions = np.ones(count, bool), np.zeros(count, np.int64)
    lanes = np.arange(count)
    limits = lamp.lower, lamp.upper, lamp.slew * period
    sent, changed = np.zeros((count, joints)), np.zeros(count, np.int64)
    for tick in range(trace.inputs.shape[1] + 1):
        ended = trace.ticks[lanes] <= tick
        if ended.any():
            interventions[lanes[ended]] = changed[ended]
            lanes, sent, changed = lanes[~ended], sent[~ended], changed[~ended]
        if not len(lanes):
            break
        wanted = compiled.run(program[lanes], trace.inputs[lanes, tick], np.empty((len(lanes), joints)))
        bound_lanes(np.arange(len(lanes)), wanted, sent, *limits, changed)
        # As bits: a goal of -0.0 is not one of 0.0, which a physics step might tell apart.
        agrees = (sent.view(np.int64) == trace.goals[lanes, tick].view(np.int64)).all(axis=1)
        if not agrees.all():
            same[lanes[~agrees]] = False
            lanes, sent, changed = lanes[agrees], sent[agrees], changed[agrees]
    return same, interventions
