"""Driving a lamp from the command line: loop, log and live view, the same for emulated and physical lamps."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from robolamp.cli.live import LiveView
from robolamp.cli.options import Setup
from robolamp.controller.file import Controller
from robolamp.controller.pilot import Pilot
from robolamp.dynamixel.bus import PATIENCE
from robolamp.errors import FileError
from robolamp.log.context import run_context
from robolamp.log.writer import LogWriter
from robolamp.robot.lamp import RobotLamp
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.loop import run
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import StopRequest
from robolamp.signals import Tick

_EMULATOR_PATIENCE = 0.006  # the emulator is one process among others and may be scheduled late [s]


@dataclass(frozen=True)
class Drive:
    """What to drive, and where its log goes.

    Attributes:
        setup: The lamp at hand.
        controller: What drives it.
        goal: Commanded distance [m].
        duration: Length of the run phase [s].
        backend: "emulator" or "lamp", for the log.
        log: The log file.
        goal_time: Commanded time to take for the way [s]; None: none is commanded.
        phases: How many ticks there were so far, by phase.
    """

    setup: Setup
    controller: Controller
    goal: float
    duration: float
    backend: str
    log: Path
    goal_time: float | None = None
    phases: Counter[str] = field(default_factory=Counter)


def drive(plan: Drive, servo_port: str, foot_port: str, stop: StopRequest, quiet: bool) -> RunResult:
    """Run a controller on a lamp behind two serial ports.

    Args:
        plan: What to do.
        servo_port: Port of the servo bus.
        foot_port: Port of the foot sensor.
        stop: Requests to stop.
        quiet: No live view.

    Returns:
        How it went.

    Raises:
        BusError: A port does not exist or does not answer, or a servo is missing.
        SafetyError: The lamp is in no state to be moved.
        FileError: The log cannot be written.
    """
    lamp = plan.setup.lamp
    pilot = Pilot(plan.controller, lamp, plan.goal, plan.goal_time)  # compiled before anything is connected
    clock = MonotonicClock()
    patience = _EMULATOR_PATIENCE if plan.backend == "emulator" else PATIENCE
    robot = RobotLamp(lamp, servo_port, foot_port, clock, patience=patience)
    context = run_context(
        backend=plan.backend,
        lamp=lamp,
        calibration=plan.setup.calibration,
        controller=plan.controller.source,
        controller_name=plan.controller.name,
        terminals=pilot.terminals,
        goal=plan.goal,
        goal_time=plan.goal_time,
        control_period=pilot.control_period,
    )
    try:
        robot.open()
        with (
            LogWriter(plan.log, context=context, joints=lamp.names) as log,
            LiveView(lamp, plan.goal, plan.duration, quiet) as view,
        ):

            def event(level: str, text: str) -> None:
                log.event(level, text, clock.now())
                view.event(level, text)

            def tick(entry: Tick) -> None:
                plan.phases[entry.phase] += 1
                log.tick(entry)
                view.tick(entry)

            result = run(
                robot, pilot, lamp, period=pilot.control_period, duration=plan.duration,
                on_tick=tick, on_event=event, stop=stop,
            )  # fmt: skip
    finally:
        robot.close()
    if log.error:
        result.faults[f"log: {log.error}"] = 1
    return result


def run_folder(output: Path | None, controller: Controller, goal: float) -> Path:
    """Return the folder a run's files go to.

    Args:
        output: `--output`; None: a new folder in runs/, named by time, controller and goal.
        controller: Gives its name.
        goal: [m].

    Raises:
        FileError: The folder holds a run already, or its name cannot be one.
    """
    folder = output or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{controller.name}-{goal * 100:.0f}cm"
    try:
        if (folder / "log.mcap").exists():
            raise FileError("holds a run already; give another folder with -o", str(folder))
        if folder.exists() and not folder.is_dir():
            raise FileError("is not a folder", str(folder))
    except OSError as error:  # such as a name that is too long
        raise FileError(f"cannot be used: {error.strerror or error}", str(folder)) from None
    return folder
