"""Are verdicts true? Sixty runs whose outcome is known: twenty good, twenty that miss, twenty that are broken.

    python benchmarks/verdicts.py [--workers 2] [--seed 1]

Each run is one of the emulated lamp in lockstep, through driver, bus, loop and log as in `robolamp dry-run --lockstep`,
and is judged as `robolamp compare` judges it. What is true is read by this script from the truth log alone: at rest
(5 mm at most in the controller's last half second) within 15 mm of the goal, upright, not fallen.

- good: lamps that hardly differ from the twin (noise, 1 % of strength, 3 % of friction), sent where `hop-counting`
  lands within 1 cm on the twin.
- misses: lamps drawn by `--reality random:SEED:SCALE`, the realities loose and worn, and controllers that ask for
  constant angles.
- broken: faults on the bus and at the foot, runs that were stopped, killed, or cut before the controller drove, and
  falls.

A draw that truth sorts otherwise (a good lamp that misses, a random one that hits, a fault that does no harm) is passed
over for the next seed of its place; the table names the seeds. Exit code 1 if a bad run is "done" and "inside", if
fewer than 18 good ones are, or if "cannot say" stands more than six times or without its reason.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive, drive
from robolamp.cli.run.lockstep import LockstepLamp
from robolamp.compare.compare_logs import compare_log
from robolamp.controller.terminals import all_terminals
from robolamp.emulator.faults.script import DAMAGES, Event, Faults, Rates
from robolamp.emulator.reality.file import Reality, load_reality
from robolamp.errors import BusError, FileError
from robolamp.log.reader import Run, Truth, read_run, read_truth
from robolamp.runtime.stop import StopRequest
from robolamp.signals import Clock
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.fleet import Fleet, Job

Random = np.random.Generator
DURATION = 8.0  # s: time for goals to 60 cm
STARTED = 2.1  # s of lamp time: the soft start is over, the controller drives
HIT, REST, TILT = 0.015, 0.005, np.radians(15)  # m, m in the last half second, rad
GOOD, MISS, BROKEN = "good", "miss", "broken"
CELLS = ("done, inside", "done, outside", "not done, inside", "not done, outside", "cannot say")
TRIES = 60  # seeds of one place: of lamps drawn at random few fall


@dataclass(frozen=True)
class Trial:
    """One run that is to be made.

    Attributes:
        what: In words.
        goal: Where it is sent [m].
        reality: How the lamp differs from its twin.
        constant: Angles that its controller asks for [rad]; None: it is `hop-counting`.
        faults: What goes wrong.
        stop: When somebody stops it, on the lamp's clock [s].
        killed: Whether the log is one that a killed process left.
    """

    what: str
    goal: float
    reality: Reality
    constant: tuple[float, float, float] | None = None
    faults: Faults | None = None
    stop: float = np.inf
    killed: bool = False


@dataclass(frozen=True)
class Row:
    """What came of a run: the truth, and the verdict."""

    group: str
    what: str
    seed: int
    passed: int
    goal: float
    landed: float
    hit: bool
    fell: bool
    task: str
    verdict: str
    alone: float
    why: str

    @property
    def cell(self) -> str:
        """Return its column of the small table."""
        if "cannot say" in (self.task, self.verdict):
            return "cannot say"
        return f"{self.task}, {'inside' if self.verdict == 'inside' else 'outside'}"

    @property
    def praised(self) -> bool:
        return self.cell == "done, inside"


class Timed(StopRequest):
    """Somebody who asks for a stop at a time of the lamp's clock."""

    clock: Clock
    at = np.inf

    @property
    def requests(self) -> int:
        return int(self.clock.now() >= self.at)


