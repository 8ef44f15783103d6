"""Are verdicts and causes true where lamp and twin bend? Emulated lamps of calibration/bending.toml against its twin.

    python benchmarks/bending_verdicts.py [--calibration bending] [--kinds hair strength ...] [--draws 6] [--workers 2]

Each run is one of the emulated lamp in lockstep, as in `robolamp dry-run hop-bending --calibration bending
--lockstep`, and is judged as `robolamp compare` judges it. Nothing is wrong with the lamps of four kinds: none (the
twin to the number), hair (a jitter of 0.1 ms, noise of 0.2 mrad), replug (the servos' port is unplugged for a while)
and nearly (1 % of strength, 3 % of friction and noise: `benchmarks/verdicts.py`). In the others one number is another.
A row says how many runs were inside, outside and "cannot say", in how many a cause was named that is a knob, and in how
many the first such cause was the number that is another. With `--calibration nominal` lamp and twin are rigid, and
`hop-counting` hops.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from verdicts import DURATION, Timed, _nearly

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive, drive
from robolamp.cli.run.lockstep import LockstepLamp
from robolamp.compare.compare_logs import compare_log
from robolamp.emulator.faults.script import Event, Faults
from robolamp.emulator.reality.file import Reality, load_reality

Random = np.random.Generator
Draw = Callable[[Random, Setup], tuple[Reality, str]]


def _none(setup: Setup) -> Reality:
    return Reality.none(setup.lamp)


def _joint(key: str, about: float, draw: Callable[[Random], float], called: str, joint: int = -1) -> Draw:
    """Return what draws a lamp with another number at one joint, and the cause that it should be called."""

    def of(random: Random, setup: Setup) -> tuple[Reality, str]:
        names = setup.lamp.names
        index = int(random.integers(len(names))) if joint < 0 else joint
        values = np.full(len(names), about)
        values[index] = draw(random)
        return replace(_none(setup), **{key: values}), f"{called} {names[index]}"

    return of


def _whole(key: str, draw: Callable[[Random], float], called: str) -> Draw:
    return lambda random, setup: (replace(_none(setup), **{key: draw(random)}), called)


def _either(random: Random, low: float, high: float) -> float:
    return float(random.choice([-1, 1]) * random.uniform(low, high))


def _hair(random: Random, setup: Setup) -> tuple[Reality, str]:
    seed, noise = int(random.integers(2**31)), np.full(len(setup.lamp.joints), 2e-4)
    return replace(_none(setup), seed=seed, encoder_noise=noise, jitter=1e-4), ""


def _random(random: Random, setup: Setup) -> tuple[Reality, str]:
    return load_reality(f"random:{int(random.integers(1, 100_000))}:1", setup.lamp, setup.assets), ""


KINDS: dict[str, Draw] = {
    "none": lambda random, setup: (_none(setup), ""),
    "nearly": lambda random, setup: (_nearly(random, setup), ""),
    "replug": lambda random, setup: (_none(setup), ""),
    "strength": _joint("strength", 1.0, lambda random: 1 + _either(random, 0.08, 0.2), "strength"),
    "weakknee": _joint("strength", 1.0, lambda random: 1 - float(random.uniform(0.08, 0.2)), "strength", 1),
    "zero": _joint("encoder_offset", 0.0, lambda random: _either(random, 0.02, 0.06), "zero"),
    "slope": _whole("floor_tilt", lambda random: _either(random, 0.02, 0.06), "slope"),
    "floor": _whole("floor_friction", lambda random: 1 - float(random.uniform(0.2, 0.5)), "floor"),
    "mass": _whole("mass", lambda random: 1 + _either(random, 0.05, 0.15), "mass"),
    "friction": _joint("friction", 1.0, lambda random: 1 + float(random.uniform(0.3, 0.8)), "friction"),
    "random": _random,
    "hair": _hair,
}


def one(job: tuple[str, str, int, int]) -> tuple[str, str, str, str, float]:
    """Make a run and judge it: its kind, what its cause should be called, what it is, the verdict, how long it took."""
    calibration, kind, number, seed = job
    setup, order = Setup.of(None, calibration), list(KINDS).index(kind)
    random = np.random.default_rng([seed, order, number])
    goal = float(np.round(0.10 + 0.45 * ((number * 0.618 + 0.1 * order) % 1), 2))
    reality, called = KINDS[kind](random, setup)
    events = ()
    if kind == "replug":
        at, lasts = float(random.uniform(2.6, 5.0)), float(random.uniform(0.2, 1.5))
        events = (Event("unplugged", at=at, lasts=lasts, port="servo"),)
    name = "hop-bending" if calibration == "bending" else "hop-counting"
    with tempfile.TemporaryDirectory() as folder:
        log, truth = Path(folder) / "log.mcap", Path(folder) / "truth.mcap"
        controller = setup.controller(name, on_board=True)
        plan = Drive(setup, controller, goal, DURATION, "emulator", log, resume=kind == "replug")
        stop = Timed()
        with LockstepLamp(setup, reality, Faults("one", number, events=events), truth, None) as lamp:
            stop.clock = lamp.ports.clock
            drive(plan, lamp.ports, stop, True)
        began = time.monotonic()
        found = compare_log(
            log, truth=truth, assets=setup.assets, calibration=setup.calibration, out=Path(folder) / "report.html"
        )
        took = time.monotonic() - began
    knobs = [cause.knob for cause in found.diagnosis if cause.knob and "noise" not in cause.knob]
    return kind, called, knobs[0] if knobs else "", found.verdict, took


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calibration", default="bending")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS), metavar="KIND")
    parser.add_argument("--draws", type=int, default=6)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    jobs = [
        (options.calibration, kind, number, options.seed) for kind in options.kinds for number in range(options.draws)
    ]
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        rows = list(pool.map(one, jobs))
    print(
        f"{'':10} {'of':>3} {'inside':>7} {'outside':>8} {'cannot say':>11} {'named':>6} {'right':>6}  seconds (median)"
    )
    for kind in options.kinds:
        own = [row for row in rows if row[0] == kind]
        verdicts = [row[3] for row in own]
        print(
            f"{kind:10} {len(own):3} {verdicts.count('inside'):7} {verdicts.count('outside'):8} "
            f"{verdicts.count('cannot say'):11} {sum(bool(row[2]) for row in own):6} "
            f"{sum(row[2] == row[1] != '' for row in own):6}  {np.median([row[4] for row in own]):.1f}"
        )


if __name__ == "__main__":
    main()
