"""The fault matrix: each kind of fault at seeded random moments of a hop, in lockstep; what became of it?

A fault is "noticed" if the run's log names one after it was injected. When and what was injected comes from the
emulator's injection log; what the servos heard, held and measured, and the state they are left in, from the emulator:

recovered      noticed, and the run went on to its end
stopped        noticed, the run ended early, or was refused at the start; torque is off and nothing moves (frozen:
               where a servo cannot be reached to the end, its Bus Watchdog stopped it, and the log says that its
               torque may be on)
no effect      not noticed, and nothing came of it: every goal reached its servo, every reading was true
NOT NOTICED    not noticed, and a goal or a reading was not what the log says
UNSAFE         torque on and not said, or the lamp moves after the end

Every instruction on the wire is decoded: a goal outside limits or slew is counted, whatever became of the run.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive, drive
from robolamp.cli.run.emulator_parts import InjectionLog
from robolamp.dynamixel.registers import RAD_PER_COUNT, Name
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import DAMAGES, Event, Faults, Rates
from robolamp.emulator.packet import Instruction, Parser
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import load_reality
from robolamp.errors import BusError
from robolamp.log.reader import Run, read_run
from robolamp.robot.connection import Connection
from robolamp.runtime.health import FOOT_AGE
from robolamp.runtime.stop import StopRequest

Draw = np.random.Generator
GOAL, DURATION = 0.30, 1.0  # m, s: soft start, two hops, soft landing; 4 s of lamp time
FIRST, LAST = 0.7, 3.6  # s: faults hit from the soft start to the soft landing
SETTLED, STILL = 4.0, 0.1  # s after the end until which a limp lamp may still sink by its weight; rad/s
ANGLE_ERROR, FORCE_ERROR = 3 * RAD_PER_COUNT, 0.01  # a reading that differs more from the truth is false [rad, N]
GOAL_REGISTER = 116


def _damage(what: str, stream: str) -> Callable[[Draw, float], Event]:
    def draw(random: Draw, at: float) -> Event:
        most = 40 if stream == "foot" else 6
        lasts = float(random.uniform(0.001, 0.1 if stream == "foot" else 0.03)) if what == "late" else 0.0
        packets = 1 if what == "late" else int(random.integers(1, most + 1))
        return Event(what, at=at, stream=stream, packets=packets, lasts=lasts)

    return draw


def _lasting(what: str, low: float, high: float, port: str = "servo") -> Callable[[Draw, float], Event]:
    return lambda random, at: Event(
        what, at=at, lasts=float(random.uniform(low, high)), servo=int(random.integers(1, 4)), port=port
    )


KINDS: Mapping[str, Callable[[Draw, float], Event]] = {
    **{f"{stream} {what}": _damage(what, stream) for stream in ("instruction", "status", "foot") for what in DAMAGES},
    "servo silent up to 0.08 s": _lasting("silent", 0.025, 0.08),
    "servo silent 0.15 to 1 s": _lasting("silent", 0.15, 1.0),
    "servo silent for good": _lasting("silent", 60.0, 60.1),
    "servo reboots": lambda random, at: Event("reboot", at=at, servo=int(random.integers(1, 4))),
    "servo loses its id": lambda random, at: Event(
        "id_lost", at=at, servo=int(random.integers(1, 4)), id=int(random.integers(1, 12))
    ),
    "servo overloaded": lambda random, at: Event("overload", at=at, servo=int(random.integers(1, 4))),
    "supply sags below 3.5 V": lambda random, at: Event(
        "sag", at=at, lasts=float(random.uniform(0.05, 1.0)), volts=float(random.uniform(1.7, 3.0))
    ),
    "servo port unplugged": _lasting("unplugged", 0.03, 1.0, port="servo"),
    "... and told to go on": _lasting("unplugged", 0.03, 3.0, port="servo"),
    "servo port gone for good": _lasting("unplugged", 60.0, 60.1, port="servo"),
    "foot port unplugged": _lasting("unplugged", 0.06, 1.0, port="foot"),
    "foot silent": _lasting("foot_silent", 0.08, 1.0),
    "foot stuck 1 s": _lasting("foot_stuck", 1.0, 1.01),
    "foot sends rubbish": _lasting("foot_rubbish", 0.02, 1.0),
    "1 % of each damage": lambda random, at: Event("late", at=at, lasts=0.005),
}


@dataclass
class Outcome:
    """What became of one run: its outcome, time from injection to the first fault in the log [s], goals outside."""

    kind: str
    seed: int
    outcome: str
    detected: float
    outside: int
    fell: bool
    ended: str
    why: str


class Witness:
    """Sees what is on the wire and what the servos hold and measure, apart from what any client says of it."""

    def __init__(self, world: EmulatedLamp, period: float) -> None:
        self.outside: list[str] = []
        self.rows: list[tuple[float, ...]] = []  # time, goal counts, angles, force
        self.fell = False
        self._joints = {joint.id: joint for joint in world.lamp.joints}
        self._last: dict[int, int] = {}
        self._step = {joint.id: joint.slew * period / RAD_PER_COUNT + 1.5 for joint in world.lamp.joints}
        self._parser = Parser()
        self._receive = world.receive
        world.receive = self._heard  # type: ignore[method-assign]
        world.watch(self._look)

    def _heard(self, data: bytes, at: float) -> list:
        for packet in self._parser.feed(data):
            raw = packet.parameters
            if int.from_bytes(raw[:2], "little") == GOAL_REGISTER:
                if packet.instruction == Instruction.SYNC_WRITE:
                    for i in range(4, len(raw), 5):
                        self._goal(raw[i], int.from_bytes(raw[i + 1 : i + 5], "little", signed=True), at)
                elif packet.instruction == Instruction.WRITE:  # goal := present, before torque goes on
                    self._last[packet.id] = int.from_bytes(raw[2:6], "little", signed=True)
        return self._receive(data, at)

    def _goal(self, servo: int, count: int, at: float) -> None:
        joint = self._joints[servo]
        angle = joint.sign * (count * RAD_PER_COUNT - joint.zero)
        step = abs(count - self._last.get(servo, count))
        self._last[servo] = count
        if not joint.lower - RAD_PER_COUNT <= angle <= joint.upper + RAD_PER_COUNT or step > self._step[servo]:
            self.outside.append(f"{joint.name} {angle:.3f} rad, step {step}, at {at:.3f} s")

    def _look(self, world: EmulatedLamp) -> None:
        held = [servo.register(Name.GOAL_POSITION) for servo in world.servos]
        self.rows.append((world.time, *held, *world.plant.angle, world.plant.force))
        self.fell = self.fell or world.plant.truth().fallen


def false_entry(run: Run, witness: Witness, lamp_zero: np.ndarray, lamp_sign: np.ndarray) -> str:
    """Return the first entry of the log that is not what the servos held or measured; empty: all are true."""
    rows = np.array(witness.rows)
    n = run.goal.shape[1]
    times, held, angle, force = rows[:, 0], rows[:, 1 : 1 + n], rows[:, 1 + n : 1 + 2 * n], rows[:, -1]
    ends = np.append(run.began[1:], run.write_done[-1] + 0.002)
    for tick in range(run.index.size):
        at = max(int(np.searchsorted(times, ends[tick] + 1e-9, "right")) - 1, 0)
        counts = np.round((lamp_zero + lamp_sign * run.goal[tick]) / RAD_PER_COUNT)
        if (held[at] != counts).any():
            return f"goal of tick {tick}"
        near = slice(*np.searchsorted(times, [run.began[tick] - 0.005, run.read_done[tick] + 0.005]))
        low, high = angle[near].min(axis=0) - ANGLE_ERROR, angle[near].max(axis=0) + ANGLE_ERROR
        if ((run.angle[tick] < low) | (run.angle[tick] > high)).any():
            return f"angle of tick {tick}"
        near = slice(*np.searchsorted(times, [run.began[tick] - FOOT_AGE - 0.005, run.read_done[tick] + 0.002]))
        if not force[near].min() - FORCE_ERROR <= run.foot_force[tick] <= force[near].max() + FORCE_ERROR:
            return f"force of tick {tick}"
    return ""


def script(kind: str, seed: int) -> tuple[Faults, bool]:
    """Return the fault script of one run, and whether the loop may go on after a replug."""
    random = np.random.default_rng([list(KINDS).index(kind), seed])
    event = KINDS[kind](random, float(random.uniform(FIRST, LAST)))
    if kind.startswith("1 %"):
        rates = Rates(*[0.01] * len(DAMAGES))
        return Faults(kind, seed, {"instruction": rates, "status": rates, "foot": rates}), False
    return Faults(kind, seed, events=(event,)), kind.startswith("...")


def one(job: tuple[str, int]) -> Outcome:
    """Do one run and judge it."""
    kind, seed = job
    setup = Setup.of(None, "nominal")
    faults, resume = script(kind, seed)
    controller = setup.controller("hop-counting", on_board=True)
    world = EmulatedLamp(
        setup.lamp, setup.calibration, setup.assets, load_reality("none", setup.lamp, setup.assets), faults=faults
    )
    witness = Witness(world, controller.control_period)
    with tempfile.TemporaryDirectory() as folder:
        injected, log = Path(folder) / "injections.jsonl", Path(folder) / "log.mcap"
        with closing(InjectionLog(injected)) as report:
            world.injector.report = report.write
            ports = Lockstep(world, setup.lamp.bus_baud)
            plan = Drive(setup, controller, GOAL, DURATION, "emulator", log, resume=resume)
            try:
                result = drive(plan, Connection(ports.servo_port, ports.foot_port, ports.clock, 0), StopRequest(), True)
            except BusError as error:  # refused before torque went on
                safe = not any(servo.register(Name.TORQUE_ENABLE) for servo in world.servos)
                outcome = "stopped" if safe else "UNSAFE"
                return Outcome(kind, seed, outcome, math.nan, len(witness.outside), witness.fell, "refused", str(error))
            ports.clock.sleep_until(ports.clock.now() + SETTLED)
        injections = [json.loads(line) for line in injected.read_text().splitlines()]
        run = read_run(log)
    ended = max([run.write_done[-1], *(at * 1e-9 for at, _, _ in run.events)])
    if not injections or injections[0]["time"] > ended:
        return Outcome(kind, seed, "not injected", math.nan, len(witness.outside), witness.fell, result.ended, "")
    began = injections[0]["time"]
    named = [float(at) for at, texts in zip(run.read_done, run.faults, strict=True) if texts and at >= began]
    named += [at * 1e-9 for at, level, _ in run.events if level != "info" and at * 1e-9 >= began]
    detected = min(named, default=math.nan) - began
    angles = np.array([row[4:7] for row in witness.rows[-50:]])
    moving = float(np.ptp(angles, axis=0).max()) / (50 * world.timestep) > STILL
    torque = [servo.register(Name.TORQUE_ENABLE) for servo in world.servos]
    tripped = [servo.register(Name.BUS_WATCHDOG) < 0 for servo in world.servos]
    left = [on and not stopped for on, stopped in zip(torque, tripped, strict=True)]
    said = any("torque may still be on" in text for _, _, text in run.events)
    why = result.reason
    if any(left) or (any(torque) and not said) or moving:
        outcome, why = "UNSAFE", f"torque {torque}, watchdog tripped {tripped}, moving {moving}; {why}"
    elif result.ended != "finished":
        outcome = ("frozen" if any(torque) else "stopped") if named else "NOT NOTICED"
    elif named:
        outcome = "recovered"
    else:
        zero = np.array([joint.zero for joint in setup.lamp.joints])
        sign = np.array([float(joint.sign) for joint in setup.lamp.joints])
        why = false_entry(run, witness, zero, sign)
        outcome = "NOT NOTICED" if why else "no effect"
    why = "; ".join([why, *witness.outside[:1]]) if witness.outside else why
    return Outcome(kind, seed, outcome, detected, len(witness.outside), witness.fell, result.ended, why)


def milliseconds(values: list[float], share: float) -> str:
    known = [value for value in values if math.isfinite(value)]
    return f"{np.percentile(known, share) * 1e3:7.1f}" if known else "      -"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100, help="runs of each kind (100)")
    parser.add_argument("--seed", type=int, default=0, help="of the first run; each further run has the next")
    parser.add_argument("--kind", action="append", choices=KINDS, help="only this kind; may be given several times")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--json", action="store_true", help="one JSON object a run, in place of the table")
    options = parser.parse_args()
    jobs = [(kind, options.seed + run) for kind in options.kind or KINDS for run in range(options.runs)]
    began = time.monotonic()
    columns = ("recovered", "stopped", "frozen", "no effect", "NOT NOTICED", "UNSAFE")
    if not options.json:
        heads = " ".join(f"{name:>11}" for name in columns)
        print(f"{'fault':<26}{heads} {'outside':>8} {'fell':>5}   detected after p50, max [ms]")
    found: list[Outcome] = []
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        for outcome in pool.map(one, jobs):
            found.append(outcome)
            if options.json:
                print(
                    json.dumps(
                        {**asdict(outcome), "detected": None if math.isnan(outcome.detected) else outcome.detected}
                    )
                )
            elif len(found) % options.runs == 0:
                rows = found[-options.runs :]
                counts = Counter(row.outcome for row in rows)
                cells = " ".join(f"{counts[name]:11}" for name in columns)
                times = [row.detected for row in rows]
                outside, fell = sum(row.outside for row in rows), sum(row.fell for row in rows)
                late = f"{milliseconds(times, 50)} {milliseconds(times, 100)}"
                print(f"{rows[0].kind:<26}{cells} {outside:8} {fell:5}   {late}", flush=True)
    bad = [row for row in found if row.outcome not in columns[:4] or row.outside]
    for row in bad:
        print(f"{row.kind}, seed {row.seed}: {row.outcome}: {row.why}", file=sys.stderr)
    if not options.json:
        print(
            f"{len(found)} runs in {time.monotonic() - began:.0f} s; {len(bad)} of them not noticed, unsafe or outside"
        )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
