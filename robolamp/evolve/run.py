"""A run of genetic programming, from a task and a seed to a controller file (Koza 1992; Gritz & Hahn 1997, section 3.4)."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.controller.file import Controller, save_controller
from robolamp.errors import FileError
from robolamp.evolve.selection import tournament
from robolamp.evolve.task import Task
from robolamp.evolve.tree import Breeder, Genome
from robolamp.evolve.trial import Score, Trials, draw_cases
from robolamp.evolve.tune import tune
from robolamp.files import write_atomic
from robolamp.lamp import Lamp
from robolamp.twin.fleet import Fleet
from robolamp.twin.model import build
from robolamp.twin.spread import load_spread

_LAMPS = 24  # drawn from the spread for a run, besides the calibrated one


@dataclass(frozen=True)
class Generation:
    """What a generation came to: a line of progress.jsonl.

    Attributes:
        generation: Its number, from 0; -1 for an iteration of tuning.
        best_fitness: Fitness of its best individual, at this generation's phase.
        mean_fitness: Mean over the individuals.
        hits: Cases hit by the best.
        falls: Cases in which the best fell.
        cases: Number of cases.
        hops: Hops of the best, mean over cases.
        flight_share: Flight share of the best, mean over cases.
        nodes: Nodes of the best.
        individuals: Individuals examined so far.
        physics_steps: Simulated steps so far.
        physics_s: Wall time inside trials so far [s].
        wall_s: Wall time so far [s].
    """

    generation: int
    best_fitness: float
    mean_fitness: float
    hits: int
    falls: int
    cases: int
    hops: float
    flight_share: float
    nodes: int
    individuals: int
    physics_steps: int
    physics_s: float
    wall_s: float


@dataclass(frozen=True)
class Result:
    """What a run came to.

    Attributes:
        controller: The controller file it wrote.
        best_fitness: Of the champion, at full phase.
        generations: Every generation.
    """

    controller: Path
    best_fitness: float
    generations: tuple[Generation, ...]


def evolve(
    task: Task,
    lamp: Lamp,
    calibration: Calibration,
    assets: Assets,
    folder: Path,
    *,
    seed: int,
    workers: int | None = None,
    seeds: Sequence[Controller] = (),
    tuning: int = 0,
    command: str = "",
    progress: Callable[[Generation], None] = lambda _: None,
) -> Result:
    """Evolve a controller.

    Fitness is main + sqrt(g / G) style (Gritz & Hahn 1997, section 3.5), the mean over fitness cases that are drawn once.

    Args:
        task: What to evolve.
        lamp: The lamp.
        calibration: The twin's numbers.
        assets: Where data files are.
        folder: The run's folder: progress.jsonl and controller.toml go there.
        seed: Where all randomness comes from; the same seed gives the same run at any number of workers.
        workers: Threads; None: one a core.
        seeds: Controllers to put into the first generation.
        tuning: Iterations of CMA-ES on the champion's constants, at the end.
        command: The command line, kept in the controller file.
        progress: Called after each generation.

    Raises:
        FileError: The folder holds a run already, or cannot be written.
    """
    lines = folder / "progress.jsonl"
    if lines.exists():
        raise FileError("holds a run already; give another folder with -o", str(folder))
    began = time.perf_counter()
    born, chosen, drawn, tuned = np.random.SeedSequence(seed).spawn(4)
    rng, cases_rng = np.random.default_rng(chosen), np.random.default_rng(drawn)
    spread = load_spread(assets)
    lamps = [build(lamp, calibration, assets)]
    if task.cases.lamps > 1:
        lamps += [build(lamp, calibration, assets, spread.draw(cases_rng, len(lamp.joints))) for _ in range(_LAMPS)]
    fleet = Fleet(lamps, task.control_period, workers)
    terminals = task.terminals(len(lamp.joints))
    trials = Trials(fleet, task, terminals)
    cases = draw_cases(cases_rng, task, len(lamps))
    breeder = Breeder(task, terminals, len(lamp.joints))
    gp = task.gp
    population = [controller.expressions for controller in seeds]
    population += breeder.population(np.random.default_rng(born), gp.population - len(population))
    history: list[Generation] = []
    examined, physics = 0, 0.0

    def note(generation: int, phase: float, genomes: Sequence[Genome], score: Score) -> int:
        fitness = score.main + phase * score.style
        best = int(np.argmin(fitness))
        entry = Generation(
            generation=generation,
            best_fitness=float(fitness[best]),
            mean_fitness=float(fitness.mean()),
            hits=int(score.hits[best]),
            falls=int(score.falls[best]),
            cases=len(cases),
            hops=float(score.hops[best]),
            flight_share=float(score.flight_share[best]),
            nodes=sum(len(part.tokens) for part in genomes[best]),
            individuals=examined,
            physics_steps=fleet.steps,
            physics_s=round(physics, 3),
            wall_s=round(time.perf_counter() - began, 3),
        )
        history.append(entry)
        write_atomic(lines, "".join(json.dumps(vars(item)) + "\n" for item in history))
        progress(entry)
        return best

    champion, champion_fitness = population[0], math.inf
    for generation in range(gp.generations):
        before = time.perf_counter()
        score = trials.score(population, cases)
        physics += time.perf_counter() - before
        examined += len(population)
        best = note(generation, math.sqrt(generation / gp.generations), population, score)
        whole = score.main + score.style  # champions are compared at full phase
        best = best if whole[best] <= whole.min() else int(np.argmin(whole))
        if whole[best] < champion_fitness:
            champion, champion_fitness = population[best], float(whole[best])
        if generation + 1 < gp.generations:
            fitness = score.main + math.sqrt(generation / gp.generations) * score.style
            population = _next(rng, breeder, task, population, fitness)
    if tuning:

        def tuned_once(iteration: int, fitness: float) -> None:
            last = history[-1]
            now = round(time.perf_counter() - began, 3)
            progress(replace(last, generation=-1 - iteration, best_fitness=fitness, wall_s=now))

        before = time.perf_counter()
        candidate = tune(champion, trials, task, len(lamps), tuning, int(tuned.generate_state(1)[0]), tuned_once)
        score = trials.score([candidate], cases)
        physics += time.perf_counter() - before
        champion, champion_fitness = candidate, float((score.main + score.style)[0])
    score = trials.score([champion], cases)
    controller = Controller(
        name=folder.name,
        task=task.name,
        drive="position",
        control_period=task.control_period,
        expressions=champion,
        joints=lamp.names,
        scores={
            "fitness": round(champion_fitness, 6),
            "hits": int(score.hits[0]),
            "falls": int(score.falls[0]),
            "cases": len(cases),
            "flight_share": round(float(score.flight_share[0]), 3),
        },
        provenance={
            "command": command,
            "seed": seed,
            "generations": gp.generations,
            "tuning": tuning,
            "calibration": calibration.name,
            "calibration_sha256": calibration.hash,
            "versions": {name: version(name) for name in ("robolamp", "mujoco", "numpy", "numba")},
        },
    )
    save_controller(controller, folder / "controller.toml")
    return Result(folder / "controller.toml", champion_fitness, tuple(history))


def _next(
    rng: np.random.Generator, breeder: Breeder, task: Task, population: Sequence[Genome], fitness: np.ndarray
) -> list[Genome]:
    gp = task.gp

    def parent() -> Genome:
        return population[tournament(rng, fitness, gp.tournament)]

    children: list[Genome] = []
    while len(children) < gp.population:
        choice = rng.random()
        if choice < gp.crossover:
            children += breeder.crossover(rng, parent(), parent())
        elif choice < gp.crossover + gp.mutation:
            children.append(breeder.mutate_constants(rng, parent()))
        else:
            children.append(parent())
    return children[: gp.population]
