"""`robolamp evolve`: makes a controller from a task."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter, validators
from rich.console import Console

from robolamp.assets import Assets
from robolamp.cli.options import NOMINAL, Setup
from robolamp.cli.screen.evolve_progress import Board
from robolamp.cli.screen.output import print_json
from robolamp.controller.controller_file import check_terminals, read_figure
from robolamp.controller.terminals import TWIN_ONLY
from robolamp.errors import FileError, RobolampError
from robolamp.evolve.checkpoint import NAME as CHECKPOINT
from robolamp.evolve.evolution import MakeEvaluator, open_run
from robolamp.evolve.evolution import evolve as run_evolution
from robolamp.evolve.progress import Result
from robolamp.evolve.run_record import read_record
from robolamp.evolve.tasks.fitness import load_terms
from robolamp.evolve.tasks.task import load_task
from robolamp.evolve.tasks.task_twins import driven_by
from robolamp.figure import LAMP, Figure
from robolamp.files import read_toml
from robolamp.twin.figure_model import Twin

_Count = Annotated[int | None, Parameter(validator=validators.Number(gte=1))]
_Seed = Annotated[int | None, Parameter(validator=validators.Number(gte=0, lt=2**63))]
_Iterations = Annotated[int | None, Parameter(validator=validators.Number(gte=0, lte=100_000))]


def evolve(
    task: str | None = None,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    resume: Path | None = None,
    seed: _Seed = None,
    settings: Annotated[list[str] | None, Parameter(name="--set", negative="")] = None,
    representation: Literal["tree", "gep"] | None = None,
    population: _Count = None,
    generations: _Count = None,
    seed_from: str | None = None,
    tune: _Iterations = None,
    terms: Path | None = None,
    workers: _Count = None,
    cluster: str | None = None,
    calibration: str | None = None,
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Evolve a controller on the twin and write it to OUTPUT/controller.toml.

    Parameters
    ----------
    task
        What to evolve (goals, signals, fitness, search): a task file, or the name of a shipped one (hop).
    output
        Folder of the run; must not hold a run already.
    resume
        Instead of a task: folder of a run that was stopped. Continued, it gives the result of a run that never was.
    seed
        Seed of all randomness (1): the same seed gives the same run.
    settings
        A key of the task file to change, as --set gp.selection=lexicase; may be given again.
    representation
        How individuals (controllers of the population) are written: tree (genetic programming) or gep (genes, gene
        expression programming); short for --set gp.representation.
    population
        Individuals in each generation; short for --set gp.population.
    generations
        Number of generations; short for --set gp.generations.
    seed_from
        Controller (file or name) to begin with, instead of the task's; none: begin from nothing.
    tune
        Iterations of CMA-ES on the constants of the best controller, at the end (0).
    terms
        A Python file with fitness terms of your own that the task uses.
    workers
        Threads; by default one for each core.
    cluster
        Evaluate on a dask scheduler that is running already, as 10.0.0.2:8786.
    calibration
        Calibration, the twin's numbers: a file, or a name in calibration/ (nominal).
    lamp
        Folder of your own lamp, as `robolamp new` makes it.
    as_json
        Print one JSON object instead of progress and prose.
    """
    given = {
        "TASK": task, "--output": output, "--seed": seed, "--set": settings,
        "--representation": representation, "--population": population, "--generations": generations,
        "--seed-from": seed_from, "--tune": tune, "--terms": terms,
        "--calibration": calibration, "--lamp": lamp,
    }  # fmt: skip
    if cluster is not None and workers is not None:
        raise RobolampError("is for this machine; with --cluster the workers are the scheduler's", "--workers")
    console = Console(stderr=True, quiet=as_json, highlight=False)
    with ExitStack() as stack:
        evaluator = _cluster(cluster, console, stack) if cluster is not None else None
        if resume is not None:
            for name, value in given.items():
                if value is not None:
                    raise RobolampError("cannot be changed with --resume: a run keeps what it began with", name)
            board = Board(console)
            opened = open_run(
                resume, workers=workers, evaluator=evaluator, progress=board.show,
                warn=lambda line: _warn(console, line),
            )  # fmt: skip
            with _told_how_to_go_on(console, resume), opened as run:
                if run.finished:
                    console.print(f"{resume} is complete; nothing is left to do.", markup=False, soft_wrap=True)
                    result = run.go()
                else:
                    board.begin(*run.stages, run.history)
                    with board:
                        result = run.go()
        else:
            if task is None or output is None:
                missing = "TASK (a file, or the name of a shipped task)" if task is None else "--output FOLDER"
                raise RobolampError(f"needs {missing}, or --resume RUN", "robolamp evolve")
            if terms is not None:
                load_terms(terms)
            setup = Setup.of(lamp, calibration or "nominal")
            short = {
                "gp.representation": representation, "gp.population": population, "gp.generations": generations,
            }  # fmt: skip
            overrides = [*(settings or []), *(f"{key}={value}" for key, value in short.items() if value is not None)]
            joints = len(setup.lamp.joints)
            loaded = load_task(setup.assets, task, joints, overrides)
            if calibration is not None and isinstance(loaded.figure, Figure):
                raise RobolampError(f"is for the lamp alone; task {task} is for {loaded.figure.name}", "--calibration")
            names = loaded.seeds if seed_from is None else () if seed_from == "none" else (seed_from,)
            seeds = [setup.controller(name, driven=driven_by(loaded, setup.lamp)) for name in names][
                : loaded.gp.population
            ]
            for name, seeded in zip(names, seeds, strict=False):
                check_terminals(seeded, loaded.terminals(driven_by(loaded, setup.lamp)), f"seed {name}")
            _refuse_file(output)
            board = Board(console)
            board.begin(loaded.gp.generations, tune or 0)
            with _told_how_to_go_on(console, output), board:
                result = run_evolution(
                    loaded, setup.lamp, setup.calibration, setup.assets, output,
                    seed=1 if seed is None else seed, workers=workers, seeds=seeds, tuning=tune or 0,
                    command=shlex.join(["robolamp", *sys.argv[1:]]), terms=terms, evaluator=evaluator,
                    progress=board.show,
                )  # fmt: skip
    _tell(result, as_json)
    return 0