def _nearly(random: Random, setup: Setup) -> Reality:
    """Return a lamp that hardly differs from its twin."""
    none, n = Reality.none(setup.lamp), len(setup.lamp.joints)
    return replace(
        none,
        name="nearly the twin",
        seed=int(random.integers(2**31)),
        strength=np.exp(random.normal(0.0, 0.01, n)),
        friction=np.exp(random.normal(0.0, 0.03, n)),
        encoder_noise=random.uniform(0.0, 1e-3, n),
        foot_noise=float(random.uniform(0.0, 0.02)),
        jitter=float(random.uniform(0.0, 0.2e-3)),
        mass=float(np.exp(random.normal(0.0, 0.005))),
        floor_friction=float(np.exp(random.normal(0.0, 0.03))),
    )


def good(random: Random, setup: Setup) -> Trial:
    """Draw a good run."""
    goals = np.arange(0.05, 0.605, 0.01)
    hop = setup.controller("hop-counting", on_board=True)
    fleet = Fleet([build(setup.lamp, setup.calibration, setup.assets)], hop.control_period, 1)
    program = hop.compile(all_terminals(len(setup.lamp.joints)))
    outcome = fleet.run([program], [Job(0, 0, float(goal)) for goal in goals], DURATION)
    near = goals[np.abs(outcome.error) <= 0.01]
    return Trial("nearly the twin", float(random.choice(near)), _nearly(random, setup))


def of_reality(name: str) -> Callable[[Random, Setup], Trial]:
    """Return what draws a run on a lamp of a reality; `{}` in its name is a seed."""

    def draw(random: Random, setup: Setup) -> Trial:
        drawn = name.format(int(random.integers(1, 100_000)))
        return Trial(drawn, _goal(random), load_reality(drawn, setup.lamp, setup.assets))

    return draw


def constant(share: float) -> Callable[[Random, Setup], Trial]:
    """Return what draws a controller that asks for constant angles, up to a share of the limits."""

    def draw(random: Random, setup: Setup) -> Trial:
        low, high = np.array(setup.lamp.lower), np.array(setup.lamp.upper)
        angles = np.round(share * random.uniform(low, high), 3) + 0.0
        said = " ".join(f"{angle:g}" for angle in angles)
        return Trial(f"constant {said}", _goal(random), _nearly(random, setup), tuple(angles.tolist()))

    return draw


def faulty(make: Callable[[Random, float], Event], first: float = STARTED, last: float = 4.0):
    """Return what draws a run with an event that begins between two times of the lamp's clock [s]."""

    def draw(random: Random, setup: Setup) -> Trial:
        event = make(random, float(random.uniform(first, last)))
        faults = Faults("one", int(random.integers(2**31)), events=(event,))
        return Trial(f"{event.what} at {event.at:.1f} s", _goal(random), _nearly(random, setup), faults=faults)

    return draw


def rough(random: Random, setup: Setup) -> Trial:
    """Draw a run on a line that damages 2 % of all packets in each way."""
    rates = Rates(*[0.02] * len(DAMAGES))
    faults = Faults("rough", int(random.integers(2**31)), dict.fromkeys(("instruction", "status", "foot"), rates))
    return Trial("2 % of each damage", _goal(random), _nearly(random, setup), faults=faults)


def stopped(random: Random, setup: Setup) -> Trial:
    """Draw a run that somebody stops."""
    at = float(random.uniform(STARTED + 0.3, STARTED + 1.5))
    return Trial(f"stopped at {at:.1f} s", float(random.uniform(0.4, 0.6)), _nearly(random, setup), stop=at)


def killed(random: Random, setup: Setup) -> Trial:
    """Draw a run whose process is killed."""
    return Trial("killed on the way", float(random.uniform(0.4, 0.6)), _nearly(random, setup), killed=True)


def _goal(random: Random) -> float:
    return float(np.round(random.uniform(0.10, 0.60), 2))


def _lasts(what: str, low: float, high: float, **keys) -> Callable[[Random, float], Event]:
    return lambda random, at: Event(
        what, at=at, lasts=float(random.uniform(low, high)), servo=int(random.integers(1, 4)), **keys
    )


