"""`robolamp score` for figures other than the lamp: goals in the plane, the task's own fitness."""

from __future__ import annotations

import math

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robolamp.cli.bar import bar
from robolamp.cli.figures import Stage
from robolamp.cli.output import called, counted, print_json
from robolamp.controller.terminals import figure_terminals
from robolamp.evolve.fitness import weighted
from robolamp.figure import POINT
from robolamp.twin.arena import FigureFleet
from robolamp.twin.verdict import FigureOutcome

_MOVED = 0.001  # less than this is no move of the body at the goal [m]
_ROWS = 12  # of the table that a person reads; --json has every goal


def score_figure(
    stage: Stage, goals: str | None, seed: int | None, duration: float | None, workers: int | None, as_json: bool
) -> int:
    """Run a figure's controller to many goals and tell how it did; see `robolamp.cli.score`."""
    controller, figure = stage.controller, stage.twin.figure
    jobs = stage.jobs(goals, "--goals", seed)
    fleet = FigureFleet([stage.twin], controller.control_period, workers)
    program = controller.compile(figure_terminals(figure))
    with bar("simulating", quiet=as_json) as done:
        outcome = fleet.run([program], jobs, duration or stage.task.duration, done=done)
    fitness = weighted(outcome, stage.task.main) + weighted(outcome, stage.task.style)
    if as_json:
        print_json(
            {
                "controller": controller.name,
                "origin": controller.origin or None,
                "figure": figure.name,
                "task": stage.task.name,
                "goals_m": outcome.goal,
                "directions_rad": outcome.direction,
                "errors_m": outcome.error,
                "fitness": fitness,
                "hops": outcome.hops.astype(int),
                "aloft_s": outcome.aloft,
                "aloft_share": outcome.aloft / outcome.duration,
                "flight_gain_m": outcome.flight_gain,
                "goal_moved_m": outcome.goal_moved,
                "goal_pulled_m": outcome.goal_pulled,
                "tilts_rad": outcome.tilt,
                "collided": outcome.fallen,
                "hits": int(outcome.hit.sum()),
                "hits_1997": int(outcome.hit_1997.sum()),
                "falls": int(outcome.fallen.sum()),
                "runs": len(jobs),
                "unstable": int(outcome.unstable.sum()),
                "upright": int(outcome.upright.sum()),
                "median_abs_error_m": np.median(outcome.error),
            }
        )
        return 0
    _print(stage, outcome, fitness)
    return 0


def _print(stage: Stage, outcome: FigureOutcome, fitness: np.ndarray) -> None:
    table = Table(title=Text(f"{called(stage.controller)} in task {stage.task.name}", "italic"), title_justify="left")
    for column in ("goal", "direction", "ends off by", "jumps", "collided", "upright", "hit", "fitness"):
        table.add_column(column, justify="right")
    order = np.argsort(outcome.direction, kind="stable")
    for row in np.unique(np.linspace(0, len(order) - 1, _ROWS).round().astype(int)):
        index = order[row]
        table.add_row(
            f"{outcome.goal[index] * 100:.1f} cm",
            f"{round(math.degrees(outcome.direction[index])):d}°",
            f"{outcome.error[index] * 100:.1f} cm",
            f"{outcome.hops[index]:.0f}",
            *("yes" if flag[index] else "no" for flag in (outcome.fallen, outcome.upright, outcome.hit)),
            f"{fitness[index]:.3f}",
        )
    console = Console(highlight=False)
    console.print(table)
    radius = stage.twin.figure.radius * 100
    console.print(
        f"{counted(len(order), 'run')}: {counted(outcome.hit.sum(), 'hit')} (within {radius:g} cm at the end,"
        f" upright, nothing hit), {outcome.hit_1997.sum()} came within {radius:g} cm,"
        f" {counted(outcome.fallen.sum(), 'collision')}; median {np.median(outcome.error) * 100:.1f} cm off then.",
        soft_wrap=True,
    )
    console.print(_story(outcome, stage.twin.figure.goal), soft_wrap=True)


def _story(outcome: FigureOutcome, body: str) -> str:
    """Return a sentence on jumps and on what became of the body at the goal; medians of the runs."""
    aloft, gain, moved, pulled = (
        float(np.median(values))
        for values in (outcome.aloft, outcome.flight_gain, outcome.goal_moved, outcome.goal_pulled)
    )
    told = "Never off the floor for as long as 40 ms"
    if aloft > 0.0:
        told = f"Off the floor for {aloft:.2f} s, in jumps that brought it {gain * 100:.1f} cm nearer"
    if body != POINT:
        way = f"moved by {moved * 100:.1f} cm, {pulled * 100:.1f} cm of it towards the start"
        told += f"; the {body} {way if moved >= _MOVED else 'stayed where it was'}"
    return f"{told}{' (medians)' if len(outcome.goal) > 1 else ''}."
