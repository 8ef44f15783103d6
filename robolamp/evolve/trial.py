"""Trials: genomes on a fleet of lamps, over a task's cases, to fitness."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.program import Program, compile_program
from robolamp.evolve.representations.tree import Genome
from robolamp.evolve.tasks.fitness import weighted
from robolamp.evolve.tasks.fitness_cases import poisson_disk, poisson_disk_plane
from robolamp.evolve.tasks.task import Task
from robolamp.figure import Figure
from robolamp.twin.judges.key_poses import KeyPose
from robolamp.twin.judges.run_outcome import RunOutcome
from robolamp.twin.lanes.fleet import Job
from robolamp.twin.trace import Trace

_TRACE_AT_ONCE = 250e6  # bytes of what controllers saw and sent

MEASURES = ("main", "style", "hit", "hit_1997", "fallen", "hops", "flight_share")
"""What is kept of a trial, in this order; NaN where a trial was not made."""
MAIN, STYLE, HIT, HIT_1997, FALLEN, HOPS, FLIGHT_SHARE = range(len(MEASURES))


class Evaluator(Protocol):
    """What can run programs on lamps: a fleet in this process, or a cluster of them."""

    steps: int
    """Physics steps so far."""

    def run(
        self,
        programs: Sequence[Program],
        jobs: Sequence[Job],
        duration: float,
        *,
        poses: Sequence[KeyPose] = (),
        record: bool = False,
    ) -> RunOutcome:
        """Run every job to its end; see `robolamp.twin.lanes.fleet.Fleet.run`."""
        ...


@dataclass(frozen=True)
class Case:
    """One goal on one lamp.

    Attributes:
        goal: [m].
        lamp: Index of the fleet's lamp.
        goal_time: Time commanded for the way [s]; 0: none is.
        direction: Of a figure's goal, from x towards y [rad]; the lamp's are ahead.
    """

    goal: float
    lamp: int
    goal_time: float = 0.0
    direction: float = 0.0


def draw_cases(rng: np.random.Generator, task: Task, lamps: int) -> list[Case]:
    """Draw a task's fitness cases: its goals, each on the calibrated lamp and on others of the fleet.

    Args:
        rng: Where randomness comes from.
        task: How many goals, where, on how many lamps.
        lamps: Lamps of the fleet; the first is the calibrated one.
    """
    if isinstance(task.figure, Figure):
        plane = poisson_disk_plane(
            rng, task.cases.count, (task.cases.low, task.cases.high), task.cases.direction, task.cases.spacing
        )
        return [Case(float(goal), 0, direction=float(direction)) for goal, direction in plane]
    goals = poisson_disk(rng, task.cases.count, task.cases.low, task.cases.high, task.cases.spacing)
    cases = []
    for goal in goals:
        others = 1 + rng.permutation(lamps - 1)[: task.cases.lamps - 1] if lamps > 1 else []
        limit = float(rng.uniform(*task.cases.goal_time)) if task.cases.goal_time else 0.0
        cases += [Case(float(goal), int(lamp), limit) for lamp in (0, *others)]
    return cases


@dataclass(frozen=True)
class TrialScore:
    """Fitness of genomes; arrays have shape (genomes,).

    Attributes:
        main: Mean of the main terms over the cases.
        style: Mean of the style terms.
        hits: Cases at rest within 1.5 cm of the goal, upright, at the end.
        hits_1997: Cases that came within 1.5 cm of the goal.
        falls: Cases that ended in a fall.
        hops: Mean number of hops.
        flight_share: Mean share of the travel in flight (0 where nothing travelled).
    """

    main: NDArray[np.float64]
    style: NDArray[np.float64]
    hits: NDArray[np.int64]
    hits_1997: NDArray[np.int64]
    falls: NDArray[np.int64]
    hops: NDArray[np.float64]
    flight_share: NDArray[np.float64]

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> TrialScore:
        """Return the score of trials.

        Args:
            values: `MEASURES` of every case, shape (genomes, cases, 7).
        """
        mean = values.mean(axis=1)
        counts = values[:, :, [HIT, HIT_1997, FALLEN]].sum(axis=1).astype(np.int64)
        return cls(
            main=mean[:, MAIN],
            style=mean[:, STYLE],
            hits=counts[:, 0],
            hits_1997=counts[:, 1],
            falls=counts[:, 2],
            hops=mean[:, HOPS],
            flight_share=mean[:, FLIGHT_SHARE],
        )


class Trials:
    """Tries genomes.

    Attributes:
        seconds: Wall time spent in trials so far [s].
        evaluator: The lamps.

    Args:
        evaluator: The lamps.
        task: Weights and duration.
        terminals: What genomes may read.
    """

    def __init__(self, evaluator: Evaluator, task: Task, terminals: Sequence[str]) -> None:
        self.seconds = 0.0
        self.evaluator = evaluator
        self._task = task
        self._terminals = terminals

    def program(self, genome: Genome) -> Program:
        """Return a genome's program."""
        return compile_program(genome, self._terminals)

    def measure(
        self, genomes: Sequence[Genome], cases: Sequence[Case], pairs: NDArray[np.int64], *, record: bool = False
    ) -> Iterator[tuple[slice, NDArray[np.float64], Trace | None]]:
        """Try genomes on cases; where they are recorded, as many at once as memory is good for.

        Args:
            genomes: The controllers.
            cases: Goals and lamps.
            pairs: Which genome on which case, shape (k, 2).
            record: Whether to keep what the controllers saw and sent.

        Yields:
            Which of the pairs, their `MEASURES` (shape (m, 7)), and their trace.
        """
        task, at_once = self._task, max(len(pairs), 1)
        if record:
            width = len(self._terminals) + len(genomes[0])
            lane = 8.0 * width * task.duration / task.control_period
            at_once = max(1, int(_TRACE_AT_ONCE / lane))
        for start in range(0, len(pairs), at_once):
            began = time.perf_counter()
            part = slice(start, min(start + at_once, len(pairs)))
            used, index = np.unique(pairs[part, 0], return_inverse=True)
            programs = [self.program(genomes[genome]) for genome in used]
            jobs = [
                Job(int(program), cases[case].lamp, cases[case].goal, cases[case].goal_time, cases[case].direction)
                for program, case in zip(index, pairs[part, 1], strict=True)
            ]
            outcome = self.evaluator.run(programs, jobs, task.duration, poses=task.poses, record=record)
            values = np.empty((len(jobs), len(MEASURES)))
            values[:, MAIN] = weighted(outcome, task.main)
            values[:, STYLE] = weighted(outcome, task.style)
            values[:, HIT] = outcome.hit
            values[:, HIT_1997] = outcome.hit_1997
            values[:, FALLEN] = outcome.fallen
            values[:, HOPS] = outcome.hops
            values[:, FLIGHT_SHARE] = np.nan_to_num(outcome.flight_share)
            self.seconds += time.perf_counter() - began
            yield part, values, outcome.trace

    def table(self, genomes: Sequence[Genome], cases: Sequence[Case]) -> NDArray[np.float64]:
        """Try every genome on every case; identical genomes are tried once.

        Args:
            genomes: The controllers.
            cases: Goals and lamps.

        Returns:
            Their `MEASURES`, shape (genomes, cases, 7).
        """
        unique = list(dict.fromkeys(genomes))
        pairs = np.stack(np.divmod(np.arange(len(unique) * len(cases)), len(cases)), axis=1)
        values = np.concatenate([values for _, values, _ in self.measure(unique, cases, pairs)])
        place = {genome: index for index, genome in enumerate(unique)}
        values = values.reshape(len(unique), len(cases), len(MEASURES))
        return values[[place[genome] for genome in genomes]]

    def score(self, genomes: Sequence[Genome], cases: Sequence[Case]) -> TrialScore:
        """Return the score of every genome, tried on every case; see `table`."""
        return TrialScore.of(self.table(genomes, cases))
