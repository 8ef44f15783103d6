"""How much of bare physics speed a fleet of figures keeps: Fleet against mujoco.batch, in one run.

    python benchmarks/figures.py

Both step the same model from the same state, in as many threads with a batch each; the bare batches are sent the very
motor speeds that the fleet's controllers asked for, tick by tick, and nobody looks at what they do. CPU time of all
threads, so that other programs on the machine disturb it less; the median of rounds in turn.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.controller.expression import parse
from robolamp.controller.program import Program, compile_program
from robolamp.controller.terminals import figure_terminals
from robolamp.figure import Figure, load_figure
from robolamp.twin.figure_model import FigureTwin, build_figure
from robolamp.twin.lanes.fleet import Fleet, Job

LANES, SECONDS, ROUNDS, PERIOD = 200, 2.0, 7, 0.01


def programs(figure: Figure) -> list[Program]:
    """Controllers of 22 nodes a joint that keep the figure moving; those that evolution ends with have 5 to 12."""
    names = figure_terminals(figure)

    def swing(joint: int, rate: int) -> str:
        turn = f"(- (* {rate} t) (* 2 k{joint}))"
        return f"(ifltz (- (% t 3) 1) (- {turn} goal_left) {turn})"

    return [
        compile_program([parse(swing(joint, rate), names) for joint in range(len(figure.joints))], names)
        for rate in range(1, 5)
    ]


def bare(twin: FigureTwin, goals: NDArray[np.float64], workers: int) -> None:
    """Step lanes on threads with goals known beforehand."""

    def work(share: NDArray[np.float64]) -> None:
        batch = Batch(twin.model, len(share), 1)
        batch.state[:] = twin.state
        ctrl = batch.bind("ctrl")
        for tick in range(share.shape[1]):
            ctrl[:] = share[:, tick]
            batch.step(None, 1)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(work, [goals[first::workers] for first in range(workers)]))


def cpu(run: Callable[[], object]) -> float:
    """Return the CPU time of a call [s]."""
    began = time.process_time()
    run()
    return time.process_time() - began


def report(name: str, workers: int) -> str:
    """Measure one figure; return a line."""
    assets = Assets()
    figure = load_figure(assets, name)
    twin = build_figure(figure, assets)
    fleet, own = Fleet([twin], PERIOD, workers), programs(figure)
    jobs = [Job(lane % len(own), 0, 1.0, direction=0.01 * lane) for lane in range(LANES)]
    trace = fleet.run(own, jobs, SECONDS, record=True).trace
    assert trace is not None
    goals = trace.goals
    pairs: Sequence[tuple[float, float]] = [
        (cpu(lambda: bare(twin, goals, workers)), cpu(lambda: fleet.run(own, jobs, SECONDS))) for _ in range(ROUNDS)
    ]
    steps = LANES * round(SECONDS / PERIOD)
    physics, whole = np.median(pairs, axis=0) / steps * 1e6
    share = np.median([one / other for one, other in pairs])
    return f"{name}: bare {physics:.1f} us a step, fleet {whole:.1f} us a step, {share:.2f} of bare speed"


if __name__ == "__main__":
    threads = len(os.sched_getaffinity(0))
    print(f"{LANES} lanes, {SECONDS:g} s, {threads} threads, median of {ROUNDS} rounds")
    for name in ("jumper", "spider"):
        print(report(name, threads))
