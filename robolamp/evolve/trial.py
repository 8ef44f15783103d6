"""Trials: genomes on a fleet of lamps, over a task's cases, to fitness."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.program import compile_program
from robolamp.evolve.cases import poisson_disk
from robolamp.evolve.fitness import weighted
from robolamp.evolve.task import Task
from robolamp.evolve.tree import Genome
from robolamp.twin.fleet import Fleet, Job

_LANES_AT_ONCE = 6000  # about 67 MB of simulation state


@dataclass(frozen=True)
class Case:
    """One goal on one lamp.

    Attributes:
        goal: [m].
        lamp: Index of the fleet's lamp.
    """

    goal: float
    lamp: int


def draw_cases(rng: np.random.Generator, task: Task, lamps: int) -> list[Case]:
    """Draw a task's fitness cases: its goals, each on the calibrated lamp and on others of the fleet.

    Args:
        rng: Where randomness comes from.
        task: How many goals, where, on how many lamps.
        lamps: Lamps of the fleet; the first is the calibrated one.
    """
    goals = poisson_disk(rng, task.cases.count, task.cases.low, task.cases.high, task.cases.spacing)
    cases = []
    for goal in goals:
        others = 1 + rng.permutation(lamps - 1)[: task.cases.lamps - 1] if lamps > 1 else []
        cases += [Case(float(goal), int(lamp)) for lamp in (0, *others)]
    return cases


@dataclass(frozen=True)
class Score:
    """Fitness of genomes; arrays have shape (genomes,).

    Attributes:
        main: Mean of the main terms over the cases.
        style: Mean of the style terms.
        hits: Cases at rest within 1.5 cm of the goal, upright, at the end.
        falls: Cases that ended in a fall.
        hops: Mean number of hops.
        flight_share: Mean share of the travel in flight (0 where nothing travelled).
    """

    main: NDArray[np.float64]
    style: NDArray[np.float64]
    hits: NDArray[np.int64]
    falls: NDArray[np.int64]
    hops: NDArray[np.float64]
    flight_share: NDArray[np.float64]


class Trials:
    """Tries genomes; identical genomes are tried once.

    Attributes:
        seconds: Wall time spent in trials so far [s].

    Args:
        fleet: The lamps.
        task: Weights and duration.
        terminals: What genomes may read.
    """

    def __init__(self, fleet: Fleet, task: Task, terminals: Sequence[str]) -> None:
        self.seconds = 0.0
        self._fleet = fleet
        self._task = task
        self._terminals = terminals

    def score(self, genomes: Sequence[Genome], cases: Sequence[Case]) -> Score:
        """Try every genome on every case.

        Args:
            genomes: The controllers.
            cases: Goals and lamps.
        """
        began = time.perf_counter()
        unique = list(dict.fromkeys(genomes))
        columns: list[list[NDArray[Any]]] = [[] for _ in range(6)]
        batch = max(1, _LANES_AT_ONCE // len(cases))
        for start in range(0, len(unique), batch):
            part = unique[start : start + batch]
            programs = [compile_program(genome, self._terminals) for genome in part]
            jobs = [Job(index, case.lamp, case.goal) for index in range(len(part)) for case in cases]
            outcome = self._fleet.run(programs, jobs, self._task.duration)
            shape = (len(part), len(cases))
            values = (
                weighted(outcome, self._task.main).reshape(shape).mean(axis=1),
                weighted(outcome, self._task.style).reshape(shape).mean(axis=1),
                outcome.hit.reshape(shape).sum(axis=1),
                outcome.fallen.reshape(shape).sum(axis=1),
                outcome.hops.reshape(shape).mean(axis=1),
                np.nan_to_num(outcome.flight_share).reshape(shape).mean(axis=1),
            )
            for column, value in zip(columns, values, strict=True):
                column.append(value)
        self.seconds += time.perf_counter() - began
        place = {genome: index for index, genome in enumerate(unique)}
        index = np.array([place[genome] for genome in genomes])
        main, style, hits, falls, hops, flight_share = (np.concatenate(column)[index] for column in columns)
        return Score(main, style, hits, falls, hops, flight_share)
