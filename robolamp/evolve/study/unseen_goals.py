"""Champions of studies on goals that they were not evolved on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.controller.controller_file import Controller
from robolamp.controller.terminals import terminals_of
from robolamp.evolve.study.claims import ARRIVES, Shares
from robolamp.evolve.study.plan import OWN_GOAL
from robolamp.evolve.tasks.task import Task
from robolamp.lamp import Lamp
from robolamp.twin.judges.lamp_judge import GOAL_RADIUS
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.fleet import Fleet, Job

WITHIN = np.linspace(0.05, 0.60, 56)
"""Goals inside the range that robust controllers are evolved on [m]."""
BEYOND = np.linspace(0.65, 1.20, 12)
"""Goals beyond it [m]."""


@dataclass(frozen=True)
class Tried:
    """How a controller did on goals; arrays have shape (goals,).

    Attributes:
        goal: [m].
        time: Given for each [s].
        error: Where it ended beyond (positive) or short of the goal [m].
        fell: Whether it fell.
        hit: At rest within 1.5 cm, upright, at the end.
        hit_1997: Came within 1.5 cm.
    """

    goal: NDArray[np.float64]
    time: NDArray[np.float64]
    error: NDArray[np.float64]
    fell: NDArray[np.bool_]
    hit: NDArray[np.bool_]
    hit_1997: NDArray[np.bool_]

    @property
    def arrives(self) -> NDArray[np.bool_]:
        """Ended upright within `ARRIVES` of the goal's distance, or within 1.5 cm: passing through does not count."""
        return ~self.fell & (np.abs(self.error) <= np.maximum(GOAL_RADIUS, ARRIVES * self.goal))

    def shares(self) -> Shares:
        """Return what the rules compare."""
        within = self.goal <= WITHIN[-1] + 1e-9
        own = int(np.argmin(np.abs(self.goal - OWN_GOAL)))
        beyond = self.arrives[~within]
        return Shares(
            within=float(self.arrives[within].mean()),
            beyond=float(beyond.mean()) if len(beyond) else float("nan"),
            own=bool(self.arrives[own]),
        )


def try_goals(
    controllers: Sequence[Controller],
    task: Task,
    lamp: Lamp,
    calibration: Calibration,
    assets: Assets,
    *,
    beyond: bool,
    workers: int | None = None,
) -> list[Tried]:
    """Try controllers on the calibrated lamp: `WITHIN`, and `BEYOND` with time in proportion to the distance.

    Args:
        controllers: All of the task's control period.
        task: The time limit and the physics step.
        lamp: The lamp.
        calibration: The twin's numbers.
        assets: Where the model is.
        beyond: Whether goals beyond 60 cm are tried, too.
        workers: Threads; None: one a core.
    """
    twin = build(lamp, calibration, assets, timestep=task.timestep, pole=task.pole)
    fleet = Fleet([twin], task.control_period, workers)
    programs = [controller.compile(terminals_of(lamp)) for controller in controllers]
    groups = [(WITHIN, task.duration)]
    if beyond:  # 60 cm in the time limit, and so on at that speed
        groups += [(BEYOND[index : index + 1], task.duration * goal / WITHIN[-1]) for index, goal in enumerate(BEYOND)]
    columns: list[list[NDArray[np.float64]]] = []
    for goals, time in groups:
        jobs = [Job(index, 0, float(goal)) for index in range(len(programs)) for goal in goals]
        outcome = fleet.run(programs, jobs, float(time))
        values = (outcome.goal, np.full(len(jobs), time), outcome.error, outcome.fallen, outcome.hit, outcome.hit_1997)
        columns.append([np.reshape(value, (len(programs), len(goals))) for value in values])
    goal, time, error, fell, hit, hit_1997 = (np.concatenate(parts, axis=1) for parts in zip(*columns, strict=True))
    return [
        Tried(goal[i], time[i], error[i], fell[i].astype(bool), hit[i].astype(bool), hit_1997[i].astype(bool))
        for i in range(len(programs))
    ]
