"""How a run went: a line for each generation in progress.jsonl."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robolamp.errors import FileError
from robolamp.files import parse_json, read_text, write_atomic

NAME = "progress.jsonl"
"""The file's name in a run's folder."""


@dataclass(frozen=True)
class Generation:
    """The results of a generation or of an iteration of tuning: a line of progress.jsonl.

    Attributes:
        stage: "evolution" or "tuning".
        generation: Its number in that stage, from 0.
        best_fitness: Fitness of its best individual, at this generation's phase.
        best_whole: Fitness of the same individual at full phase.
        champion_fitness: The best fitness at full phase so far in the run; while tuning, and where cases are drawn
            anew, of this iteration or generation.
        adjusted_fitness: 1 / (1 + best_fitness): best_fitness is raw and standardized fitness in one, 0 is perfect
            (Koza 1992, section 6.3; Kwasnicka & Wozniak, equation 1). None in runs of before it was written.
        normalized_fitness: That as a share of the sum over the individuals that were tried on all cases (equation 2).
        mean_fitness: Mean over the individuals that were tried on all cases.
        hits: Cases hit by the best.
        hits_1997: Cases in which the best came within 1.5 cm of the goal.
        falls: Cases in which the best fell.
        cases: Number of cases.
        hops: Hops of the best, mean over cases.
        flight_share: Flight share of the best, mean over cases.
        nodes: Nodes of the best.
        mean_nodes: Nodes of an individual, on average.
        individuals: Individuals examined so far.
        tried: Trials (an individual on a case) simulated so far ...
        cached: ... taken over from an identical program ...
        inherited: ... taken over from a mother that acts alike ...
        stopped: ... and not made, because the individual was certain to lose (or was screened out).
        physics_steps: Simulated steps so far.
        physics_s: Wall time inside trials so far [s].
        wall_s: Wall time so far [s].
    """

    stage: str
    generation: int
    best_fitness: float
    best_whole: float
    champion_fitness: float
    mean_fitness: float
    hits: int
    hits_1997: int
    falls: int
    cases: int
    hops: float
    flight_share: float
    nodes: int
    mean_nodes: float
    individuals: int
    tried: int
    cached: int
    inherited: int
    stopped: int
    physics_steps: int
    physics_s: float
    wall_s: float
    adjusted_fitness: float | None = None
    normalized_fitness: float | None = None


@dataclass(frozen=True)
class Result:
    """The result of a run.

    Attributes:
        controller: The controller file it wrote.
        best_fitness: Of that controller, at full phase.
        generations: Every generation, and every iteration of tuning.
    """

    controller: Path
    best_fitness: float
    generations: tuple[Generation, ...]


def write_progress(history: Sequence[Generation], folder: Path) -> None:
    """Write a run's progress, atomically.

    Raises:
        FileError: It cannot be written.
    """
    write_atomic(folder / NAME, "".join(json.dumps(vars(entry)) + "\n" for entry in history))


def read_progress(folder: Path, lines: int) -> list[Generation]:
    """Read the first lines of a run's progress.

    Args:
        folder: The run's folder.
        lines: How many.

    Raises:
        FileError: The file is missing, too short or damaged.
    """
    path = folder / NAME
    written = read_text(path).splitlines()[:lines]
    try:
        history = [Generation(**parse_json(line, f"line {row}")) for row, line in enumerate(written, 1)]
    except (FileError, TypeError) as error:
        raise FileError(f"is damaged: {error}", str(path)) from None
    if len(history) < lines:
        raise FileError(f"has {len(history)} lines; expected {lines} at least, by the run's checkpoint", str(path))
    return history
