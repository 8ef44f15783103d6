"""A run of genetic programming: from a task and a seed to a controller file (Gritz & Hahn 1997, section 3.4)."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration, load_calibration
from robolamp.controller.controller_file import Controller, format_controller, slug
from robolamp.errors import FileError, RobolampError
from robolamp.evolve.breeding import choose, represent
from robolamp.evolve.checkpoint import NAME as CHECKPOINT
from robolamp.evolve.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from robolamp.evolve.controller_origin import marks, origin_of
from robolamp.evolve.platform import differences, machine
from robolamp.evolve.progress import NAME as PROGRESS
from robolamp.evolve.progress import Generation, Result, read_progress, write_progress
from robolamp.evolve.race import Contest, Memory, Race, fitness
from robolamp.evolve.representations.tree import Genome
from robolamp.evolve.run_record import NAME as RECORD
from robolamp.evolve.run_record import check_unchanged, read_record, write_record
from robolamp.evolve.selection import adjusted, normalized
from robolamp.evolve.tasks.fitness import load_terms
from robolamp.evolve.tasks.task import Task, load_task, parse_task
from robolamp.evolve.tasks.task_twins import compiled, driven_by
from robolamp.evolve.trial import Case, Evaluator, Trials, TrialScore, draw_cases
from robolamp.evolve.tune import tune
from robolamp.figure import LAMP
from robolamp.files import alone, sha256, write_atomic
from robolamp.lamp import Lamp, load_lamp
from robolamp.twin.figure_model import Twin
from robolamp.twin.lamp_model import fingerprint
from robolamp.twin.lanes.fleet import Fleet

CONTROLLER = "controller.toml"
"""The best controller so far, in a run's folder."""
TASK = "task.toml"
"""The task as it is run, in a run's folder."""
_JUDGED = 4  # fresh sets of cases that decide between candidates, where cases are drawn anew, and whether tuning paid
_COUNTS = ("tried", "cached", "inherited", "stopped")
_STREAMS = ("born", "chosen", "drawn", "tuned", "bred")

MakeEvaluator = Callable[[Sequence[Twin], float], Evaluator]
"""Takes a run's lamps and its control period [s]."""


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
    terms: Path | None = None,
    evaluator: MakeEvaluator | None = None,
    reuse: bool = True,
    progress: Callable[[Generation], None] = lambda _: None,
) -> Result:
    """Evolve a controller.

    Fitness is main + sqrt(g / G) style (Gritz & Hahn 1997, section 3.5), the mean over fitness cases. The same task
    and seed give the same result on one kind of processor with the same versions, at any number of workers.

    Args:
        task: What to evolve.
        lamp: The lamp.
        calibration: The twin's numbers.
        assets: Where data files are.
        folder: The run's folder.
        seed: Where all randomness comes from.
        workers: Threads; None: one a core.
        seeds: Controllers to put into the first generation.
        tuning: Iterations of CMA-ES on the champion's constants, at the end.
        command: The command line, kept in the controller file.
        terms: The Python file with fitness terms of one's own that the task uses (already loaded), kept in the run.
        evaluator: What runs the lamps instead of a fleet of `workers` threads.
        reuse: Without, everything is simulated, also what is known or certain to lose: for checking.
        progress: Called after each generation and each iteration of tuning.

    Raises:
        FileError: The folder holds a run already, or cannot be written.
        RobolampError: The task asks for what cannot be: goals that do not fit, a period the physics cannot keep.
    """
    if parse_task(task.source, len(lamp.joints), task.name, assets) != task:
        raise ValueError(
            "a task that is not what its source says cannot be resumed: change it by load_task's overrides"
        )
    record = {
        "seed": seed,
        "tuning": tuning,
        "command": command,
        "reuse": reuse,
        "seeds": marks(seeds),
        "task_sha256": hashlib.sha256(task.source.encode()).hexdigest(),
        "lamp": "" if assets.own is None else str(assets.own.resolve()),
        "terms": "" if terms is None else str(terms.resolve()),
        "terms_sha256": "" if terms is None else sha256(terms),
    }
    if isinstance(task.figure, str):  # others live in the simulation alone: the lamp's numbers have no part in them
        record |= {"calibration": str(calibration.path.resolve()), "calibration_sha256": calibration.hash}
    drive = driven_by(task, lamp).drive
    for seeded in seeds:
        if seeded.control_period != task.control_period:
            periods = f"{seeded.control_period:g} s; the task's is {task.control_period:g} s"
            raise RobolampError(f"has a control period of {periods}", f"seed {seeded.name}")
        if seeded.drive != drive:
            raise RobolampError(f"drives by {seeded.drive}; the task's drive is {drive}", f"seed {seeded.name}")
    _refuse_taken(folder)
    run = Run(task, lamp, calibration, assets, folder, record, workers, evaluator, progress)
    run.draw(seeds)
    with alone(folder):
        _refuse_taken(folder)
        run.begin()
        return run.go()


