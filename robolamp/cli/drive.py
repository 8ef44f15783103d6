"""Driving a lamp from the command line: loop, log and live view, the same for emulated and physical lamps."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from robolamp.cli.keys import StopKeys
from robolamp.cli.live import LiveView
from robolamp.cli.options import Setup
from robolamp.cli.stages import STAGES, Stage
from robolamp.cli.witness import Busy, Watch, Witness
from robolamp.controller.file import Controller
from robolamp.controller.pilot import Pilot
from robolamp.dynamixel.bus import PATIENCE, SETTING_PATIENCE, Port
from robolamp.errors import FileError
from robolamp.foot.sensor import ByteSource
from robolamp.log.context import run_context, settings_context
from robolamp.log.schemas import ANSWER_WIRE, DURATION
from robolamp.log.writer import LogWriter
from robolamp.robot.lamp import RobotLamp
from robolamp.robot.shadow import ShadowLamp
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.loop import TORQUE_ON, run
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import StopRequest
from robolamp.signals import Clock, Tick

_EMULATOR_PATIENCE = 0.012  # the emulator is one process among others and may be scheduled late; of a tick of 20 ms [s]
_EMULATOR_OPENING = 0.3  # the same outside the loop, where nothing waits for the answer [s]. Chosen: 25 times as long
_PSEUDO_TERMINALS = Path("/dev/pts")  # where emulated ports are; a servo's never is


@dataclass
class Host:
    """What this computer had to do with a run.

    Attributes:
        lockstep: Whether the run was in lockstep.
        busy: How late this computer was in the run, or in the one in real time that it was repeated for; None: there
            was none in real time.
        patience: How late an answer in the loop might be [s].
        cut: The log of the run that it cut; None: it cut none, or before there was a log.
    """

    lockstep: bool = False
    busy: Busy | None = None
    patience: float = 0.0
    cut: Path | None = None


@dataclass(frozen=True)
class Drive:
    """What to drive, and where its log goes.

    Attributes:
        setup: The lamp that a verb works with.
        controller: What drives it.
        goal: Commanded distance [m].
        duration: Length of the run phase [s].
        backend: "emulator" or "lamp", for the log.
        log: The log file.
        goal_time: Commanded time to take for the way [s]; None: none is commanded.
        stage: How far it may go; None: all the way, and the log names no stage.
        fix: Whether settings of the servos that are wrong are mended first.
        resume: Whether the run goes on after the servo port was unplugged and came back.
        phases: How many ticks there were so far, by phase.
        watch: What was seen of the run in real time.
        host: How late this computer was in it, and what came of that.
    """

    setup: Setup
    controller: Controller
    goal: float
    duration: float
    backend: str
    log: Path
    goal_time: float | None = None
    stage: Stage | None = None
    fix: bool = False
    resume: bool = False
    phases: Counter[str] = field(default_factory=Counter)
    watch: Watch = field(default_factory=Watch)
    host: Host = field(default_factory=Host)


@dataclass(frozen=True)
class VirtualTime:
    """A lamp in virtual time.

    Attributes:
        clock: Its clock.
        epoch: Nanoseconds since the epoch at that clock's 0.
    """

    clock: Clock
    epoch: int


def drive(
    plan: Drive,
    servo_port: str | Port,
    foot_port: str | ByteSource,
    stop: StopRequest,
    quiet: bool,
    virtual: VirtualTime | None = None,
) -> RunResult:
    """Run a controller on a lamp behind two serial ports.

    Args:
        plan: What to do.
        servo_port: Port of the servo bus: a path, or a port object.
        foot_port: Port of the foot sensor: a path, or a port object.
        stop: Requests to stop.
        quiet: No live view.
        virtual: The time that passes at the ports; None: real time.

    Returns:
        How it went.

    Raises:
        BusError: A port does not exist or does not answer, or a servo is missing.
        SafetyError: The lamp is in no state to be moved.
        FileError: The log cannot be written.
    """
    stage = plan.stage or STAGES["full"]
    lamp = stage.lamp(plan.setup.lamp)
    pilot = Pilot(plan.controller, lamp, plan.goal, plan.goal_time)  # compiled before anything is connected
    clock = virtual.clock if virtual else MonotonicClock()
    patience, opening = patience_at(servo_port), opening_patience_at(servo_port)
    epoch = virtual.epoch if virtual else None
    robot = RobotLamp(
        lamp, servo_port, foot_port, clock, patience=patience, opening=opening, duty=stage.duty, fix=plan.fix
    )
    backend = robot if stage.powered else ShadowLamp(robot, lamp)
    if virtual is None:
        plan.host.patience = patience
        backend = Witness(backend, plan.watch, pilot.control_period, patience, opening)
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
    context[DURATION] = repr(float(plan.duration))
    if plan.stage:
        context |= {"stage": stage.name, "duty_limit": repr(stage.duty), "slew_share": repr(stage.slew)}
    try:
        backend.open()
        context[ANSWER_WIRE] = repr(robot.answer_wire_time)
        with (
            LogWriter(plan.log, context=context, joints=lamp.names, epoch=epoch, lossless=bool(virtual)) as log,
            StopKeys() as keys,
            LiveView(lamp, plan.goal, plan.duration, quiet, keys=keys.listening) as view,
        ):
            stop.asked = keys.pressed

            def event(level: str, text: str) -> None:
                log.event(level, text, clock.now())
                if text == TORQUE_ON:
                    log.context(settings_context(robot.settings()))
                view.event(level, text)

            stopped = ""

            def tick(entry: Tick) -> None:
                nonlocal stopped
                plan.phases[entry.phase] += 1
                plan.watch.landing = entry.phase == "landing"
                log.tick(entry)
                if log.error != stopped:
                    stopped = log.error
                    view.event("error", f"logging stopped, the run goes on: {plan.log}: {log.error}")
                view.tick(entry)

            for text in robot.mended:
                event("warning", f"mended: {text}")
            for text in robot.notices:
                event("info", text)
            result = run(
                backend, pilot, lamp, period=pilot.control_period, duration=plan.duration,
                on_tick=tick, on_event=event, stop=stop, powered=stage.powered,
                reconnect=robot.reconnect if plan.resume else None,
            )  # fmt: skip
    finally:
        robot.close()
    if log.error:
        result.faults[f"log: {log.error}"] = 1
    if log.dropped:
        result.faults["log: entries dropped, the disk did not keep up"] = log.dropped
    return result


def patience_at(port: str | Port) -> float:
    """Return how long an answer may be late at a port before it is a gap [s].

    Args:
        port: A path, or a port object.
    """
    return _EMULATOR_PATIENCE if _emulated(port) else PATIENCE


def opening_patience_at(port: str | Port) -> float:
    """Return how long an answer may be late at a port while a lamp is opened and its torque turned on [s].

    Args:
        port: A path, or a port object.
    """
    return _EMULATOR_OPENING if _emulated(port) else SETTING_PATIENCE


def _emulated(port: str | Port) -> bool:
    return isinstance(port, str) and Path(port).resolve().is_relative_to(_PSEUDO_TERMINALS)


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
