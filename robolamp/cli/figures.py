"""Controllers of figures other than the lamp: which figure, which task, which goals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robolamp.assets import bare_name
from robolamp.cli.options import Setup, goal_range, length
from robolamp.controller.file import Controller, load_controller, read_figure
from robolamp.errors import FileError, RobolampError
from robolamp.figure import LAMP, Figure, figures, load_figure
from robolamp.files import is_file, kind_of, suffix_of

if TYPE_CHECKING:
    from robolamp.evolve.task import Task
    from robolamp.twin.figure import FigureTwin
    from robolamp.twin.fleet import Job

_GOALS_SEED = 1  # which points LOW:HIGH:COUNT is, unless --seed says otherwise


@dataclass(frozen=True)
class Stage:
    """A figure's controller and the task that it is run in.

    Attributes:
        controller: The controller.
        task: Its task: the world, the goals, the time.
        twin: The figure, as the task has it.
    """

    controller: Controller
    task: Task
    twin: FigureTwin

    def jobs(self, goals: str | None, option: str, seed: int | None = None) -> list[Job]:
        """Return the runs to make.

        Args:
            goals: "X,Y" (metres), a distance ahead, or LOW:HIGH:COUNT, so many points of that ring drawn evenly;
                None: the task's own.
            option: Where it was typed, for messages.
            seed: Which points are drawn; None: always the same.

        Raises:
            RobolampError: The goals are none of these, or do not fit.
        """
        from robolamp.evolve.cases import poisson_disk_plane
        from robolamp.evolve.trial import draw_cases
        from robolamp.twin.fleet import Job

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


def stage_of(setup: Setup, name: str, task: str | None, refused: Mapping[str, Any]) -> Stage | None:
    """Return where a figure's controller is to be run; None for one of the lamp's.

    Args:
        setup: Where data files are.
        name: A controller file, or the name of a shipped one.
        task: A task file, or the name of one; None: the task.toml beside the controller, or the task it names.
        refused: Options for the lamp alone, by name: what was given; None or False where nothing was.

    Raises:
        FileError: A file is missing or malformed.
        RobolampError: An option is for the lamp alone, or the task is for something else.
    """
    path = _located(setup, name)
    figure = LAMP if path is None else read_figure(path)
    if path is None or figure == LAMP:
        if task is not None:
            raise RobolampError("is for figures other than the lamp", "--task")
        return None
    for option, value in refused.items():
        if value not in (None, False):
            raise RobolampError(f"is for the lamp alone; {name} drives {figure}", option)
    from robolamp.evolve.task import load_task
    from robolamp.twin.figure import build_figure

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
    return Stage(controller, replace(loaded, figure=driven), twin)


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
