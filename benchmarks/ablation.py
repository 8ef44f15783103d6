"""What pays when the hop is evolved: one ingredient changed at a time, as many individuals each, judged alike.

Every variant begins with the hand-written cycle (but for the one that begins with nothing) and is scored on goals and
lamps of the spread that no run has seen.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import Controller, load_controller
from robolamp.controller.terminals import all_terminals
from robolamp.evolve.evolution import evolve
from robolamp.evolve.tasks.task import load_task
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.fleet import Fleet, Job
from robolamp.twin.variation.random_lamps import LampLaw

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)
GOALS = np.linspace(0.05, 0.60, 28)
TUNED = 13  # individuals of an iteration of CMA-ES, about

# Settings of the task, share of the individuals that tuning gets, and whether the run begins with the cycle.
VARIANTS: dict[str, tuple[list[str], float, bool]] = {
    "the cycle as written": ([], 0.0, True),
    "tournament": ([], 0.0, True),
    "tournament, fresh cases": (["cases.fresh=true"], 0.0, True),
    "lexicase": (["gp.selection=lexicase"], 0.0, True),
    "lexicase, fresh cases": (["gp.selection=lexicase", "cases.fresh=true"], 0.0, True),
    "Pareto, fresh cases": (["gp.selection=pareto", "cases.fresh=true"], 0.0, True),
    "screening, fresh cases": (["gp.screening=0.25", "cases.fresh=true"], 0.0, True),
    "from nothing": ([], 0.0, False),
    "half lexicase fresh, half CMA-ES": (["gp.selection=lexicase", "cases.fresh=true"], 0.5, True),
    "CMA-ES alone": ([], 1.0, True),
}


def judged(controller: Controller, lamps: int) -> str:
    """Return a controller's row: hits, falls, median and 90th percentile of |error|, flight share."""
    rng, law = np.random.default_rng(2026), LampLaw(LAMP, CALIBRATION, ASSETS)
    drawn = [law.calibrated, *(law.draw(rng) for _ in range(lamps))]
    twins = [build(LAMP, numbers, ASSETS, bend) for numbers, bend in drawn]
    jobs = [Job(0, variant, float(goal)) for variant in range(len(twins)) for goal in GOALS]
    program = controller.compile(all_terminals(len(LAMP.joints)))
    outcome = Fleet(twins, controller.control_period).run([program], jobs, 5.0)
    error = np.abs(outcome.error)
    share = float(np.median(np.nan_to_num(outcome.flight_share)))
    return (
        f"{outcome.hit.mean():>6.0%} {outcome.fallen.mean():>6.1%} {100 * np.median(error):>8.1f}"
        f" {100 * np.quantile(error, 0.9):>6.1f} {share:>7.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--individuals", type=int, default=600)
    parser.add_argument("--generations", type=int, default=12)
    parser.add_argument("--lamps", type=int, default=10, help="drawn lamps to be judged on, beside the calibrated one")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any key of the task hop")
    options = parser.parse_args()
    cycle = load_controller(ASSETS.path("sim/lamp/controllers/cycle.toml"), LAMP)
    print(f"{options.individuals} individuals; judged on {len(GOALS)} goals x {options.lamps + 1} lamps, 5 s")
    print(f"{'':<34} {'hits':>6} {'falls':>6} {'med. cm':>8} {'p90':>6} {'flight':>7} {'M steps':>8} {'s':>6}")
    for name, (settings, tuning, seeded) in VARIANTS.items():
        if name == next(iter(VARIANTS)):
            print(f"{name:<34} {judged(cycle, options.lamps)}", flush=True)
            continue
        for seed in range(1, options.seeds + 1):
            bred = round((1.0 - tuning) * options.individuals / options.generations)
            sizes = [f"gp.population={max(bred, 2)}", f"gp.generations={options.generations if bred else 1}"]
            task = load_task(ASSETS, "hop", overrides=[*sizes, *settings, *options.set])
            with tempfile.TemporaryDirectory() as folder:
                result = evolve(
                    task, LAMP, CALIBRATION, ASSETS, Path(folder) / "run", seed=seed,
                    seeds=[cycle] if seeded else [], tuning=round(tuning * options.individuals / TUNED),
                )  # fmt: skip
                row = judged(load_controller(result.controller, LAMP), options.lamps)
            last = result.generations[-1]
            print(f"{name:<34} {row} {last.physics_steps / 1e6:>8.1f} {last.wall_s:>6.0f}", flush=True)


if __name__ == "__main__":
    main()
