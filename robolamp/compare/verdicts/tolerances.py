"""Tolerances (calibration/tolerances/*.toml): how far the lamp may be from its twin, and from its goal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robolamp.assets import Assets
from robolamp.files import Table, read_toml
from robolamp.twin.judges.lamp_judge import GOAL_RADIUS


@dataclass(frozen=True)
class Tolerances:
    """Largest differences that count as inside.

    Attributes:
        joint_mae: Each joint's mean absolute error once the lag is removed [rad].
        lag: Each joint's lag, either way [s].
        travel: Difference of the base's travel, where it is known [m].
        hop: Difference of each hop's take-off, landing and flight time [s].
        missing: Share of a joint's, or the foot's, readings that may be missing.
        asked_again: Share of a joint's readings that may have come only when asked again.
        goal: Distance from the goal at which the task is done [m].
    """

    joint_mae: float
    lag: float
    travel: float
    hop: float
    missing: float
    asked_again: float
    goal: float


def load_tolerances(assets: Assets, name: str | Path = "default") -> Tolerances:
    """Read a tolerances file.

    Args:
        assets: Where to look.
        name: A path, or the name of a file in calibration/tolerances/.

    Raises:
        FileError: The file is missing or malformed, or a value is outside its legal range.
    """
    path = assets.named(name, "calibration/tolerances", "tolerances file")
    root = Table(read_toml(path), str(path))
    root.integer("schema", 1, 1)
    root.text("name")
    tolerances = Tolerances(
        joint_mae=root.number("joint_mae", 0.0, 3.0, "rad"),
        lag=root.number("lag", 0.0, 1.0, "s"),
        travel=root.number("travel", 0.0, 10.0, "m"),
        hop=root.number("hop", 0.0, 10.0, "s", default=0.08),
        missing=root.number("missing", 0.0, 1.0, default=0.0),
        asked_again=root.number("asked_again", 0.0, 1.0, default=0.01),
        goal=root.number("goal", 0.0, 1.0, "m", default=GOAL_RADIUS),
    )
    root.done()
    return tolerances
