"""What `robolamp score` says of figures other than the lamp: goals in the plane, the task's own fitness."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robolamp.cli.screen.output import counted
from robolamp.figure import POINT, Figure
from robolamp.twin.judges.run_outcome import RunOutcome

if TYPE_CHECKING:
    from robolamp.evolve.tasks.task import Task

_MOVED = 0.001  # less than this is no move of the body at the goal [m]
_ROWS = 12  # of the table that a person reads; --json has every goal


def figure_keys(task: Task, outcome: RunOutcome) -> dict[str, Any]:
    """Return what `--json` says of a figure's runs beside what it says of any."""
    return {
        "figure": _figure(task).name,
        "task": task.name,
        "directions_rad": outcome.direction,
        "fitness": _fitness(task, outcome),
        "aloft_s": outcome.aloft,
        "aloft_share": outcome.aloft / outcome.duration,
        "flight_gain_m": outcome.flight_gain,
        "goal_moved_m": outcome.goal_moved,
        "goal_pulled_m": outcome.goal_pulled,
        "tilts_rad": outcome.tilt,
        "collided": outcome.fallen,
    }


def _figure(task: Task) -> Figure:
    assert isinstance(task.figure, Figure)
    return task.figure


def _fitness(task: Task, outcome: RunOutcome) -> np.ndarray:
    from robolamp.evolve.tasks.fitness import weighted

    return weighted(outcome, task.main) + weighted(outcome, task.style)


def print_figure(name: str, task: Task, outcome: RunOutcome) -> None:
    """Print how a figure's controller did, for people.

    Args:
        name: What the controller is called.
        task: Its task.
        outcome: Its runs.
    """
    figure, fitness = _figure(task), _fitness(task, outcome)
    table = Table(title=Text(f"{name} in task {task.name}", "italic"), title_justify="left")
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
    radius = figure.radius * 100
    console.print(
        f"{counted(len(order), 'run')}: {counted(outcome.hit.sum(), 'hit')} (within {radius:g} cm at the end,"
        f" upright, nothing hit), {outcome.hit_1997.sum()} came within {radius:g} cm,"
        f" {counted(outcome.fallen.sum(), 'collision')}; median {np.median(outcome.error) * 100:.1f} cm off then.",
        soft_wrap=True,
    )
    console.print(_story(outcome, figure.goal), soft_wrap=True)


def _story(outcome: RunOutcome, body: str) -> str:
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
