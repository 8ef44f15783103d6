"""Bends the emulator's reality one knob at a time and counts how often `compare` names the bent knob first.

    python benchmarks/diagnosis.py [--draws 20] [--processes 2] [--seed 1]

A draw is a run of `hop-counting` to 30 cm on the emulated lamp in lockstep (driver, bus, foot sensor, loop and log as
in `robolamp dry-run`), with one knob of the reality bent by a random size and everything else as calibrated. Sizes are
uniform over the ranges in KINDS, either way where there are two. Named means: the first entry of the diagnosis is of
that kind, at that joint.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.compare.causes.evidence import Evidence
from robolamp.compare.causes.ranking import explain
from robolamp.compare.causes.words import diagnose
from robolamp.controller.controller_file import load_controller
from robolamp.controller.pilot import Pilot
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import Reality
from robolamp.lamp import load_lamp
from robolamp.log.reader import read_run
from robolamp.log.run_context import run_context
from robolamp.log.schemas import ANSWER_WIRE
from robolamp.log.writer import LogWriter
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.runtime.loop import run

GOAL = 0.30
DURATION = 4.0  # the hops to 30 cm take 2 s

# kind: (key of Reality, smallest and largest size, both ways, per joint, kind that the diagnosis calls it)
KINDS = {
    "line latency": ("latency", 0.0005, 0.0020, False, False, "latency"),
    "joint strength": ("strength", 0.04, 0.20, True, True, "strength"),
    "joint friction": ("friction", 0.15, 0.60, True, True, "friction"),
    "encoder noise": ("encoder_noise", 0.001, 0.005, False, True, "encoder noise"),
    "supply resistance": ("resistance", 0.05, 0.50, False, False, "resistance"),
    "supply drain": ("drain", 0.02, 0.10, False, False, "drain"),
    "foot gain": ("foot_gain", 0.05, 0.30, True, False, "foot gain"),
    "foot offset": ("foot_offset", 0.05, 0.50, True, False, "foot offset"),
    "foot drift": ("foot_drift", 0.01, 0.10, True, False, "foot drift"),
    "floor friction": ("floor_friction", 0.10, 0.40, True, False, "floor"),
    "mass": ("mass", 0.02, 0.15, True, False, "mass"),
}
_ABOUT_ONE = ("strength", "friction", "foot_gain", "floor_friction", "mass")

assets = Assets()
lamp = load_lamp(assets)
calibration = load_calibration(assets)


def draw(kind: str, number: int, seed: int) -> tuple[Reality, str, float]:
    """Return a reality, what it should be called, and the size it was bent by."""
    key, low, high, both, each, called = KINDS[kind]
    random = np.random.default_rng([seed, list(KINDS).index(kind), number])
    size = float(random.uniform(low, high)) * (random.choice([-1, 1]) if both else 1)
    value = 1 + size if key in _ABOUT_ONE else size
    straight = Reality.none(lamp)
    if not each:
        return replace(straight, **{key: value}, seed=number), called, size
    joint = int(random.integers(len(lamp.names)))
    values = getattr(straight, key).copy()
    values[joint] = value
    return replace(straight, **{key: values}, seed=number), f"{called} {lamp.names[joint]}", size


def record(reality: Reality, path: Path) -> None:
    """Write the log of one run on the emulated lamp."""
    controller = load_controller(
        assets.named("hop-counting", "sim/lamp/controllers", "controller"), lamp, on_board=True
    )
    ports = Lockstep(EmulatedLamp(lamp, calibration, assets, reality), lamp.bus_baud)
    robot = RobotLamp(lamp, ports.servo_port, ports.foot_port, ports.clock)
    pilot = Pilot(controller, lamp, GOAL)
    context = run_context(
        backend="emulator", lamp=lamp, calibration=calibration, controller=controller.source,
        controller_name=controller.name, terminals=pilot.terminals, goal=GOAL,
        control_period=controller.control_period,
    )  # fmt: skip
    robot.open()
    context[ANSWER_WIRE] = repr(robot.answer_wire_time)
    with LogWriter(path, context=context, joints=lamp.names, epoch=0, lossless=True) as log:
        run(robot, pilot, lamp, period=controller.control_period, duration=DURATION, on_tick=log.tick)
    robot.close()


def trial(kind: str, number: int, seed: int) -> tuple[str, str, float, str, float, float, float]:
    """Return what was bent and by how much, and what was named first and of what size, its share, and the time."""
    reality, called, size = draw(kind, number, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        record(reality, path)
        began = time.perf_counter()
        log = read_run(path)
        found = diagnose(log, explain(Evidence(log, lamp, calibration, assets), lamp), (), calibration, lamp)
        took = time.perf_counter() - began
    if not found:
        return kind, called, size, "nothing", 0.0, 0.0, took
    first = found[0]
    if kind == "line latency" and first.knob == "delay":
        called = "delay"  # goal angles take effect later: either name is right
    return kind, called, size, first.knob, first.size, first.share, took


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS), metavar="KIND")
    parser.add_argument("--each", action="store_true", help="print every draw")
    options = parser.parse_args()
    jobs = [(kind, number, options.seed) for number in range(options.draws) for kind in options.kinds]
    results = []
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
        for result in pool.map(trial, *zip(*jobs, strict=True)):
            results.append(result)
            if options.each:
                kind, called, size, named, found, share, took = result
                mark = "" if called == named else "  <--"
                line = f"{kind:18} {called:20} {size:+8.4f}  {named:20} {found:+8.4f} {share:6.1%} {took:5.1f} s{mark}"
                print(line, flush=True)
    print(f"\n{'bent':18} {'named first':>12}  {'size off (median)':>18}  else named")
    good = 0
    for kind in options.kinds:
        own = [result for result in results if result[0] == kind]
        right = [result for result in own if result[1] == result[3]]
        off = np.median([abs(found / size - 1) for _, _, size, _, found, *_ in right]) if right else float("nan")
        others = Counter(named for _, called, _, named, *_ in own if called != named)
        good += 2 * len(right) > len(own)
        told = ", ".join(f"{name} ({count})" for name, count in others.most_common(4))
        print(f"{kind:18} {f'{len(right)} of {len(own)}':>12}  {off:18.0%}  {told}")
    print(f"\nnamed first in most draws: {good} of {len(options.kinds)} kinds; seed {options.seed}")


if __name__ == "__main__":
    main()
