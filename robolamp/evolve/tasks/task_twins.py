"""What a task is tried on: lamps of the fleet, or another figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.evolve.tasks.task import Task
from robolamp.figure import Driven, Figure
from robolamp.lamp import Lamp
from robolamp.twin.bend import Bend
from robolamp.twin.figure_model import Twin, build_figure
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.variation.random_lamps import LampLaw

_LAMPS = 24  # at least, drawn for a run besides the calibrated one


def driven_by(task: Task, lamp: Lamp) -> Driven:
    """Return what a task's controllers drive: the figure it names, or the lamp at hand."""
    return task.figure if isinstance(task.figure, Figure) else lamp


def compiled(
    task: Task, lamp: Lamp, calibration: Calibration, assets: Assets, rng: np.random.Generator
) -> Sequence[Twin]:
    """Return the models that a run's trials are made on, the calibrated lamp first.

    Args:
        task: What is evolved, on how many lamps.
        lamp: The lamp.
        calibration: Its numbers.
        assets: Where models are.
        rng: Where the lamps that are drawn come from.

    Raises:
        FileError: A model does not load, or lacks what its description names.
    """
    if isinstance(task.figure, Figure):
        return [build_figure(task.figure, assets, task.world, timestep=task.timestep)]

    def made(numbers: Calibration, bend: Bend | None = None) -> TwinModel:
        return build(lamp, numbers, assets, bend, timestep=task.timestep, pole=task.pole)

    if task.cases.lamps == 1:
        return [made(calibration)]
    law = LampLaw(lamp, calibration, assets, task.cases.spread)
    others = max(_LAMPS, task.cases.lamps - 1)
    return [made(*law.calibrated), *(made(*law.draw(rng)) for _ in range(others))]
