"""Logs of lamps that are known to the last parameter: the twin, bent or not, drives the same motion each time."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.lamp import load_lamp
from robolamp.log.run_context import run_context
from robolamp.log.schemas import JOINT_STATE, TRUTH, TRUTH_BASE_TOPIC, TRUTH_JOINTS_TOPIC, joint_state
from robolamp.log.writer import LogWriter
from robolamp.signals import Command, Tick
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import build
from robolamp.twin.twin_lamp import TwinLamp

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)
PERIOD = 0.02
START, RUN, LANDING = 25, 150, 25
SEND = CALIBRATION.lamp("line_delay")  # from the start of a tick to its goals' departure [s]


def goal(index: int) -> np.ndarray:
    """A sway on both legs of every joint, small enough to keep the foot flat."""
    time = (index - START) * PERIOD
    if not 0 <= time < RUN * PERIOD:
        return np.zeros(3)
    swing = math.sin(2 * math.pi * 1.6 * time)
    return np.array([-0.25 * swing, 0.3 * swing, 0.35 * swing])


def write_run(
    folder: Path,
    bend: Bend | None = None,
    *,
    noise: float = 0.0,
    lost: float = 0.0,
    blind: str = "",
    skip: tuple[int, ...] = (),
    send: float = SEND,
    duty: float | None = None,
) -> tuple[Path, Path]:
    """Write a log and its truth; returns both paths.

    What is `blind` (angle, current, foot_force) is read in every 50th tick alone. `noise` [rad] is added to the
    angles, a share `lost` of them is missing, the ticks in `skip` did not run, and goals leave `send` [s] after a
    tick's start. With a `duty` the motors get no more of the supply, and the log says so.
    """
    lamp = TwinLamp(build(LAMP, CALIBRATION, ASSETS, bend), duty=1.0 if duty is None else duty)
    lamp.open()
    lamp.torque(True)
    random = np.random.default_rng(3)
    context = run_context(
        backend="emulator",
        lamp=LAMP,
        calibration=CALIBRATION,
        controller="# sway <&>",
        controller_name="sway <&>",
        terminals=("t",),
        goal=0.30,
        control_period=PERIOD,
    ) | ({} if duty is None else {"duty_limit": repr(duty)})
    paths = folder / "run.mcap", folder / "truth.mcap"
    with (
        LogWriter(paths[0], context=context, joints=LAMP.names, now=0.0, lossless=True) as log,
        LogWriter(paths[1], context=context, now=0.0, lossless=True) as truth,
    ):
        for index in range(START + RUN + LANDING):
            if index in skip:
                continue
            at = index * PERIOD
            lamp.advance_to(at)
            seen = lamp.observe()
            seen.angle = seen.angle + random.normal(0.0, noise, 3)
            seen.angle[random.random(3) < lost] = np.nan
            if blind and index % 50:
                setattr(seen, blind, getattr(seen, blind) * np.nan)
            lamp.advance_to(at + send - lamp.twin.line_delay)
            lamp.command(Command(goal(index)))
            phase = "start" if index < START else "run" if index < START + RUN else "landing"
            log.tick(Tick(index, phase, at, at, at, at + send, seen, goal(index), hops=index // 50))
            x, z, pitch = lamp.body.base
            joints = joint_state(LAMP.names, lamp.body.angle.tolist(), log_time=truth.log_time(lamp.time))
            truth.message(TRUTH_JOINTS_TOPIC, JOINT_STATE, joints, lamp.time)
            base = {
                "base_x": x,
                "base_z": z,
                "pitch": pitch,
                "force": lamp.body.force,
                "clearance": 0.0,
                "fallen": False,
            }
            truth.message(TRUTH_BASE_TOPIC, TRUTH, base, lamp.time)
    return paths
