"""Whether what is simulated depends on the step: where a hop lands at h, h/2 and h/4, rigid and with springs and play.

    python benchmarks/convergence.py [--starts 20] [--stiffness 20 100 inf] [--play 0 5] [--steps 1 0.5 0.25]
    python benchmarks/convergence.py --knobs [--starts 20]
    python benchmarks/convergence.py --cost
    python benchmarks/convergence.py --record hop-counting

The lamp is sent the goals of a hop that was recorded once for 20, 40 and 60 cm (tests/data/frozen_hop.csv), so nothing
but the physics decides where it lands. Each line is a lamp and a step: the median landing [cm] over slightly different
starts and, where some fell, how many. Landings of the lamps that are chaotic differ by their starts; the column after
each says by how much (standard deviation). `--knobs` bends the rigid lamp in one other thing at a time, as the file of
a reality can, near the ends of what lamps of one design differ by. `--cost` tells how long a fleet of lamps takes that
bend and have play, by a rigid one's time: medians of six runs in turn. `--record` writes the goals anew, from a
controller that hops on the nominal lamp: for a lamp whose model has changed.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import load_controller
from robolamp.errors import RobolampError
from robolamp.files import write_atomic
from robolamp.lamp import load_lamp
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.fleet import Fleet, Job

GOALS = (0.2, 0.4, 0.6)
"""How far the recorded hops were sent [m]."""

PERIOD = 0.02
"""Of the recorded goals [s]."""

_NUDGE = 0.02  # rad: by how much the first goals of the starts differ, from first to last
_NUDGED = 5  # ticks
_UPRIGHT = math.cos(math.radians(70.0))

KNOBS: dict[str, tuple[float, float]] = {
    "strength": (0.8, 1.2), "friction": (0.5, 2.0), "coulomb": (0.5, 2.0), "viscous": (0.5, 2.0),
    "stribeck": (0.5, 2.0), "stribeck_velocity": (0.5, 2.0), "load_friction": (0.5, 1.5),
    "armature": (0.7, 1.5), "link_mass": (0.9, 1.1),
    "mass": (0.9, 1.1), "delay": (-0.003, 0.003), "supply": (-0.5, 0.5), "floor_friction": (0.5, 1.5),
    "floor_tilt": (-0.03, 0.03), "floor_softness": (1.5, 3.0),
}  # fmt: skip
"""What is tried of each attribute of `Bend`."""

Array = NDArray[np.float64]


_FROZEN = Path(__file__).resolve().parents[1] / "tests/data/frozen_hop.csv"
_SECONDS = 8.0  # that are recorded


def frozen_hop(goal: float) -> Array:
    """Return the goals of the hop that was sent to a goal of `GOALS`, shape (ticks, 3) [rad]."""
    first = 3 * GOALS.index(goal)
    return np.loadtxt(_FROZEN, delimiter=",", skiprows=1)[:, first : first + 3]


def record(name: str) -> None:
    """Write what a controller sends on the nominal lamp, to each of `GOALS`."""
    controller = load_controller(Assets().named(name, "sim/lamp/controllers", "controller"), load_lamp(Assets()))
    twin = build(load_lamp(Assets()), load_calibration(Assets()), Assets())
    program = controller.compile(controller.terminals)
    jobs = [Job(0, 0, goal) for goal in GOALS]
    trace = Fleet([twin], PERIOD).run([program], jobs, _SECONDS, record=True).trace
    assert trace is not None
    columns = ",".join(f"{joint}_{goal * 100:.0f}" for goal in GOALS for joint in twin.lamp.names)
    rows = [",".join(f"{angle:.4f}" for angle in row) for row in np.concatenate(trace.goals, axis=1)]
    write_atomic(_FROZEN, "\n".join([columns, *rows, ""]))


def lamp(step: float, stiffness: float = math.inf, play: float = 0.0) -> TwinModel:
    """Return the nominal lamp with other gears.

    Args:
        step: Physics step [s].
        stiffness: Between each servo and what it turns [Nm/rad].
        play: Of each joint [rad].
    """
    assets = Assets()
    bend = Bend(backlash=play, stiffness=stiffness)
    return build(load_lamp(assets), load_calibration(assets), assets, bend, timestep=step)


def bent(step: float, knob: str, value: float) -> TwinModel:
    """Return the nominal lamp with one thing changed.

    Args:
        step: Physics step [s].
        knob: An attribute of `Bend`.
        value: Of it.
    """
    assets = Assets()
    return build(load_lamp(assets), load_calibration(assets), assets, Bend(**{knob: value}), timestep=step)


def landings(twin: TwinModel, goal: float, starts: int = 1) -> Array:
    """Return where a lamp lands, from slightly different starts, shape (starts,) [m]; NaN where it falls."""
    fleet, goals = Fleet([twin], PERIOD, 1), frozen_hop(goal)
    found = []
    for start in range(starts):
        sent = goals.copy()
        sent[:_NUDGED] += _NUDGE * (start / max(starts - 1, 1) - 0.5) if starts > 1 else 0.0
        qpos = fleet.play(Job(0, 0, goal), sent, len(sent))
        upright = 1.0 - 2.0 * (qpos[:, 4] ** 2 + qpos[:, 5] ** 2)
        found.append(qpos[-1, 0] - qpos[0, 0] if upright.min() > _UPRIGHT else math.nan)
    return np.array(found)


def cost() -> None:
    """Print what springs and play cost a fleet, by a rigid one's time."""
    controller = load_controller(
        Assets().named("hop-bending", "sim/lamp/controllers", "controller"), load_lamp(Assets())
    )
    program, jobs = controller.compile(controller.terminals), [Job(0, 0, 0.3 + 0.001 * lane) for lane in range(100)]
    lamps = {"rigid": (math.inf, 0.0), "bends": (23.0, 0.0), "bends and has play": (23.0, 0.005)}
    fleets = {name: Fleet([lamp(0.002, *gears)], PERIOD) for name, gears in lamps.items()}
    took: dict[str, list[float]] = {name: [] for name in fleets}
    for turn in range(7):
        for name, fleet in fleets.items():
            before, began = fleet.steps, time.perf_counter()
            fleet.run([program], jobs, 4.0)
            if turn:  # the first one compiles
                took[name].append((time.perf_counter() - began) / (fleet.steps - before))
    for name, seconds in took.items():
        print(f"{name:30}{np.median(seconds) / np.median(took['rigid']):6.2f}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--stiffness", type=float, nargs="+", default=[20, 40, 100, 200, 400, 1000, 10_000, math.inf])
    parser.add_argument("--play", type=float, nargs="+", default=[0, 2, 5, 10], help="[mrad]")
    parser.add_argument("--steps", type=float, nargs="+", default=[2, 1, 0.5], help="[ms]")
    parser.add_argument("--knobs", action="store_true", help="the other things that a reality changes")
    parser.add_argument("--record", metavar="CONTROLLER", help="write the goals anew: those it sends")
    parser.add_argument("--cost", action="store_true", help="what springs and play cost, by a rigid fleet's time")
    options = parser.parse_args()
    if options.cost:
        cost()
        return
    if options.record:
        try:
            record(options.record)
        except RobolampError as error:
            parser.error(str(error))
        return
    print(f"{'':30}step [ms]" + "".join(f"{goal * 100:14.0f} cm" for goal in GOALS))
    if options.knobs:
        for knob, values in KNOBS.items():
            for value in values:
                compare(f"{knob} {value:g}", options, lambda step, k=knob, v=value: bent(step, k, v))
        return
    for stiffness in options.stiffness:
        for play in options.play:
            compare(
                f"{stiffness:g} Nm/rad, {play:g} mrad", options,
                lambda step, k=stiffness, p=play: lamp(step, k, p / 1e3),
            )  # fmt: skip


def compare(name: str, options: argparse.Namespace, make: Callable[[float], TwinModel]) -> None:
    """Print a line for each step [ms] of a lamp."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for step in options.steps:
            twin = make(step / 1e3)
            found = pool.map(lambda goal, twin=twin: landings(twin, goal, options.starts), GOALS)
            print(f"{name:30}{step:9g}" + "".join(map(_told, found)), flush=True)


def _told(landed: Array) -> str:
    stood = 100.0 * landed[~np.isnan(landed)]
    fell = len(landed) - len(stood)
    middle = f"{np.median(stood):.1f} ({np.std(stood):.1f})" if len(stood) else "none stood"
    return f"{middle}{f' {fell}F' if fell else '':4}".rjust(17)


if __name__ == "__main__":
    main()
