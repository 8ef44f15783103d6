"""Runs of emulated lamps in lockstep as dry-run makes them: stopped, with faults, with any controller."""

from __future__ import annotations

import math
from pathlib import Path

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive, drive
from robolamp.cli.run.lockstep import LockstepLamp
from robolamp.emulator.faults.script import Event, Faults
from robolamp.emulator.reality.file import load_reality
from robolamp.runtime.stop import StopRequest
from robolamp.signals import Clock

SETUP = Setup.of(None, "nominal")


class StopAt(StopRequest):
    """A request to stop at a time of the lamp's clock."""

    clock: Clock
    at = math.inf

    @property
    def requests(self) -> int:
        return int(self.clock.now() >= self.at)


def constant(folder: Path, *angles: float) -> str:
    """Write a controller that asks for these angles [rad]; returns its path."""
    rows = "".join(f'{name} = "{angle!r}"\n' for name, angle in zip(SETUP.lamp.names, angles, strict=True))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "constant.toml"
    path.write_text(
        'schema = 1\nname = "constant"\ntask = "none"\ndrive = "position"\ncontrol_period = 0.02\nterminals = []\n'
        f"\n[joints]\n{rows}"
    )
    return str(path)


def dry_run(
    folder: Path,
    *,
    controller: str = "hop-counting",
    goal: float = 0.30,
    reality: str = "none",
    stop: float = math.inf,
    event: Event | None = None,
) -> Path:
    """Make log.mcap and truth.mcap of a run that is stopped, or struck by an event, at a time; returns the log."""
    folder.mkdir(parents=True, exist_ok=True)
    log, asked = folder / "log.mcap", StopAt()
    plan = Drive(SETUP, SETUP.controller(controller, on_board=True), goal, 4.0, "emulator", log)
    faults = Faults("none") if event is None else Faults("one", events=(event,))
    bent = load_reality(reality, SETUP.lamp, SETUP.assets)
    with LockstepLamp(SETUP, bent, faults, folder / "truth.mcap", None) as lamp:
        asked.clock, asked.at = lamp.ports.clock, stop
        drive(plan, lamp.ports, asked, True)
    assert lamp.failed is None
    return log
