"""Short sessions of an emulated lamp, for the tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from robolamp.assets import Assets
from robolamp.calibrate.manifest import Manifest
from robolamp.calibrate.procedure import Step, procedure
from robolamp.calibrate.recorder import Connect, Person, Session, record
from robolamp.calibration import load_calibration
from robolamp.cli.calibrate.record import emulated
from robolamp.cli.options import Setup
from robolamp.lamp import load_lamp
from robolamp.runtime.stop import StopRequest

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
NOMINAL = load_calibration(ASSETS)
SETUP = Setup(ASSETS, LAMP, NOMINAL)


def steps(*names: str) -> list[Step]:
    """Return steps of the procedure by name."""
    return [step for step in procedure(LAMP) if step.name in names]


def short(step: Step, duration: float) -> Step:
    """Return a step whose excitation lasts less."""
    assert step.excitation
    return replace(step, excitation=replace(step.excitation, duration=duration))


def recorded(
    folder: Path,
    plan: Sequence[Step],
    reality: str = "none",
    *,
    person: Person | None = None,
    connect: Connect | None = None,
    said: list[str] | None = None,
    stop: StopRequest | None = None,
) -> Manifest:
    """Record steps of an emulated lamp in lockstep."""
    session = Session(
        LAMP, NOMINAL, ASSETS, folder, f"emulator {reality}", "a tester", "2026-11-22", stop or StopRequest()
    )
    return record(
        session,
        plan,
        connect or emulated(SETUP, reality),
        person=person,
        say=[].append if said is None else said.append,
    )