FALLING = of_reality("random:{}:1.5"), constant(1.0), constant(1.0), constant(0.8), constant(0.8)
PLACES: tuple[tuple[str, Callable[[Random, Setup], Trial]], ...] = (
    *[(GOOD, good)] * 20,
    *[(MISS, of_reality(f"random:{{}}:{scale:g}")) for scale in (0.1, 0.3, 0.5, 0.5, 1.0, 1.0, 1.0, 1.5, 2.0)],
    *[(MISS, of_reality(name)) for name in ("loose", "loose", "loose", "worn", "worn")],
    *[(MISS, constant(share)) for share in (0.0, 0.2, 0.3, 0.3, 0.5, 0.5)],
    (BROKEN, faulty(_lasts("silent", 0.03, 0.08))),
    (BROKEN, faulty(_lasts("silent", 0.15, 1.0))),
    (BROKEN, faulty(_lasts("unplugged", 0.2, 1.0, port="servo"))),
    (BROKEN, faulty(_lasts("foot_silent", 0.15, 1.0))),
    (BROKEN, faulty(_lasts("foot_stuck", 0.8, 1.5))),
    (BROKEN, faulty(_lasts("foot_rubbish", 0.3, 1.0))),
    (BROKEN, faulty(lambda random, at: Event("reboot", at=at, servo=int(random.integers(1, 4))))),
    (BROKEN, faulty(lambda random, at: Event("overload", at=at, servo=int(random.integers(1, 4))))),
    (BROKEN, faulty(lambda random, at: Event("sag", at=at, lasts=0.5, volts=float(random.uniform(1.7, 3.0))))),
    (BROKEN, rough),
    (BROKEN, rough),
    (BROKEN, stopped),
    (BROKEN, stopped),
    (BROKEN, killed),
    (BROKEN, faulty(_lasts("silent", 60.0, 61.0), 0.7, 1.8)),
    *[(BROKEN, draw) for draw in FALLING],
)
"""Whose turn it is, and what draws it."""


def run(setup: Setup, trial: Trial, folder: Path) -> tuple[Run, Truth]:
    """Make a run; returns its log and its truth."""
    hop, text = setup.controller("hop-counting", on_board=True), ""
    if trial.constant is not None:
        rows = "\n".join(f'{name} = "{value!r}"' for name, value in zip(setup.lamp.names, trial.constant, strict=True))
        text = 'schema = 1\nname = "constant"\ntask = "none"\ndrive = "position"\ncontrol_period = 0.02\n'
        (folder / "constant.toml").write_text(f"{text}terminals = []\n\n[joints]\n{rows}\n")
        hop = setup.controller(str(folder / "constant.toml"), on_board=True)
    log, truth = folder / "log.mcap", folder / "truth.mcap"
    plan, stop = Drive(setup, hop, trial.goal, DURATION, "emulator", log), Timed()
    with LockstepLamp(setup, trial.reality, trial.faults or Faults("none"), truth, None) as lamp:
        stop.clock, stop.at = lamp.ports.clock, trial.stop
        drive(plan, lamp.ports, stop, True)
    return kill(log) if trial.killed else read_run(log), read_truth(truth)


def kill(log: Path) -> Run:
    """Leave of a log what a process that was killed while the controller drove would have left."""
    whole = log.read_bytes()
    for share in np.arange(0.9, 0.1, -0.02):
        log.write_bytes(whole[: round(share * len(whole))])
        with contextlib.suppress(FileError):
            left = read_run(log)
            if left.phase[-1] == "run" and left.truncated:
                return left
    raise FileError("has no part that ends while the controller drives", str(log))