def _refuse_taken(folder: Path) -> None:
    # What was stopped before its first checkpoint holds nothing to go on with: it may be begun again.
    unbegun = (folder / RECORD).exists() and not (folder / CHECKPOINT).exists()
    for name in (CHECKPOINT, CONTROLLER, *(() if unbegun else (RECORD, PROGRESS, TASK))):
        if (folder / name).exists():
            message = f"holds a run already ({name}); go on with --resume, or give another folder with -o"
            raise FileError(message, str(folder))


def resume(
    folder: Path,
    *,
    workers: int | None = None,
    evaluator: MakeEvaluator | None = None,
    progress: Callable[[Generation], None] = lambda _: None,
    warn: Callable[[str], None] = lambda _: None,
) -> Result:
    """Continue a stopped run from its last checkpoint: the result is, bit for bit, that of a run that was not stopped.

    Args:
        folder: The run's folder.
        workers: Threads; None: one a core.
        evaluator: What runs the lamps instead.
        progress: Called after each generation and each iteration of tuning.
        warn: Called with a line where the machine or its versions are not those the run began on.

    Raises:
        FileError: The folder holds no run, or what the run was made from has changed.
    """
    with open_run(folder, workers=workers, evaluator=evaluator, progress=progress, warn=warn) as run:
        return run.go()


@contextmanager
def open_run(
    folder: Path,
    *,
    workers: int | None = None,
    evaluator: MakeEvaluator | None = None,
    progress: Callable[[Generation], None] = lambda _: None,
    warn: Callable[[str], None] = lambda _: None,
) -> Iterator[Run]:
    """Open a run at its last checkpoint, and lock it against other processes; see `resume`."""
    record = read_record(folder)
    if not (folder / CHECKPOINT).exists():
        raise FileError("was stopped before its first checkpoint; begin it again with -o", str(folder))
    with alone(folder):
        yield _opened(folder, record, workers, evaluator, progress, warn)


def _opened(
    folder: Path,
    record: Mapping[str, Any],
    workers: int | None,
    evaluator: MakeEvaluator | None,
    progress: Callable[[Generation], None],
    warn: Callable[[str], None],
) -> Run:
    if record["terms"]:
        check_unchanged(Path(record["terms"]), record["terms_sha256"])
        load_terms(Path(record["terms"]))
    assets = Assets.of(record["lamp"] or None)
    lamp = load_lamp(assets)
    check_unchanged(folder / TASK, record["task_sha256"])
    task = load_task(assets, folder / TASK, len(lamp.joints))
    if isinstance(task.figure, str) and "calibration" not in record:
        raise FileError("calibration: missing", str(folder / RECORD))
    calibration = load_calibration(assets, record.get("calibration", "nominal"))
    if "calibration" in record:
        check_unchanged(calibration.path, record["calibration_sha256"])
    for line in differences(machine(), {"where the run began": record["machine"]}):
        warn(f"results may differ in the last bit: {line}")
    run = Run(task, lamp, calibration, assets, folder, record, workers, evaluator, progress)
    run.restore()
    return run


