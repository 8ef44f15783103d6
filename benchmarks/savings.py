"""Physics steps of a run against the paper's plain M x G x Nfc trials of full length, for the same best-of-run fitness.

Known programs are not simulated again, children that act like their mother take over its run, and individuals that are
certain to lose are stopped; a lamp that has fallen is not simulated further either. None of this changes the result
("exact"): `--check` runs the first seed once more with all of it off, and compares the champions. "screened" runs try
most individuals on a few goals only, which gives another result: "as good at" is the share of the plain run's steps
after which its best individual was as good as the plain run's.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import load_controller
from robolamp.evolve.evolution import evolve
from robolamp.evolve.progress import Result
from robolamp.evolve.tasks.task import Task, load_task
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import build

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)


def run(task: Task, seed: int, workers: int | None, reuse: bool = True) -> tuple[tuple[str, ...], Result]:
    """Evolve; return the champion's expressions and the run's result."""
    with tempfile.TemporaryDirectory() as folder:
        result = evolve(task, LAMP, CALIBRATION, ASSETS, Path(folder) / "run", seed=seed, workers=workers, reuse=reuse)
        champion = load_controller(result.controller, LAMP)
        return tuple(map(str, champion.expressions)), result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="luxo-1997")
    parser.add_argument("--population", type=int, default=150)
    parser.add_argument("--generations", type=int, default=20)
    parser.add_argument("--screening", type=float, default=0.25)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any other key of the task")
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--check", action="store_true", help="run the first seed plainly too; takes minutes")
    options = parser.parse_args()
    sizes = [f"gp.population={options.population}", f"gp.generations={options.generations}", *options.set]
    task = load_task(ASSETS, options.task, len(LAMP.joints), sizes)
    screened = load_task(ASSETS, options.task, len(LAMP.joints), [*sizes, f"gp.screening={options.screening}"])
    steps = round(task.duration / build(LAMP, CALIBRATION, ASSETS, timestep=task.timestep).timestep)
    trials = task.gp.population * task.gp.generations * task.cases.count * task.cases.lamps
    plain = trials * steps
    print(f"{task.name}: M = {task.gp.population}, G = {task.gp.generations}, {trials:,} trials of {steps:,} steps")
    kinds = ("tried", "cached", "inherited", "stopped")
    head = f"{'seed':<6} {'':<10} {'fitness':>8} {'steps/plain':>12} {'as good at':>11} "
    print(head + " ".join(f"{kind:>10}" for kind in kinds) + f" {'s':>6}")
    table: dict[str, list[list[float]]] = {"exact": [], "screened": []}
    first = None
    for seed in range(1, options.seeds + 1):
        wanted = np.inf
        for name, each in (("exact", task), ("screened", screened)):
            champion, result = run(each, seed, options.workers)
            first = first or (champion, result)
            wanted = result.best_fitness if name == "exact" else wanted
            last = result.generations[-1]
            good = [entry.physics_steps for entry in result.generations if entry.champion_fitness <= wanted]
            row = [last.physics_steps / plain, good[0] / plain if good else np.inf]
            row += [getattr(last, kind) / trials for kind in kinds]
            table[name].append(row)
            told = " ".join(f"{share:>10.1%}" for share in row[2:])
            print(
                f"{seed:<6} {name:<10} {result.best_fitness:>8.4f} {row[0]:>12.3f} {row[1]:>11.3f} {told}"
                f" {last.wall_s:>6.0f}",
                flush=True,
            )
    for name, rows in table.items():
        middle = np.median(rows, axis=0)
        told = " ".join(f"{share:>10.1%}" for share in middle[2:])
        print(f"median {name:<10} {'':>8} {middle[0]:>12.3f} {middle[1]:>11.3f} {told}")
    if options.check and first is not None:
        champion, result = run(task, 1, options.workers, reuse=False)
        same = (champion, result.best_fitness) == (first[0], first[1].best_fitness)
        last = result.generations[-1]
        print(f"seed 1 with everything simulated: fitness {result.best_fitness:.4f}, {last.wall_s:.0f} s,", end=" ")
        print(f"{last.physics_steps / plain:.3f} of plain (a fall ends a trial)")
        print("the same champion" if same else "ANOTHER CHAMPION", end=", ")
        print(f"for {first[1].generations[-1].physics_steps / last.physics_steps:.3f} of these steps")
        if not same:
            raise SystemExit(1)


if __name__ == "__main__":
    main()
