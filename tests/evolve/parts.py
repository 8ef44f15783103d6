"""A task so small that a run takes a second."""

from __future__ import annotations

from pathlib import Path

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.evolve.tasks.task import Task, load_task
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
constant_mutation = 0.2
depth_at_birth = [2, 4]
depth = 6
"""


WALK = """
schema = 1
name = "walk"
control_period = 0.02
timestep = 0.004
duration = 1.0
signals = "all"
constants = [-30.0, 30.0]

[cases]
count = 3
low = 0.05
high = 0.60
spacing = 0.05
lamps = 1

[main]
distance = 1.0

[style]
arrival = 0.33
travel_after = 0.33
posture = 0.33
fall = 1.0

[gp]
population = 40
generations = 5
tournament = 4
crossover = 0.7
subtree_mutation = 0.05
point_mutation = 0.05
constant_mutation = 0.05
depth_at_birth = [2, 6]
depth = 10
"""


def walk(folder: Path, *overrides: str) -> Task:
    """A task that is large enough for individuals to lose early."""
    path = folder / "walk.toml"
    path.write_text(WALK)
    return load_task(ASSETS, path, overrides=overrides)


def task(folder: Path, *changes: tuple[str, str]) -> Task:
    """The tiny task, lines of it changed."""
    text = TINY
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "tiny.toml"
    path.write_text(text)
    return load_task(ASSETS, path)
