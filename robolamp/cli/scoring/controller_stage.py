"""Stages: a controller, what it drives (the lamp, or another figure in its task), and the goals it is sent to."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robolamp.assets import bare_name
from robolamp.cli.options import Setup, goal_range, length
from robolamp.controller.controller_file import Controller, check_goal_time, load_controller, read_figure, time_for
from robolamp.controller.program import Program
from robolamp.controller.terminals import terminals_of
from robolamp.errors import FileError, RobolampError
from robolamp.figure import LAMP, Figure, figures, load_figure
from robolamp.files import is_file, kind_of, suffix_of

if TYPE_CHECKING:
    from robolamp.evolve.tasks.task import Task
    from robolamp.twin.figure_model import Twin
    from robolamp.twin.lamp_model import Pole
    from robolamp.twin.lanes.fleet import Fleet, Job

_GOALS_SEED = 1  # which points LOW:HIGH:COUNT is, unless --seed says otherwise


@dataclass(frozen=True)
class Stage:
    """A controller and what it is run on.

    Attributes:
        controller: The controller.
        twins: What it drives: the lamp, or several; or a figure, as its task has it.
        task: A figure's task: the world, the goals, the time; None for the lamp.
        goal_time: Time that the lamp is told to take for the way [s]; 0: it is not told.
    """

    controller: Controller
    twins: Sequence[Twin]
    task: Task | None = None
    goal_time: float = 0.0

    @property
    def terminals(self) -> tuple[str, ...]:
        """What the controller may read."""
        return terminals_of(self.twins[0].driven)

    @property
    def program(self) -> Program:
        """The controller, compiled for these."""
        return self.controller.compile(self.terminals)

    def time(self, jobs: Sequence[Job]) -> float:
        """Return the length of runs, unless another is asked for [s]."""
        return time_for(max(job.goal for job in jobs)) if self.task is None else self.task.duration

    def fleet(self, workers: int | None = None) -> Fleet:
        """Return what runs it, on so many threads; None: one for each core."""
        from robolamp.twin.lanes.fleet import Fleet

        return Fleet(self.twins, self.controller.control_period, workers)

    def jobs(self, goals: str | None, option: str, default: str, seed: int | None = None) -> list[Job]:
        """Return the runs to make.

        Args:
            goals: For the lamp a distance, or LOW:HIGH:COUNT, in metres: each on every lamp. For a figure "X,Y", a
                distance ahead, or LOW:HIGH:COUNT, so many points of that ring drawn evenly; None: its task's own.
            option: Where it was typed, for messages.
            default: The lamp's goals where none are given.
            seed: Which points are drawn; None: always the same.

        Raises:
            RobolampError: The goals are none of these, or do not fit.
        """
        from robolamp.twin.lanes.fleet import Job

        if self.task is None:
            lamps, distances = range(len(self.twins)), goal_range(goals or default, option)
            return [Job(0, lamp, float(goal), self.goal_time) for lamp in lamps for goal in distances]
        from robolamp.evolve.tasks.fitness_cases import poisson_disk_plane
        from robolamp.evolve.trial import draw_cases

        rng = np.random.default_rng(_GOALS_SEED if seed is None else seed)
        if goals is None:
            return [Job(0, 0, case.goal, 0.0, case.direction) for case in draw_cases(rng, self.task, 1)]
        if "," in goals:
            x, y = _point(goals, option)
            return [Job(0, 0, math.hypot(x, y), 0.0, math.atan2(y, x))]
        if ":" not in goals:
            return [Job(0, 0, length(goals, option))]
        ends = goal_range(goals, option)
        points = poisson_disk_plane(rng, len(ends), (ends[0], ends[-1]), (-math.pi, math.pi), 0.0)
        return [Job(0, 0, float(distance), 0.0, float(direction)) for distance, direction in points]


def _point(text: str, option: str) -> tuple[float, float]:
    parts = text.split(",")
    try:
        x, y = (float(part) for part in parts)
    except ValueError:
        x = y = math.nan
    if not 0.0 < math.hypot(x, y) <= 100.0:
        raise RobolampError(f"{text!r} is not X,Y in metres, up to 100 m away, as 0.8,-0.3", option)
    return x, y


def stage_of(
    setup: Setup,
    name: str,
    task: str | None = None,
    refused: Mapping[str, Any] | None = None,
    *,
    goal_time: float | None = None,
    pole: Pole | None = None,
) -> Stage:
    """Return what a controller is run on.

    Args:
        setup: The lamp at hand, and where data files are.
        name: A controller file, or the name of a shipped one.
        task: For a figure other than the lamp: a task file, or the name of one; None: the task.toml beside the
            controller, or the task it names.
        refused: Options for the lamp alone, by name: what was given; None or False where nothing was.
        goal_time: Time to take for the way [s]; None: none is commanded.
        pole: A pole across the lamp's way.

    Raises:
        FileError: A file is missing or malformed.
        RobolampError: An option is for the lamp alone, or the task is for something else.
    """
    path = _located(setup, name)
    figure = LAMP if path is None else read_figure(path)
    if path is None or figure == LAMP:
        from robolamp.twin.lamp_model import build

        if task is not None:
            raise RobolampError("is for figures other than the lamp", "--task")
        controller = setup.controller(name)
        check_goal_time(controller, goal_time)
        lamp = build(setup.lamp, setup.calibration, setup.assets, pole=pole)
        return Stage(controller, [lamp], goal_time=goal_time or 0.0)
    for option, value in (refused or {}).items():
        if value not in (None, False):
            raise RobolampError(f"is for the lamp alone; {name} drives {figure}", option)
    from robolamp.evolve.tasks.task import load_task
    from robolamp.twin.figure_model import build_figure

    controller = load_controller(path, load_figure(setup.assets, figure))
    beside = path.parent / "task.toml"
    chosen = task or (str(beside) if beside.is_file() else controller.task)
    if not chosen:
        raise RobolampError("names no task; give one with --task", name)
    loaded = load_task(setup.assets, chosen, len(setup.lamp.joints))
    if not isinstance(loaded.figure, Figure) or loaded.figure.name != figure:
        other = loaded.figure.name if isinstance(loaded.figure, Figure) else loaded.figure
        raise FileError(f"is for {other}; {name} drives {figure}", f"task {chosen}")
    driven = replace(loaded.figure, drive=controller.drive)
    twin = build_figure(driven, setup.assets, loaded.world, timestep=loaded.timestep)
    return Stage(controller, [twin], replace(loaded, figure=driven))


def _located(setup: Setup, name: str) -> Path | None:
    """Return a figure's controller, or any file; None where only the lamp's folder can have it."""
    path, bare = Path(name), bare_name(name)
    if kind_of(path) == "file":
        return None if suffix_of(path) == ".mcap" else path
    folders: Sequence[str] = (LAMP, *figures(setup.assets))
    for folder in folders:
        for item in setup.assets.all(f"sim/{folder}/controllers"):
            if item.stem == bare and is_file(item):
                return item
    return None
