"""Tuning a controller's constants by CMA-ES (Hansen 2016), over cases and lamps drawn anew each iteration."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from robolamp.evolve.race import fitness
from robolamp.evolve.representations.tree import Genome, constants, with_constants
from robolamp.evolve.tasks.task import Task
from robolamp.evolve.trial import Trials, draw_cases

_STEP_RELATIVE, _STEP_RANGE = 0.1, 0.02  # first step of each constant: of its value, and of the task's range
_FINALISTS = 12  # of those tried, to choose from: chosen; judging them costs about what two iterations do


def tune(
    genome: Genome,
    trials: Trials,
    task: Task,
    lamps: int,
    iterations: int,
    seed: int,
    told: Sequence[Sequence[float]],
    progress: Callable[[int, Sequence[Genome], NDArray[np.float64]], None],
) -> list[Genome]:
    """Return genomes with better constants to choose from, the first of them the search's mean.

    Constants that are written alike are tuned as one: a hop length that every joint's expression repeats stays one
    length. Fresh cases every iteration keep the search from fitting a few goals, and the mean of the search
    distribution is what such noise moves least. Where success is all or nothing (under a pole or not), the mean of
    those who get through need not: a task with `gp.tuned = "best"` has the best that were tried to choose from, too.

    Args:
        genome: Where to start.
        trials: Tries genomes.
        task: Weights (main + style) and the range of constants.
        lamps: Lamps of the fleet.
        iterations: How many.
        seed: Where randomness comes from.
        told: Fitnesses of the iterations that were done before, by a run that is resumed: not simulated again.
        progress: Called after each new iteration with its number, what it tried and the `MEASURES` of that, shape
            (genomes, cases, 7).

    Returns:
        The genome itself where there is nothing to tune.
    """
    start, tied = np.unique(constants(genome), return_inverse=True)
    if not len(start) or iterations < 1:
        return [genome]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # importing cma warns where matplotlib's backend is headless
        import cma  # noqa: PLC0415 (slow to import, and needed here alone)
    low, high = task.constants
    scale = _STEP_RELATIVE * np.abs(start) + _STEP_RANGE * (high - low)
    rng = np.random.default_rng(seed)
    options = {"seed": int(rng.integers(1, 2**31)), "verbose": -9, "verb_log": 0, "maxiter": iterations}
    search = cma.CMAEvolutionStrategy(np.zeros(len(start)), 1.0, options)
    tried: list[tuple[float, Genome]] = []

    def tell(steps: Sequence[NDArray[np.float64]], candidates: Sequence[Genome], found: Sequence[float]) -> None:
        search.tell(steps, list(found))
        if task.gp.tuned == "best":
            tried.extend(zip(found, candidates, strict=True))
            tried[:] = sorted(tried, key=lambda each: each[0])[:_FINALISTS]

    for iteration in range(iterations):
        steps = search.ask()
        candidates = [with_constants(genome, (start + scale * step)[tied].tolist()) for step in steps]
        cases = draw_cases(rng, task, lamps)
        if iteration < len(told):
            tell(steps, candidates, told[iteration])
            continue
        values = trials.table(candidates, cases)
        tell(steps, candidates, fitness(values, 1.0).tolist())
        progress(iteration, candidates, values)
    mean = np.asarray(search.result.xfavorite)
    return [with_constants(genome, (start + scale * mean)[tied].tolist()), *(each for _, each in tried)]
