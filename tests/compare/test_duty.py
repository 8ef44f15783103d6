"""The replay of a run whose stage limited the motors' duty."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from robolamp.compare.replays.goal_replay import replay
from robolamp.errors import FileError
from robolamp.log.reader import Run, read_run

from .lamps import ASSETS, CALIBRATION, LAMP, write_run


def error(run: Run) -> float:
    """The largest error of the replay [rad]."""
    twin = replay(run, LAMP, CALIBRATION, ASSETS)
    there = np.array([np.interp(run.measured_at, twin.time, angle) for angle in twin.angle.T]).T
    return float(np.nanmax(np.abs(run.angle - there)))


def test_the_twin_gets_no_more_of_the_supply_than_the_lamp_had(tmp_path: Path) -> None:
    run = read_run(write_run(tmp_path, duty=0.15)[0])
    assert error(run) < 0.003
    full = {name: text for name, text in run.context.items() if name != "duty_limit"}
    assert error(dataclasses.replace(run, context=full)) > 0.02


@pytest.mark.parametrize("text", ["0.0", "1.5", "nan", "half"])
def test_a_duty_limit_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    run = read_run(write_run(tmp_path)[0])
    bad = dataclasses.replace(run, context={**run.context, "duty_limit": text})
    with pytest.raises(FileError, match=f"duty_limit is '{text}'; expected more than 0, up to 1"):
        error(bad)