def _cluster(address: str, console: Console, stack: ExitStack) -> MakeEvaluator:
    from robolamp.evolve.cluster import Cluster
    from robolamp.evolve.platform import differences, machine

    def made(twins: Sequence[Twin], period: float) -> Cluster:
        cluster = stack.enter_context(Cluster(address, twins, period))
        for line in differences(machine(), cluster.machines()):
            _warn(console, f"results may differ in the last bit: {line}")
        return cluster

    return made


@contextmanager
def _told_how_to_go_on(console: Console, folder: Path) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        if (folder / CHECKPOINT).exists():
            words = shlex.join(["robolamp", "evolve", "--resume", str(folder)])
            console.print(f"Stopped. Go on with: {words}", markup=False, soft_wrap=True)
        raise


def _warn(console: Console, line: str) -> None:
    console.print(f"Warning: {line}", markup=False, soft_wrap=True)


def _refuse_file(output: Path) -> None:
    try:
        blocked = output.exists() and not output.is_dir()
    except OSError as error:  # such as a name that is too long
        raise FileError(f"cannot be used: {error.strerror or error}", f"--output {output}") from None
    if blocked:
        raise FileError("is not a folder", f"--output {output}")


def _words(record: Mapping[str, Any]) -> list[str]:
    """Return what gives another verb the lamp and the calibration of a run."""
    words = ["--lamp", record["lamp"]] if record["lamp"] else []
    nominal = Assets.of(record["lamp"] or None).path(f"calibration/{NOMINAL}.toml").resolve()
    if "calibration" in record and Path(record["calibration"]) != nominal:
        words += ["--calibration", record["calibration"]]
    return words


def _tell(result: Result, as_json: bool) -> None:
    last = result.generations[-1]
    if as_json:
        print_json(
            {
                "controller": result.controller,
                "best_fitness": result.best_fitness,
                "individuals": last.individuals,
                "physics_steps": last.physics_steps,
                "physics_s": last.physics_s,
                "wall_s": last.wall_s,
                "generations": sum(entry.stage == "evolution" for entry in result.generations),
            }
        )
        return
    made, film = (shlex.quote(str(path)) for path in (result.controller, result.controller.with_suffix(".gif")))
    own = "".join(f" {shlex.quote(word)}" for word in _words(read_record(result.controller.parent)))
    explain, dry_run, render = f"explain {made}", f"dry-run {made} --goal 0.30", f"render {made} -o {film}"
    if read_figure(result.controller) != LAMP:
        verbs = [render]
    elif set(read_toml(result.controller)["terminals"]) & set(TWIN_ONLY):
        verbs = [explain, render]  # dry-run refuses what nothing on the lamp measures
    else:
        verbs = [explain, dry_run]
    following = "".join(f"\n      robolamp {verb}{own}" for verb in verbs)
    Console().print(
        f"Best fitness {result.best_fitness:.3f} (lower is better) after {last.individuals} individuals in"
        f" {last.wall_s:.0f} s.\n"
        f"Controller: {result.controller}\n"
        f"Next: robolamp score {made}{own}{following}",
        highlight=False, markup=False, soft_wrap=True,
    )  # fmt: skip
