"""`robolamp evolve`: a controller from a task."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from robolamp.cli.options import Setup
from robolamp.cli.output import print_json
from robolamp.controller.file import check_terminals
from robolamp.errors import FileError
from robolamp.evolve.run import Generation, Run
from robolamp.evolve.task import load_task

_Count = Annotated[int | None, Parameter(validator=validators.Number(gte=1))]


def evolve(
    task: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    seed: Annotated[int, Parameter(validator=validators.Number(gte=0))] = 1,
    population: _Count = None,
    generations: _Count = None,
    seed_from: str | None = None,
    tune: Annotated[int, Parameter(validator=validators.Number(gte=0))] = 0,
    workers: _Count = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Evolve a controller on the twin and write it to OUTPUT/controller.toml.

    Parameters
    ----------
    task
        What to evolve: a file, or the name of a shipped task (hop).
    output
        Folder of the run; must not hold one already.
    seed
        Where all randomness comes from: the same seed gives the same run.
    population
        Individuals a generation, instead of the task's.
    generations
        Generations, instead of the task's.
    seed_from
        A controller (file or name) for the first generation to begin with, instead of the task's; none: from nothing.
    tune
        Iterations of CMA-ES on the constants of the best controller, at the end.
    workers
        Threads; without it, one a core.
    calibration
        The twin's numbers: a file, or a name in calibration/.
    lamp
        A folder of your own lamp, laid out like robolamp's (sim/, hardware/, calibration/).
    as_json
        Print one JSON object instead of progress and prose.
    """
    setup = Setup.of(lamp, calibration)
    loaded = load_task(setup.assets, task)
    gp = replace(
        loaded.gp,
        population=population or loaded.gp.population,
        generations=generations or loaded.gp.generations,
    )
    loaded = replace(loaded, gp=gp)
    names = loaded.seeds if seed_from is None else () if seed_from == "none" else (seed_from,)
    seeds = [setup.controller(name) for name in names][: gp.population]
    for name, seeded in zip(names, seeds, strict=False):
        check_terminals(seeded, loaded.terminals(len(setup.lamp.joints)), f"seed {name}")
    try:
        blocked = output.exists() and not output.is_dir()
    except OSError as error:  # such as a name that is too long
        raise FileError(f"cannot be used: {error.strerror or error}", f"--output {output}") from None
    if blocked:
        raise FileError("is not a folder", f"--output {output}")
    console = Console(stderr=True, quiet=as_json)
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("left"), TimeRemainingColumn(), TextColumn("{task.fields[best]}"),
    )  # fmt: skip
    bar = Progress(*columns, console=console)
    row = bar.add_task("evolution", total=gp.generations + tune, best="")

    def show(entry: Generation) -> None:
        best = f"best {entry.best_fitness:.3f}, {entry.hits}/{entry.cases} hits, {entry.falls} falls"
        bar.update(row, advance=1, description=entry.stage, best=best)

    # Made before the bar appears: what it refuses is one line of its own.
    run = Run(
        loaded, setup.lamp, setup.calibration, setup.assets, output,
        seed, workers, shlex.join(["robolamp", *sys.argv[1:]]), show,
    )  # fmt: skip
    with bar:
        result = run.go(seeds, tune)
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
                "generations": gp.generations,
            }
        )
        return 0
    Console().print(
        f"Best fitness {result.best_fitness:.3f} after {last.individuals} individuals in {last.wall_s:.0f} s"
        f" ({last.physics_s / max(last.wall_s, 1e-9):.0%} of it physics).\n"
        f"Controller: {result.controller}\n"
        f"Next: robolamp score {result.controller}, or robolamp dry-run {result.controller} --goal 0.30",
        highlight=False, markup=False, soft_wrap=True,
    )  # fmt: skip
    return 0