class Run:
    """A run that is ready to go, its lamps built. For the arguments see `evolve`; `record` is what run.toml holds."""

    def __init__(
        self,
        task: Task,
        lamp: Lamp,
        calibration: Calibration,
        assets: Assets,
        folder: Path,
        record: Mapping[str, Any],
        workers: int | None,
        evaluator: MakeEvaluator | None,
        progress: Callable[[Generation], None],
    ) -> None:
        self._began = time.perf_counter()
        self._task, self._calibration, self._folder = task, calibration, folder
        self._lamp = driven = driven_by(task, lamp)
        self._record, self._progress = dict(record), progress
        # One stream for each use, so that a change in one does not shift the others.
        streams = dict(zip(_STREAMS, np.random.SeedSequence(record["seed"]).spawn(len(_STREAMS)), strict=True))
        self._tuning_seed = int(streams.pop("tuned").generate_state(1)[0])
        self._rng = {name: np.random.default_rng(stream) for name, stream in streams.items()}
        lamps = compiled(task, lamp, calibration, assets, self._rng["drawn"])
        self._lamps = len(lamps)
        self._twin = fingerprint(lamps)
        make = evaluator or (lambda twins, period: Fleet(twins, period, workers))
        self._evaluator = make(lamps, task.control_period)
        self._terminals = task.terminals(driven)
        self._representation = represent(task, self._terminals, driven.names)
        self._trials = Trials(self._evaluator, task, self._terminals)
        self._cases = draw_cases(self._rng["drawn"], task, self._lamps)
        self._history: list[Generation] = []
        self._state = Checkpoint()
        self._memory = Memory()

    def draw(self, seeds: Sequence[Controller]) -> None:
        """Draw the first generation.

        Args:
            seeds: Controllers that it begins with.

        Raises:
            ExpressionError: One does not fit into the task's representation.
        """
        own, rng = self._representation, self._rng["born"]
        population = [own.seeded(rng, controller.expressions, f"seed {controller.name}") for controller in seeds]
        population += own.population(rng, self._task.gp.population - len(population))
        self._state.population = population
        self._state.mothers = [-1] * len(population)
        self._state.promise = [0.0] * len(population)

    def begin(self) -> None:
        """Lock the folder and write what was drawn."""
        write_record({**self._record, "twin_sha256": self._twin}, self._folder)
        write_atomic(self._folder / TASK, self._task.source)
        write_progress((), self._folder)
        self._checkpoint()

    def restore(self) -> None:
        """Go back to the last checkpoint."""
        if self._record["twin_sha256"] != self._twin:
            message = "the lamp or figure (description, model, or spread.toml) is not the one the run began with"
            raise FileError(message, str(self._folder / RECORD))
        self._state = state = load_checkpoint(self._folder, self._terminals, self._representation)
        self._history = read_progress(self._folder, state.lines)
        self._cases = [Case(*case) for case in state.cases]
        try:
            for name, stream in self._rng.items():
                stream.bit_generator.state = state.rng[name]
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(f"is damaged: random generators: {error}", str(self._folder / CHECKPOINT)) from None
        # The runs of parents are not stored but made again: physics is deterministic.
        if state.traced:
            race = Race(
                self._trials, self._cases, self._lamp, self._task.control_period,
                state.traced, [None] * len(state.traced), Memory(),
            )  # fmt: skip
            race.all()
            self._memory = race.remember(state.traced)
        self._memory.values = state.known
        if state.controller:
            write_atomic(self._folder / CONTROLLER, state.controller)
        totals = state.totals
        self._began = time.perf_counter() - totals.get("wall_s", 0.0)
        self._trials.seconds = totals.get("physics_s", 0.0)
        self._evaluator.steps = int(totals.get("physics_steps", 0))

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""
        return self._state.stage == "done"

    @property
    def history(self) -> tuple[Generation, ...]:
        """The generations so far, and the iterations of tuning."""
        return tuple(self._history)

    @property
    def stages(self) -> tuple[int, int]:
        """How many generations, and iterations of tuning, the whole run has."""
        return self._task.gp.generations, self._record["tuning"]

    def go(self) -> Result:
        """Evolve, then tune, from where the run stands; after each generation the champion so far is on disk."""
        state = self._state
        while state.stage == "evolution":
            self._generation()
            if state.generation >= self._task.gp.generations:
                if self._task.cases.fresh:
                    self._judge_candidates()
                state.stage = "tuning" if self._record["tuning"] else "done"
                state.population, state.known, state.traced, self._memory = [], {}, [], Memory()
            self._checkpoint()
        if state.stage == "tuning":
            self._tune()
        return Result(self._folder / CONTROLLER, state.fitness, self.history)

    def _generation(self) -> None:
        state, task, gp = self._state, self._task, self._task.gp
        last = state.generation + 1 == gp.generations
        phase = math.sqrt(state.generation / gp.generations)
        if task.cases.fresh:
            self._cases = draw_cases(self._rng["drawn"], task, self._lamps)
        own = self._representation
        plan = None if last else own.plan(self._rng["chosen"])
        population = [own.decode(genotype) for genotype in state.population]
        mothers = [None if mother < 0 else own.decode(state.parents[mother]) for mother in state.mothers]
        reuse = bool(self._record["reuse"])
        race = Race(
            self._trials, self._cases, self._lamp, task.control_period, population, mothers, self._memory,
            reuse=reuse, record=not last and not task.cases.fresh,
        )  # fmt: skip
        tournaments = np.zeros((0, 1), np.int64) if plan is None else plan.tournaments
        if gp.screening < 1.0:
            race.screen(gp.screening, phase, state.generation)
        elif reuse and gp.early_stop and gp.selection == "tournament" and tournaments is not None:
            bar = math.inf if task.cases.fresh else state.champion_fitness
            race.race(Contest(tournaments, phase, bar), np.array(state.promise))
        else:
            race.all()
        values, complete = race.values, race.complete
        whole = np.where(complete, fitness(values, 1.0), np.inf)
        best = int(np.argmin(whole))
        if task.cases.fresh or whole[best] < state.champion_fitness:
            state.champion, state.champion_fitness = state.population[best], float(whole[best])
            if task.cases.fresh:
                state.candidates.append(state.champion)
            self._save(state.champion, TrialScore.of(values[best : best + 1]))
        for name in _COUNTS:
            state.totals[name] = int(state.totals.get(name, 0)) + getattr(race.counts, name)
        self._note("evolution", state.generation, phase, population, values, complete)
        if plan is not None:
            current = fitness(values, phase)
            elites = np.argsort(np.where(complete, current, np.inf), kind="stable")[: plan.elites]
            chosen = np.concatenate([elites, choose(self._rng["chosen"], gp, plan, values, phase)])
            state.parents = [state.population[index] for index in chosen]
            state.population, state.mothers = own.breed(self._rng["bred"], plan, state.parents, gp.population)
            state.promise = [float(current[chosen[mother]]) for mother in state.mothers]
            if not task.cases.fresh:
                self._memory = race.remember([population[index] for index in chosen])
                state.known, state.traced = self._memory.values, list(self._memory.lanes)
        state.generation += 1

    def _judge_candidates(self) -> None:
        """Choose between the best of each generation, which met different cases, on cases that none of them met."""
        candidates = list(dict.fromkeys(self._state.candidates))
        phenotypes = [self._representation.decode(candidate) for candidate in candidates]
        score = self._trials.score(phenotypes, self._fresh())
        best = int(np.argmin(score.main + score.style))
        self._state.champion = candidates[best]
        self._save(candidates[best], self._trials.score([phenotypes[best]], self._cases))

    def _fresh(self) -> list[Case]:
        return [case for _ in range(_JUDGED) for case in draw_cases(self._rng["drawn"], self._task, self._lamps)]

    def _tune(self) -> None:
        state = self._state
        champion = self._representation.decode(state.champion)

        def tuned_once(iteration: int, genomes: Sequence[Genome], values: NDArray[np.float64]) -> None:
            state.told.append(fitness(values, 1.0).tolist())
            state.totals["tried"] = int(state.totals.get("tried", 0)) + values.shape[0] * values.shape[1]
            self._note("tuning", iteration, 1.0, genomes, values, np.ones(len(genomes), bool))
            self._checkpoint()

        tuned = tune(
            champion, self._trials, self._task, self._lamps, self._record["tuning"], self._tuning_seed,
            state.told, tuned_once,
        )  # fmt: skip
        finalists = [champion, *tuned]
        score = self._trials.score(finalists, self._fresh())
        best = int(np.argmin(score.main + score.style))
        if best > 0:
            better = self._representation.carrying(state.champion, finalists[best])
            self._save(better, self._trials.score([finalists[best]], self._cases), self._record["tuning"])
        state.stage = "done"
        self._checkpoint()

    def _checkpoint(self) -> None:
        state = self._state
        state.lines = len(self._history)
        state.cases = [(case.goal, case.lamp, case.goal_time, case.direction) for case in self._cases]
        state.rng = {name: stream.bit_generator.state for name, stream in self._rng.items()}
        state.totals |= {
            "physics_steps": self._evaluator.steps,
            "physics_s": self._trials.seconds,
            "wall_s": time.perf_counter() - self._began,
        }
        save_checkpoint(state, self._folder, self._representation)

    def _note(
        self,
        stage: str,
        generation: int,
        phase: float,
        genomes: Sequence[Genome],
        values: NDArray[np.float64],
        complete: NDArray[np.bool_],
    ) -> None:
        own = np.where(complete, fitness(values, phase), np.inf)
        best = int(np.argmin(own))
        score = TrialScore.of(values[best : best + 1])
        whole = float(fitness(values[best : best + 1], 1.0)[0])
        totals = self._state.totals
        totals["individuals"] = int(totals.get("individuals", 0)) + len(genomes)
        nodes = [sum(len(part.tokens) for part in genome) for genome in genomes]
        entry = Generation(
            stage=stage,
            generation=generation,
            best_fitness=float(own[best]),
            best_whole=whole,
            champion_fitness=self._state.champion_fitness if stage == "evolution" else whole,
            mean_fitness=float(own[complete].mean()),
            hits=int(score.hits[0]),
            hits_1997=int(score.hits_1997[0]),
            falls=int(score.falls[0]),
            cases=values.shape[1],
            hops=float(score.hops[0]),
            flight_share=float(score.flight_share[0]),
            nodes=nodes[best],
            mean_nodes=float(np.mean(nodes)),
            individuals=int(totals["individuals"]),
            **{name: int(totals.get(name, 0)) for name in _COUNTS},
            physics_steps=self._evaluator.steps,
            physics_s=round(self._trials.seconds, 3),
            wall_s=round(time.perf_counter() - self._began, 3),
            adjusted_fitness=float(adjusted(own[best])),
            normalized_fitness=float(normalized(own[complete])[np.argmin(own[complete])]),
        )
        self._history.append(entry)
        write_progress(self._history, self._folder)
        self._progress(entry)

    def _save(self, champion: Any, score: TrialScore, tuning: int = 0) -> None:
        """Write the controller file, with its score on the run's cases."""
        state = self._state
        state.fitness = float(score.main[0] + score.style[0])
        lamp = isinstance(self._task.figure, str)
        calibrated = {"calibration": self._calibration.name, "calibration_sha256": self._calibration.hash}
        expressions = self._representation.decode(champion)
        calibrated = calibrated if lamp else {"figure_sha256": self._twin}
        controller = Controller(
            name=slug(self._folder.resolve().name),
            task=self._task.name,
            drive=self._lamp.drive,
            control_period=self._task.control_period,
            expressions=expressions,
            joints=self._lamp.names,
            figure=LAMP if lamp else self._lamp.name,
            genome=self._representation.genes(champion),
            origin="" if self._record["seeds"] is None else origin_of(expressions, self._record["seeds"]),
            scores={
                "fitness": state.fitness,
                "hits": int(score.hits[0]),
                "hits_1997": int(score.hits_1997[0]),
                "falls": int(score.falls[0]),
                "cases": len(self._cases),
                "flight_share": round(float(score.flight_share[0]), 3),
            },
            provenance={
                "command": self._record["command"],
                "seed": self._record["seed"],
                "generations": self._task.gp.generations,
                "tuning": tuning,
                **calibrated,
                "versions": {name: version(name) for name in ("robolamp", "mujoco", "numpy", "numba")},
            },
        )
        state.controller = format_controller(controller)
        write_atomic(self._folder / CONTROLLER, state.controller)