def judge(run: Run, truth: Truth) -> tuple[float, bool, bool]:
    """Return where the lamp landed [m], whether that was a hit, and whether it fell; the log gives the times alone."""
    at = run.at(truth.log_time)
    driven = np.flatnonzero(run.phase == "run")
    begin = float(run.scheduled[driven[0]] if driven.size else run.began[0])
    stop = float(run.scheduled[driven[-1]] if driven.size else run.write_done[-1]) + 0.02
    end = float(run.write_done[-1])
    x, pitch = np.interp([begin, end], at, truth.base_x), float(np.interp(end, at, truth.pitch))
    resting = truth.base_x[(at >= stop - 0.5) & (at <= stop)]
    fell, landed = bool(truth.fallen[(at >= begin) & (at <= end)].any()), float(x[1] - x[0])
    still = bool(np.ptp(resting) <= REST) and abs(pitch) <= TILT and not fell
    return landed, still and abs(landed - run.goal_m) <= HIT, fell


def one(job: tuple[int, int]) -> Row:
    """Fill one place: draw until truth agrees that the run belongs there."""
    place, first = job
    group, draw = PLACES[place]
    setup = Setup.of(None, "nominal")
    for passed in range(TRIES):
        seed = 1000 * first + 20 * place + passed
        trial = draw(np.random.default_rng(seed), setup)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            try:
                log, truth = run(setup, trial, folder)
            except (BusError, FileError):
                continue  # refused before a tick, or its log has no part to be killed in: there is no run
            landed, hit, fell = judge(log, truth)
            if hit != (group == GOOD) or (draw in FALLING and not fell):
                continue
            found = compare_log(
                folder / "log.mcap", truth=folder / "truth.mcap", assets=setup.assets, calibration=setup.calibration,
                out=folder / "report.html", diagnosis=False,
            )  # fmt: skip
        why = [*(found.task.why if found.task.word != "done" else ()), "|", *found.judged.why]
        return Row(
            group, trial.what, seed, passed, trial.goal, landed, hit, fell, found.task.word, found.verdict,
            found.alone.travel, "; ".join(why).replace("; |", " |").lstrip("; "),
        )  # fmt: skip
    raise RuntimeError(
        f"place {place} ({group}): {TRIES} seeds from {1000 * first + 20 * place} on do not give such a run"
    )


def told(row: Row) -> str:
    fell = "fell" if row.fell else "hit" if row.hit else "miss"
    return (
        f"{row.group:<7} {row.what:<26} {row.seed:>5} {row.goal * 100:5.0f} {row.landed * 100:7.1f} {fell:<5} "
        f"{row.alone * 100:6.1f}  {row.task:<10} {row.verdict:<10} {row.why}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--seed", type=int, default=1, help="of the whole draw (1)")
    options = parser.parse_args()
    began = time.monotonic()
    print("                                          goal  landed         alone")
    print("group   what                        seed    cm      cm truth     cm  task       twin       why")
    rows: list[Row] = []
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        for row in pool.map(one, [(place, options.seed) for place in range(len(PLACES))]):
            rows.append(row)
            print(told(row), flush=True)
    bad, fine = [row for row in rows if row.group != GOOD], [row for row in rows if row.group == GOOD]
    unsure = [row for row in rows if "cannot say" in (row.task, row.verdict)]
    print(f"{'':<7} {'of':>3} {' '.join(f'{name:>19}' for name in CELLS)}")
    for group in (GOOD, MISS, BROKEN):
        own = [row for row in rows if row.group == group]
        print(f"{group:<7} {len(own):3} {' '.join(f'{sum(row.cell == name for row in own):19}' for name in CELLS)}")
    praised = sum(row.praised for row in fine), sum(row.praised for row in bad)
    print(
        f"done and inside: {praised[0]} of {len(fine)} good runs, {praised[1]} of {len(bad)} bad ones; cannot say: "
        f"{len(unsure)} times; {sum(row.passed for row in rows)} draws passed over; {time.monotonic() - began:.0f} s"
    )
    silent = [row for row in unsure if len(row.why) < 3]
    return 0 if praised[0] >= 18 and not praised[1] and len(unsure) <= 6 and not silent else 1


if __name__ == "__main__":
    sys.exit(main())
