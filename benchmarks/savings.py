"""Physics steps of a run against the paper's plain M x G x Nfc trials of full length, for the same best-of-run fitness.

Known programs are not simulated again, children that act like their mother take over its run, and individuals that are
certain to lose are stopped; a lamp that has fallen is not simulated further either. None of this changes the result:
`--check` runs the first seed once more with all of it off, and compares the champions.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.file import load_controller
from robolamp.evolve.run import Generation, evolve
from robolamp.evolve.task import Task, load_task
from robolamp.lamp import load_lamp
from robolamp.twin.model import build

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)


def run(task: Task, seed: int, workers: int | None, reuse: bool) -> tuple[tuple[str, ...], float, Generation]:
    """Evolve; return the champion's expressions, its fitness, and the last generation's figures."""
    with tempfile.TemporaryDirectory() as folder:
        result = evolve(task, LAMP, CALIBRATION, ASSETS, Path(folder) / "run", seed=seed, workers=workers, reuse=reuse)
        champion = load_controller(result.controller, LAMP)
        return tuple(map(str, champion.expressions)), result.best_fitness, result.generations[-1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="luxo-1997")
    parser.add_argument("--population", type=int, default=150)
    parser.add_argument("--generations", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any other key of the task")
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--check", action="store_true", help="run the first seed plainly too; takes minutes")
    options = parser.parse_args()
    sizes = [f"gp.population={options.population}", f"gp.generations={options.generations}"]
    task = load_task(ASSETS, options.task, len(LAMP.joints), [*sizes, *options.set])
    steps = round(task.duration / build(LAMP, CALIBRATION, ASSETS, timestep=task.timestep).timestep)
    trials = task.gp.population * task.gp.generations * task.cases.count * task.cases.lamps
    plain = trials * steps
    print(f"{task.name}: M = {task.gp.population}, G = {task.gp.generations}, {trials:,} trials of {steps:,} steps")
    kinds = ("tried", "cached", "inherited", "stopped")
    print(f"{'seed':<8} {'fitness':>8} {'steps/plain':>12} " + " ".join(f"{kind:>10}" for kind in kinds) + f" {'s':>7}")
    ratios, shares, first = [], [], None
    for seed in range(1, options.seeds + 1):
        champion, fitness, last = run(task, seed, options.workers, reuse=True)
        first = first or (champion, fitness, last)
        ratios.append(last.physics_steps / plain)
        shares.append([getattr(last, kind) / trials for kind in kinds])
        told = " ".join(f"{share:>10.1%}" for share in shares[-1])
        print(f"{seed:<8} {fitness:>8.4f} {ratios[-1]:>12.3f} {told} {last.wall_s:>7.0f}", flush=True)
    told = " ".join(f"{share:>10.1%}" for share in np.median(shares, axis=0))
    print(f"{'median':<8} {'':>8} {np.median(ratios):>12.3f} {told}    (worst seed {max(ratios):.3f})")
    if options.check and first is not None:
        champion, fitness, last = run(task, 1, options.workers, reuse=False)
        same = (champion, fitness) == first[:2]
        print(f"seed 1 with everything simulated: fitness {fitness:.4f}, {last.wall_s:.0f} s,", end=" ")
        print(f"{last.physics_steps / plain:.3f} of plain (a fall ends a trial)")
        print("the same champion" if same else "ANOTHER CHAMPION", end=", ")
        print(f"for {first[2].physics_steps / last.physics_steps:.3f} of these steps")
        if not same:
            raise SystemExit(1)


if __name__ == "__main__":
    main()
