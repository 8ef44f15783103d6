"""A servo port that is unplugged, again and again, and goals that get lost: the emulated lamp in lockstep, its log."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive, drive
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import Event, Faults
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import load_reality
from robolamp.log.reader import read_run
from robolamp.robot.connection import Connection
from robolamp.runtime.health import GOALS_LOST
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import StopRequest

DURATION = 1.0


def driven_with(log: Path, *events: Event) -> RunResult:
    """Drive an emulated lamp on whose line something happens."""
    setup = Setup.of(None, "nominal")
    reality = load_reality("none", setup.lamp, setup.assets)
    world = EmulatedLamp(setup.lamp, setup.calibration, setup.assets, reality, faults=Faults("x", events=events))
    ports = Lockstep(world, setup.lamp.bus_baud)
    plan = Drive(setup, setup.controller("hop-counting", on_board=True), 0.2, DURATION, "emulator", log, resume=True)
    return drive(plan, Connection(ports.servo_port, ports.foot_port, ports.clock, 0), StopRequest(), True)


@pytest.mark.parametrize(
    "gone", [[(2.6, 1.0)], [(2.6, 1.0), (4.2, 0.5)], [(2.6, 1.0), (4.2, 0.5), (5.0, 0.2)], [(1.0, 0.6), (2.3, 0.4)]]
)
def test_the_log_tells_for_how_long_the_run_stood(tmp_path: Path, gone: list[tuple[float, float]]) -> None:
    events = (Event("unplugged", at=at, lasts=lasts, port="servo") for at, lasts in gone)
    log = tmp_path / "log.mcap"
    result = driven_with(log, *events)
    assert (result.ended, result.replugs) == ("finished", len(gone)), result.reason
    run = read_run(log)
    said = [
        (at * 1e-9, float(found[1])) for at, _, text in run.events if (found := re.search(r"paused ([\d.]+) s", text))
    ]
    assert sum(paused for _, paused in said) == pytest.approx(result.paused, abs=1e-3)
    driven = run.scheduled[run.phase == "run"]
    paused = np.array([sum(lasts for at, lasts in said if at < tick) for tick in driven])
    own = driven - paused  # the controller's time
    assert np.diff(own).min() > 0.02 - 1e-3
    assert np.diff(own).max() < 0.0601
    assert own[-1] - own[0] == pytest.approx(DURATION - 0.02, abs=0.0401)
    assert DURATION / 0.02 - 6 <= len(driven) <= DURATION / 0.02


def test_a_foot_that_comes_back_later_than_the_servos_is_taken_up(tmp_path: Path) -> None:
    events = [Event("unplugged", at=2.6, lasts=0.5), Event("unplugged", at=2.7, lasts=2.0, port="foot")]
    result = driven_with(tmp_path / "log.mcap", *events)
    assert (result.ended, result.replugs) == ("finished", 1), result.reason


def test_a_servo_that_restarts_meanwhile_is_told_of(tmp_path: Path) -> None:
    gone = Event("unplugged", at=2.6, lasts=0.5)
    result = driven_with(tmp_path / "log.mcap", gone, Event("reboot", at=2.7, servo=2))
    assert (result.ended, result.replugs) == ("finished", 1), result.reason
    said = "knee: its torque was off when it came back; it was without supply or restarted"
    assert result.faults[said] == 1
    assert said in [text for _, level, text in read_run(tmp_path / "log.mcap").events if level == "warning"]
    assert said not in driven_with(tmp_path / "other.mcap", gone).faults


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (Event("silent", at=2.7, lasts=60.0, servo=2), "knee (id 2) does not answer to a ping"),
        (Event("id_lost", at=2.7, servo=2, id=77), "knee (id 2) does not answer to a ping"),
        (Event("unplugged", at=2.7, lasts=60.0, port="foot"), "foot"),
    ],
)
def test_what_is_not_back_is_named(tmp_path: Path, event: Event, said: str) -> None:
    result = driven_with(tmp_path / "log.mcap", Event("unplugged", at=2.6, lasts=0.5), event)
    before, _, why = result.reason.partition("; the lamp was not back in 10 s: ")
    assert "gone" in before
    assert said in why.lower()


@pytest.mark.parametrize("count", [GOALS_LOST - 1, GOALS_LOST + 3])
def test_goals_that_stay_lost_stop_the_run(tmp_path: Path, count: int) -> None:
    """Readings and goals take turns on the line: of two runs one loses nothing else."""
    results = [
        driven_with(
            tmp_path / f"{first}.mcap", *(Event("dropped", packet=400 + first + 2 * index) for index in range(count))
        )
        for first in range(2)
    ]
    lost = max(results, key=lambda result: result.faults.get("ankle: a goal did not arrive", 0))
    said = f"ankle: {GOALS_LOST} goals in a row did not arrive"
    expected = ("guard", said) if count >= GOALS_LOST else ("finished", "")
    assert (lost.ended, lost.reason) == expected
    assert lost.faults["ankle: a goal did not arrive"] == count
