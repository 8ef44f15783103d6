"""Simulated steps per second while evolving, end to end, against a bare `mujoco.rollout` of the same model and step.

Both run in turn in one process, so that a busy machine slows both. The bare rollout holds the neutral pose with small
random goals and a friction that does not change; an evolving fleet also evaluates controllers, judges every step, and
rewrites each joint's load-dependent friction before every step. What that rewriting costs is shown apart, by evolving
once more with friction that stays as it is. Both are shown again without racing
(`gp.early_stop=false`), which runs all lanes of a generation together instead of in waves. Give it two generations or
more: the last one has no tournaments to lose.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from unittest import mock

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.evolve.evolution import evolve
from robolamp.evolve.tasks.task import Task, load_task
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.lamp_lanes import settle

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)
LANES, STEPS, TICK = 128, 250, 10  # of one call of rollout (its output takes memory), and steps for each goal


def bare(twin: TwinModel, threads: int, seconds: float) -> float:
    """Return steps per second of `mujoco.rollout`."""
    model = twin.model
    model.dof_frictionloss[twin.dof] = twin.servos.coulomb + twin.servos.stribeck
    state = np.repeat(settle(twin)[None], LANES, axis=0)
    full = np.empty((LANES, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    data = mujoco.MjData(model)
    for lane in range(LANES):
        mujoco.mj_setState(model, data, state[lane], mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_getState(model, data, full[lane], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    goals = np.random.default_rng(1).uniform(-0.1, 0.1, (LANES, STEPS // TICK, model.nu))
    control = np.repeat(goals, TICK, axis=1)
    workers = [mujoco.MjData(model) for _ in range(threads)]
    done = 0
    with Rollout(nthread=threads) as rollout:
        rollout.rollout(model, workers, full, control)
        began = time.perf_counter()
        while time.perf_counter() - began < seconds:
            rollout.rollout(model, workers, full, control)
            done += LANES * STEPS
        return done / (time.perf_counter() - began)


def still(lanes, coefficients, dofs, motor, bias, velocity, loss, goal, actuators, ctrl) -> None:
    """Stand in for `motors.drive`: friction as it is at standstill without load, written once."""
    ctrl[:, actuators] = goal
    if not loss[0, dofs[0]]:
        loss[:, dofs] = coefficients[:, :, 0] + coefficients[:, :, 1]


def evolving(task: Task, threads: int, seed: int, patch: AbstractContextManager) -> tuple[float, float]:
    """Return steps per second of a whole run, and the share of its time inside trials."""
    with tempfile.TemporaryDirectory() as folder, patch:
        result = evolve(task, LAMP, CALIBRATION, ASSETS, Path(folder) / "run", seed=seed, workers=threads)
    last = result.generations[-1]
    return last.physics_steps / last.wall_s, last.physics_s / last.wall_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--population", type=int, default=250)
    parser.add_argument("--goals", type=int, default=6)
    parser.add_argument("--generations", type=int, default=2)
    parser.add_argument("--pairs", type=int, default=3, help="repetitions of evolving, between bare rollouts")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=3.0, help="time of each bare rollout [s]")
    options = parser.parse_args()
    sizes = [f"cases.count={options.goals}", "cases.lamps=1", f"gp.generations={options.generations}"]
    sized = [*sizes, f"gp.population={options.population}"]
    task = load_task(ASSETS, "hop", overrides=sized)
    together = load_task(ASSETS, "hop", overrides=[*sized, "gp.early_stop=false"])
    tiny = load_task(ASSETS, "hop", overrides=[*sizes, "duration=0.2", "gp.population=4", "gp.generations=1"])
    evolving(tiny, options.threads, 1, nullcontext())  # numba compiles

    def unchanged() -> AbstractContextManager:
        return mock.patch("robolamp.twin.actuators.motors.drive", still)

    ways: dict[str, tuple[Task, Callable[[], AbstractContextManager]]] = {
        "racing, friction by load": (task, nullcontext),
        "racing, friction as it is": (task, unchanged),
        "no racing, friction by load": (together, nullcontext),
        "no racing, friction as it is": (together, unchanged),
    }
    rates: dict[str, list[float]] = {name: [] for name in ways}
    ratios: dict[str, list[float]] = {name: [] for name in ways}
    shares: dict[str, list[float]] = {name: [] for name in ways}
    twin = build(LAMP, CALIBRATION, ASSETS)
    rollout = [bare(twin, options.threads, options.seconds)]
    for pair in range(options.pairs):
        for name, (way, patch) in ways.items():
            found, share = evolving(way, options.threads, pair + 1, patch())
            rollout.append(bare(twin, options.threads, options.seconds))
            rates[name].append(found)
            ratios[name].append(found / np.mean(rollout[-2:]))  # of the rollout just before and just after
            shares[name].append(share)
    print(f"{options.population} individuals x {options.goals} goals x {task.duration:g} s, steps of 2 ms,")
    print(f"{options.generations} generations, {options.threads} threads; medians of {options.pairs} pairs")
    print(f"{'':<28} {'steps/s':>10} {'to rollout':>11} {'(range)':>11} {'in trials':>10}")
    print(f"{'bare mujoco.rollout':<28} {np.median(rollout):>10,.0f}")
    for name in ways:
        found, ratio, share = (float(np.median(values[name])) for values in (rates, ratios, shares))
        spread = f"{min(ratios[name]):.2f}-{max(ratios[name]):.2f}"
        print(f"{name:<28} {found:>10,.0f} {ratio:>11.2f} {spread:>11} {share:>10.1%}")


if __name__ == "__main__":
    main()
