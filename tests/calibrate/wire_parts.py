"""Recordings of a single emulated servo of known parameters, made through the loop and the wire, in lockstep."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robolamp.assets import Assets
from robolamp.calibrate.procedure import Step
from robolamp.calibrate.recorder import Session, record
from robolamp.calibrate.servo.ladder import Chart, switched_off
from robolamp.calibrate.servo.procedure import bench_lamp, bench_procedure
from robolamp.calibrate.servo.recordings import Recording, read_recordings
from robolamp.calibration import load_calibration
from robolamp.cli.calibrate.record import emulated_servo
from robolamp.cli.options import Setup
from robolamp.emulator.bare_servos_file import BareServo, PendulumLoad
from robolamp.lamp import load_lamp
from robolamp.runtime.stop import StopRequest

MODEL = "XL330-M288-T"
ASSETS = Assets()
CALIBRATION = load_calibration(ASSETS)
NOMINAL = {**CALIBRATION.servo(MODEL, ""), "encoder_offset": 0.0}
FREE = (
    "torque_constant", "resistance", "armature", "viscous", "coulomb", "delay", "encoder_offset", "load_motor",
    "load_external",
)  # fmt: skip
"""Parameters of the two lowest rungs of the ladder."""

CHART = Chart(FREE, NOMINAL, switched_off(NOMINAL))
_SPREAD = 0.7  # of the truth around the priors' centres, in their standard deviations; cut at two of them
_VOLTS = (4.8, 5.2)  # of the supply: between the steps in which it is read, too


def known_servo(seed: int) -> tuple[BareServo, dict[str, float]]:
    """Return a servo with a pendulum, and the parameters it was drawn with."""
    rng = np.random.default_rng(seed)
    z = _SPREAD * np.clip(rng.standard_normal(len(FREE)), -2, 2)
    truth = {**switched_off(NOMINAL), **CHART.complete(z)}
    load = PendulumLoad(mass=0.2, length=0.1, swing=1.5, values=truth)
    volts = float(rng.uniform(*_VOLTS))
    return BareServo(MODEL, 1, 1_000_000, 0.0, np.pi, volts, 0.0, load), truth


def record_servo(folder: Path, servo: BareServo, names: Sequence[str] = ()) -> list[Recording]:
    """Record a servo as `robolamp calibrate record --servo` does.

    Args:
        folder: Where to.
        servo: With a pendulum.
        names: Steps of the procedure; all of them unless given.
    """
    bench = bench_lamp("known", servo, folder / "bench.toml")
    setup = Setup(ASSETS, load_lamp(ASSETS), CALIBRATION)
    steps: list[Step] = [step for step in bench_procedure(bench) if not names or step.name in names]
    session = Session(
        bench.lamp, CALIBRATION, ASSETS, folder, "emulator none", "", "2026-11-22", StopRequest(), servo=MODEL
    )
    record(session, steps, emulated_servo(setup, bench, "none"))
    return read_recordings([folder])
