"""A run of genetic programming: from a task and a seed to a controller file (Gritz & Hahn 1997, section 3.4)."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.controller.file import Controller, save_controller, slug
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

_LAMPS = 24  # at least, drawn from the spread for a run besides the calibrated one
_JUDGED = 4  # fresh sets of cases that decide whether tuning was for the better


@dataclass(frozen=True)
class Generation:
    """What a generation, or an iteration of tuning, came to: a line of progress.jsonl.

    Attributes:
        stage: "evolution" or "tuning".
        generation: Its number in that stage, from 0.
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

    stage: str
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
        generations: Every generation, and every iteration of tuning.
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

    Fitness is main + sqrt(g / G) style (Gritz & Hahn 1997, section 3.5), the mean over fitness cases drawn once a run.

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
        progress: Called after each generation and each iteration of tuning.

    Raises:
        RobolampError: See `Run`.
    """
    return Run(task, lamp, calibration, assets, folder, seed, workers, command, progress).go(seeds, tuning)


class Run:
    """A run that can go: its lamps built, its cases drawn, its folder claimed. For the arguments see `evolve`.

    Raises:
        FileError: The folder holds a run already, or cannot be written.
        RobolampError: The task asks for what cannot be: goals that do not fit, a period the physics cannot keep.
    """

    def __init__(
        self,
        task: Task,
        lamp: Lamp,
        calibration: Calibration,
        assets: Assets,
        folder: Path,
        seed: int,
        workers: int | None,
        command: str,
        progress: Callable[[Generation], None],
    ) -> None:
        if (folder / "progress.jsonl").exists() or (folder / "controller.toml").exists():
            raise FileError("holds a run already; give another folder with -o", str(folder))
        self._began = time.perf_counter()
        self._task, self._lamp, self._calibration, self._folder = task, lamp, calibration, folder
        self._seed, self._command, self._progress = seed, command, progress
        # One stream for each use, so that a change in one does not shift the others.
        born, chosen, drawn, tuned = np.random.SeedSequence(seed).spawn(4)
        self._born, self._chosen = np.random.default_rng(born), np.random.default_rng(chosen)
        self._drawn, self._tuned = np.random.default_rng(drawn), int(tuned.generate_state(1)[0])
        joints = len(lamp.joints)
        lamps = [build(lamp, calibration, assets)]
        if task.cases.lamps > 1:
            spread = load_spread(assets)
            others = max(_LAMPS, task.cases.lamps - 1)
            lamps += [build(lamp, calibration, assets, spread.draw(self._drawn, joints)) for _ in range(others)]
        self._lamps = len(lamps)
        self._fleet = Fleet(lamps, task.control_period, workers)
        self._terminals = task.terminals(joints)
        self._trials = Trials(self._fleet, task, self._terminals)
        self._cases = draw_cases(self._drawn, task, self._lamps)
        self._history: list[Generation] = []
        self._examined = 0
        write_atomic(folder / "progress.jsonl", "")

    def go(self, seeds: Sequence[Controller], tuning: int) -> Result:
        """Evolve, then tune; the champion so far is on disk after each of the two.

        Args:
            seeds: Controllers to put into the first generation.
            tuning: Iterations of CMA-ES on the champion's constants, at the end.
        """
        champion = self._evolve(seeds)
        fitness = self._save(champion, 0)
        if tuning:

            def tuned_once(iteration: int, genomes: Sequence[Genome], score: Score) -> None:
                self._note("tuning", iteration, score.main + score.style, genomes, score)

            tuned = tune(champion, self._trials, self._task, self._lamps, tuning, self._tuned, tuned_once)
            fresh = [case for _ in range(_JUDGED) for case in draw_cases(self._drawn, self._task, self._lamps)]
            score = self._trials.score([champion, tuned], fresh)
            if np.argmin(score.main + score.style) == 1:
                fitness = self._save(tuned, tuning)
        return Result(self._folder / "controller.toml", fitness, tuple(self._history))

    def _evolve(self, seeds: Sequence[Controller]) -> Genome:
        gp = self._task.gp
        breeder = Breeder(self._task, self._terminals, len(self._lamp.joints))
        population = [controller.expressions for controller in seeds]
        population += breeder.population(self._born, gp.population - len(population))
        champion, champion_fitness = population[0], math.inf
        for generation in range(gp.generations):
            score = self._trials.score(population, self._cases)
            whole = score.main + score.style  # champions are compared at full phase
            best = int(np.argmin(whole))
            if whole[best] < champion_fitness:
                champion, champion_fitness = population[best], float(whole[best])
            fitness = score.main + math.sqrt(generation / gp.generations) * score.style
            self._note("evolution", generation, fitness, population, score)
            if generation + 1 < gp.generations:
                population = _next(self._chosen, breeder, self._task, population, fitness)
        return champion

    def _note(
        self, stage: str, generation: int, fitness: NDArray[np.float64], genomes: Sequence[Genome], score: Score
    ) -> None:
        best = int(np.argmin(fitness))
        self._examined += len(genomes)
        entry = Generation(
            stage=stage,
            generation=generation,
            best_fitness=float(fitness[best]),
            mean_fitness=float(fitness.mean()),
            hits=int(score.hits[best]),
            falls=int(score.falls[best]),
            cases=len(self._cases),
            hops=float(score.hops[best]),
            flight_share=float(score.flight_share[best]),
            nodes=sum(len(part.tokens) for part in genomes[best]),
            individuals=self._examined,
            physics_steps=self._fleet.steps,
            physics_s=round(self._trials.seconds, 3),
            wall_s=round(time.perf_counter() - self._began, 3),
        )
        self._history.append(entry)
        text = "".join(json.dumps(vars(item)) + "\n" for item in self._history)
        write_atomic(self._folder / "progress.jsonl", text)
        self._progress(entry)

    def _save(self, champion: Genome, tuning: int) -> float:
        """Write the controller file; return its fitness on the run's cases."""
        score = self._trials.score([champion], self._cases)
        fitness = float(score.main[0] + score.style[0])
        controller = Controller(
            name=slug(self._folder.resolve().name),
            task=self._task.name,
            drive="position",
            control_period=self._task.control_period,
            expressions=champion,
            joints=self._lamp.names,
            scores={
                "fitness": round(fitness, 6),
                "hits": int(score.hits[0]),
                "falls": int(score.falls[0]),
                "cases": len(self._cases),
                "flight_share": round(float(score.flight_share[0]), 3),
            },
            provenance={
                "command": self._command,
                "seed": self._seed,
                "generations": self._task.gp.generations,
                "tuning": tuning,
                "calibration": self._calibration.name,
                "calibration_sha256": self._calibration.hash,
                "versions": {name: version(name) for name in ("robolamp", "mujoco", "numpy", "numba")},
            },
        )
        save_controller(controller, self._folder / "controller.toml")
        return fitness


def _next(
    rng: np.random.Generator, breeder: Breeder, task: Task, population: Sequence[Genome], fitness: NDArray[np.float64]
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
