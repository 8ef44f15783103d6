"""Checkpoints: everything that a run needs to continue, in one JSON file that is replaced as a whole."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.expression import parse
from robolamp.errors import ExpressionError, FileError
from robolamp.evolve.representations.representation import Representation
from robolamp.evolve.representations.tree import Genome
from robolamp.files import MOST_LOG, parse_json, read_text, write_atomic

NAME = "checkpoint.json"
"""The file's name in a run's folder."""
STAGES = ("evolution", "tuning", "done")
"""What a run does, one after the other."""
_SCHEMA = 1


@dataclass
class Checkpoint:
    """A run between two generations, or between two iterations of tuning.

    Attributes:
        stage: "evolution", "tuning" or "done".
        generation: The next one to be evaluated.
        population: Its individuals: genotypes, as are all individuals here but those of `known` and `traced`.
        mothers: For each individual the index in `parents` of the one it has most from; -1: none.
        parents: What the population was bred from.
        promise: What fitness is expected of each individual.
        known: `MEASURES` on every case of the programs that are remembered, by key.
        traced: Programs whose runs are remembered: made again when the run goes on.
        champion: The best individual so far; None while there is none.
        champion_fitness: Its fitness at full phase; infinite while there is none.
        fitness: Fitness of the controller on disk, on `cases`.
        controller: Text of its file.
        cases: The last drawn: goal [m], lamp, time to take [s] and direction [rad] of each.
        candidates: The best of each generation, where cases are drawn anew for each.
        told: Fitnesses of each iteration of tuning.
        totals: Running totals: individuals, physics steps, seconds, trials.
        lines: Lines of progress.jsonl.
        rng: States of the random generators, by name.
    """

    stage: str = "evolution"
    generation: int = 0
    population: list[Any] = field(default_factory=list)
    mothers: list[int] = field(default_factory=list)
    parents: list[Any] = field(default_factory=list)
    promise: list[float] = field(default_factory=list)
    known: dict[Genome, NDArray[np.float64]] = field(default_factory=dict)
    traced: list[Genome] = field(default_factory=list)
    champion: Any = None
    champion_fitness: float = float("inf")
    fitness: float = float("inf")
    controller: str = ""
    cases: list[tuple[float, int, float, float]] = field(default_factory=list)
    candidates: list[Any] = field(default_factory=list)
    told: list[list[float]] = field(default_factory=list)
    totals: dict[str, float] = field(default_factory=dict)
    lines: int = 0
    rng: dict[str, Any] = field(default_factory=dict)


def _texts(genome: Genome) -> list[str]:
    return [str(part) for part in genome]


def save_checkpoint(checkpoint: Checkpoint, folder: Path, representation: Representation[Any]) -> None:
    """Write a checkpoint, atomically.

    Args:
        checkpoint: The run.
        folder: The run's folder.
        representation: Writes its individuals.

    Raises:
        FileError: It cannot be written; the one before is whole.
    """
    data = dict(vars(checkpoint))
    for name in ("population", "parents", "candidates"):
        data[name] = [representation.dump(genotype) for genotype in data[name]]
    data["traced"] = [_texts(genome) for genome in checkpoint.traced]
    data["champion"] = None if checkpoint.champion is None else representation.dump(checkpoint.champion)
    data["known"] = [[_texts(genome), values.tolist()] for genome, values in checkpoint.known.items()]
    write_atomic(folder / NAME, json.dumps({"schema": _SCHEMA, **data}))


def _check(checkpoint: Checkpoint) -> None:
    if checkpoint.stage not in STAGES:
        raise ValueError(f"stage {checkpoint.stage!r} is not one of {', '.join(STAGES)}")
    lengths = {len(checkpoint.population), len(checkpoint.mothers), len(checkpoint.promise)}
    if checkpoint.stage == "evolution" and lengths != {len(checkpoint.population)}:
        raise ValueError(f"population, mothers and promise are of lengths {sorted(lengths)}; expected one length")
    if checkpoint.stage == "evolution" and not checkpoint.population:
        raise ValueError("its population is empty")
    if any(not -1 <= mother < len(checkpoint.parents) for mother in checkpoint.mothers):
        raise ValueError("a mother is not among the parents")
    if checkpoint.stage != "evolution" and checkpoint.champion is None:
        raise ValueError("its champion is missing")


def load_checkpoint(folder: Path, terminals: Sequence[str], representation: Representation[Any]) -> Checkpoint:
    """Read a checkpoint.

    Args:
        folder: The run's folder.
        terminals: What its genomes may read.
        representation: Reads its individuals.

    Raises:
        FileError: There is none, or it is damaged.
    """
    path = folder / NAME
    text = read_text(path, MOST_LOG)

    def genome(texts: Sequence[str]) -> Genome:
        return tuple(parse(part, terminals, str(path)) for part in texts)

    try:
        data: Mapping[str, Any] = parse_json(text, str(path))
    except FileError as error:
        raise FileError(f"is damaged: {error.message}", str(path)) from None
    try:
        if data["schema"] != _SCHEMA:
            raise FileError(f"schema {data['schema']!r} is not {_SCHEMA}", str(path))
        fields = {name: data[name] for name in Checkpoint.__dataclass_fields__}
        for name in ("population", "parents", "candidates"):
            fields[name] = [representation.load(texts, str(path)) for texts in fields[name]]
        fields["traced"] = [genome(texts) for texts in fields["traced"]]
        if fields["champion"] is not None:
            fields["champion"] = representation.load(fields["champion"], str(path))
        fields["known"] = {genome(texts): np.array(values) for texts, values in fields["known"]}
        fields["promise"] = [float(value) for value in fields["promise"]]
        fields["cases"] = [(float(goal), int(lamp), *map(float, rest)) for goal, lamp, *rest in fields["cases"]]
        checkpoint = Checkpoint(**fields)
        _check(checkpoint)
        return checkpoint
    except (ValueError, OverflowError, KeyError, TypeError, AttributeError, ExpressionError) as error:
        raise FileError(f"is damaged: {type(error).__name__}: {error}", str(path)) from None
