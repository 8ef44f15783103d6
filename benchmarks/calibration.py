"""Known truth: a servo of random parameters is recorded and fitted again; how far off the fit is, and how fast.

    python benchmarks/calibration.py [SEEDS]

The recordings are MuJoCo's motion, sampled at odd times, rounded to encoder counts, with a noisy supply.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from robolamp.calibrate.servo.fast_pendulum import Pendulum, parameter_set
from robolamp.calibrate.servo.ladder import Chart, switched_off
from robolamp.calibrate.servo.mujoco_bench import Bench
from robolamp.calibrate.servo.pendulum_fit import Problem
from tests.calibrate.bench_parts import NOMINAL, chirp, drop, record, steps

FREE = (
    "torque_constant", "resistance", "armature", "viscous", "coulomb", "delay", "encoder_offset", "load_motor",
    "load_external",
)  # fmt: skip


def main(seeds: int = 20) -> None:
    chart = Chart(FREE, NOMINAL, switched_off(NOMINAL))
    outside, worst = 0, 0.0
    began, simulated = time.perf_counter(), 0.0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        truth = {**switched_off(NOMINAL), **chart.complete(0.7 * np.clip(rng.standard_normal(len(FREE)), -2, 2))}
        recordings = [
            record(steps, truth, p_gain=800.0, seed=seed), record(chirp, truth, seed=seed + 100),
            record(drop, truth, off_at=0.8, seed=seed + 200),
            record(steps, truth, p_gain=200.0, off_at=2.0, seconds=3.5, seed=seed + 300),
        ]  # fmt: skip
        pendulum = Pendulum(recordings)
        starts = [np.zeros(len(FREE)), 0.5 * rng.standard_normal(len(FREE))]
        solution = Problem(pendulum).best(chart, starts)
        simulated += pendulum.steps * pendulum.timestep
        errors = chart.slope(solution.z) * np.sqrt(np.diag(solution.covariance))
        for name, error in zip(FREE, errors, strict=True):
            off = abs(solution.values[name] - truth[name])
            worst = max(worst, off / max(0.02 * abs(truth[name]), 3 * error))
            if off > max(0.02 * abs(truth[name]), 3 * error):
                outside += 1
                print(f"seed {seed}: {name} {solution.values[name]:.5g}, truly {truth[name]:.5g} ± {error:.2g}")
    elapsed = time.perf_counter() - began
    print(f"{seeds} seeds, {seeds * len(FREE)} parameters: {outside} further off than 2 % and three standard errors")
    print(f"worst {worst:.2f} of what is allowed; {elapsed / seeds:.1f} s a fit; {simulated / elapsed:.0f} servo-s/s")

    sets = np.repeat(parameter_set(truth)[None], 20, axis=0)
    for name, simulator in (("written out", pendulum), ("MuJoCo's Batch", Bench(recordings))):
        simulator.simulate(sets)
        before, begin = simulator.steps, time.perf_counter()
        simulator.simulate(sets)
        seconds = (simulator.steps - before) * simulator.timestep
        print(f"{name}: {seconds / (time.perf_counter() - begin):.0f} servo-s/s")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
