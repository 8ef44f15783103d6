"""The fleet: many lamps, or figures, at once, each lane with its own program, goal and (if wanted) its own bent body.

A worker thread for each core owns its share of the lanes, so that no barrier is met inside a tick. Results are the same
to the bit for any number of workers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.kernels import command_lanes
from robolamp.controller.program import Program, ProgramSet
from robolamp.errors import RobolampError
from robolamp.figure import Driven
from robolamp.twin.engine import Variants, deal
from robolamp.twin.figure_model import FigureTwin, Twin
from robolamp.twin.judges.key_poses import KeyPose
from robolamp.twin.judges.run_outcome import RunOutcome
from robolamp.twin.lanes.figure_lanes import FigureRuns
from robolamp.twin.lanes.lamp_lanes import LampRuns
from robolamp.twin.lanes.lane_runs import Job, Runs, RunSettings
from robolamp.twin.trace import Trace

_LANES_AT_ONCE = 6000  # about 67 MB of simulation state


class Fleet:
    """Many lamps, or figures, that can be run again and again.

    Args:
        twins: The lamps or the figures (variants of one model); their MuJoCo models differ in numbers only.
        period: Control period [s], a whole number of physics steps.
        workers: Threads; None: one for each core.

    Attributes:
        steps: Physics steps taken so far, of all lanes together.

    Raises:
        RobolampError: The period is not a whole number of physics steps.
    """

    def __init__(self, twins: Sequence[Twin], period: float, workers: int | None = None) -> None:
        timestep = twins[0].timestep
        if abs(period - round(period / timestep) * timestep) > 1e-9:
            raise RobolampError(
                f"{period:g} s is not a whole number of physics steps of {timestep:g} s", "control_period"
            )
        self.twins = list(twins)
        self.period = period
        self.steps = 0
        self._workers = workers
        self._driven: Driven = twins[0].driven
        self._kind: Any = FigureRuns if isinstance(twins[0], FigureTwin) else LampRuns
        self._variants = Variants([twin.model for twin in twins])
        self._states = np.stack([self._kind.start(twin) for twin in twins])

    def run(
        self,
        programs: Sequence[Program],
        jobs: Sequence[Job],
        duration: float,
        *,
        poses: Sequence[KeyPose] = (),
        record: bool = False,
        done: Callable[[float], None] = lambda _share: None,
    ) -> RunOutcome:
        """Run every job to its end and judge it.

        Args:
            programs: The controllers, all over the same terminals.
            jobs: The lanes.
            duration: Length of each run [s].
            poses: Poses that every lamp is compared with; one that ended before is judged on its last angles.
            record: Keep what the controllers saw and sent: `RunOutcome.trace`, 8 bytes a number.
            done: Called at each tick with the share that is done, 0 to 1, from one thread or several.

        Returns:
            The outcomes, in the order of the jobs: `Outcome` of lamps, `FigureOutcome` of figures.
        """
        if not jobs:
            raise ValueError("no jobs to run")
        compiled = ProgramSet(programs)
        read = frozenset(compiled.terminals) if record else compiled.read
        settings = RunSettings(compiled.terminals, self.period, duration, poses, read)
        trace = None
        if record:
            ticks, joints = round(duration / self.period), len(self._driven.joints)
            trace = Trace.blank(len(jobs), ticks, len(compiled.terminals), joints)
        outcomes, count = [], len(jobs)
        for first in range(0, count, _LANES_AT_ONCE):
            part = jobs[first : first + _LANES_AT_ONCE]
            own = None if trace is None else trace.take(slice(first, first + len(part)))  # a view, to be written to

            def done_here(share: float, before: int = first, lanes: int = len(part)) -> None:
                done((before + share * lanes) / count)

            outcomes.append(self._together(compiled, part, settings, own, done_here))
        return RunOutcome.join(outcomes, trace=trace)

    def play(self, job: Job, goals: NDArray[np.float64], ticks: int) -> NDArray[np.float64]:
        """Return the positions of a lane that is sent goals: to the bit those of the run that they are from.

        Args:
            job: The lane; its program is not asked.
            goals: Goals as sent, tick by tick (`Trace.goals` of a lane), shape (k, n); the last one is kept up.
            ticks: How many control periods to play.

        Returns:
            MuJoCo positions at the start of each tick and at the end, shape (ticks + 1, nq); 0 for what turns without
            being seen.
        """
        runs = self._runs([job], RunSettings((), self.period, ticks * self.period))
        lane, qpos = np.zeros(1, np.int64), [runs.lanes.qpos[0].copy()]
        for tick in range(ticks):
            runs.advance(goals[None, min(tick, len(goals) - 1)], lane)
            qpos.append(runs.lanes.qpos[0].copy())
        shown = np.stack(qpos)
        shown[:, runs.unseen] = 0.0
        return shown

    def _runs(self, jobs: Sequence[Job], settings: RunSettings) -> Runs:
        return self._kind(self.twins, self._variants, self._states, jobs, settings)

    def _together(
        self,
        programs: ProgramSet,
        jobs: Sequence[Job],
        settings: RunSettings,
        trace: Trace | None,
        done: Callable[[float], None],
    ) -> RunOutcome:
        """Run jobs at once."""

        def work(share: slice) -> tuple[RunOutcome, int]:
            runs = self._runs(jobs[share], settings)
            program = np.array([job.program for job in jobs[share]], np.int64)
            own = None if trace is None else trace.take(share)
            return self._control(runs, programs, program, settings, own, done), runs.lanes.steps

        results, order = deal(len(jobs), self._workers, work)
        self.steps += sum(steps for _, steps in results)
        return RunOutcome.join([outcome for outcome, _ in results], order)

    def _control(
        self,
        runs: Runs,
        programs: ProgramSet,
        program: NDArray[np.int64],
        settings: RunSettings,
        trace: Trace | None,
        done: Callable[[float], None],
    ) -> RunOutcome:
        """Let programs drive lanes; the outcome leaves the trace to the caller, whose it is."""
        driven, period, lanes = self._driven, settings.period, len(program)
        lower, upper, step = driven.lower, driven.upper, driven.slew * period
        wanted, sent = np.zeros((lanes, len(lower))), np.zeros((lanes, len(lower)))
        interventions, alive = np.zeros(lanes, np.int64), np.arange(lanes)
        run = programs.arguments(program, runs.inputs, wanted)
        bound = wanted, sent, lower, upper, step, interventions
        for tick in range(round(settings.duration / period)):
            done(tick * period / settings.duration)
            runs.sense(tick * period)
            command_lanes(alive, run, bound)
            if trace is not None:
                trace.record(alive, runs.inputs, sent)
            runs.advance(sent, alive)
            alive = runs.survivors(tick * period)
            if not len(alive):
                break
        return runs.outcome(interventions)
