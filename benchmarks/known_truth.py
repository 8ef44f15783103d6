"""Known truth through the wire: a servo of random parameters is recorded, fitted without being told, and compared.

    python benchmarks/known_truth.py [--seeds 20] [--first 0]

The recordings are those of `robolamp calibrate record --servo`: protocol bytes, encoder counts, a supply read in steps
of 0.1 V, the loop's own stamps; the motor behind them is the emulator's. Allowed is the larger of 2 % of the truth and
three standard errors. Exit code 1 where a parameter is further off.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from robolamp.calibrate.servo.fast_pendulum import Pendulum
from robolamp.calibrate.servo.pendulum_fit import Problem, Solution
from robolamp.calibrate.servo.recordings import Recording
from tests.calibrate.wire_parts import CHART, FREE, known_servo, record_servo

_SHARE, _ERRORS = 0.02, 3.0  # what is allowed: of the truth, and in standard errors
_STARTS = 3  # of a fit


def fitted(recordings: list[Recording], seed: int, workers: int | None) -> Solution:
    """Return a fit that knows nothing of the truth."""
    problem = Problem(Pendulum(recordings, workers=workers))
    return problem.best(CHART, problem.starts(CHART, np.random.default_rng([seed, 1]), _STARTS))


def main(seeds: int = 20, first: int = 0, workers: int | None = None) -> int:
    outside, worst, took = 0, (0.0, ""), []
    largest = dict.fromkeys(FREE, 0.0)
    for seed in range(first, first + seeds):
        servo, truth = known_servo(seed)
        with tempfile.TemporaryDirectory() as folder:
            recordings = record_servo(Path(folder), servo)
        began = time.perf_counter()
        solution = fitted(recordings, seed, workers)
        took.append(time.perf_counter() - began)
        errors = CHART.slope(solution.z) * np.sqrt(np.diag(solution.covariance))
        for name, error in zip(FREE, errors, strict=True):
            off = abs(solution.values[name] - truth[name])
            share = off / max(_SHARE * abs(truth[name]), _ERRORS * float(error))
            worst = max(worst, (share, f"{name} of seed {seed}"))
            largest[name] = max(largest[name], off / float(error))
            if share > 1.0:
                outside += 1
                print(
                    f"seed {seed}: {name} {solution.values[name]:.5g}, truly {truth[name]:.5g} "
                    f"({off / abs(truth[name]):.1%} off, {off / float(error):.1f} standard errors)",
                    flush=True,
                )
    print(f"{seeds} servos, {seeds * len(FREE)} parameters: {outside} outside 2 % and three standard errors")
    print(f"worst: {worst[0]:.2f} of what is allowed, {worst[1]}; a fit takes {np.median(took):.0f} s (median)")
    print("largest error in standard errors: " + ", ".join(f"{name} {value:.1f}" for name, value in largest.items()))
    return int(outside > 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="how many servos (20)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first (0)")
    parser.add_argument("--workers", type=int, default=None, help="threads of a fit; one a core")
    sys.exit(main(**vars(parser.parse_args())))
