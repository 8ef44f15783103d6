"""A task so small that a run takes a second."""

from __future__ import annotations

from pathlib import Path

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.evolve.task import Task, load_task
from robolamp.lamp import load_lamp

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)

TINY = """
schema = 1
name = "tiny"
control_period = 0.02
duration = 0.6
signals = "on-board"
constants = [-1.5, 1.5]

[cases]
count = 1
low = 0.05
high = 0.60
spacing = 0.05
lamps = 1

[main]
distance = 1.0
fall = 2.0

[style]
posture = 0.33

[gp]
population = 12
generations = 2
tournament = 3
crossover = 0.7
mutation = 0.2
depth_at_birth = [2, 4]
depth = 6
"""


def task(folder: Path, *changes: tuple[str, str]) -> Task:
    """The tiny task, lines of it changed."""
    text = TINY
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "tiny.toml"
    path.write_text(text)
    return load_task(ASSETS, path)
