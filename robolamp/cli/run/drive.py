"""Driving a lamp from the command line: recorded, with a live view, the same for emulated and physical lamps."""

from __future__ import annotations

import contextlib
import math
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from robolamp.cli.options import Setup
from robolamp.cli.run.stages import STAGES, Stage
from robolamp.cli.run.witness import Busy, Watch, Witness
from robolamp.cli.screen.live_view import LiveView
from robolamp.cli.screen.stop_key import StopKeys
from robolamp.controller.controller_file import Controller
from robolamp.controller.pilot import Pilot
from robolamp.errors import FileError
from robolamp.lamp import Lamp
from robolamp.log.run_context import run_context
from robolamp.log.schemas import DURATION
from robolamp.robot.connection import Connection
from robolamp.robot.shadow_lamp import ShadowLamp
from robolamp.runtime.recorded_run import Audience, RecordedPilot, RunLog, record_run
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import StopRequest
from robolamp.signals import Tick


class ActPilot(RecordedPilot, Protocol):
    """A pilot whose inputs have names."""

    terminals: tuple[str, ...]


class Act(Protocol):
    """What drives the lamp where no controller does, such as a gesture."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def texts(self) -> Mapping[str, str]:
        """The texts of its files, as the log keeps them."""
        ...

    @property
    def planned(self) -> bool:
        """Whether every goal was known before."""
        ...

    def pilot(self, lamp: Lamp) -> ActPilot:
        """Return what plays it in the loop.

        Args:
            lamp: Limits and slew.
        """
        ...


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
        act: What drives it.
        goal: Commanded distance [m]; NaN: it is sent nowhere.
        duration: Length of the run phase [s].
        backend: "emulator" or "lamp", for the log.
        log: The log file.
        goal_time: Commanded time to take for the way [s]; None: none is commanded.
        stage: How far it may go; None: all the way, and the log names no stage.
        fix: Whether settings of the servos that are wrong are mended first.
        resume: Whether the run goes on after the servo port was unplugged and came back.
        clamped: Whether the base is clamped, or a hand is at the lamp, so that the foot sensor is not asked whether to
            go on.
        phases: How many ticks there were so far, by phase.
        watch: What was seen of the run in real time.
        host: How late this computer was in it, and what came of that.
    """

    setup: Setup
    act: Controller | Act
    goal: float
    duration: float
    backend: str
    log: Path
    goal_time: float | None = None
    stage: Stage | None = None
    fix: bool = False
    resume: bool = False
    clamped: bool = False
    phases: Counter[str] = field(default_factory=Counter)
    watch: Watch = field(default_factory=Watch)
    host: Host = field(default_factory=Host)

    @property
    def texts(self) -> Mapping[str, str]:
        """The texts of what drives, as the log keeps them."""
        return {"controller": self.act.source} if isinstance(self.act, Controller) else self.act.texts

    @property
    def planned(self) -> bool:
        """Whether every goal was known before: nothing that is measured changes them."""
        return not isinstance(self.act, Controller) and self.act.planned

    def pilot(self, lamp: Lamp) -> ActPilot:
        """Return what drives, compiled.

        Args:
            lamp: Limits and slew.
        """
        if isinstance(self.act, Controller):
            return Pilot(self.act, lamp, self.goal, self.goal_time)
        return self.act.pilot(lamp)


def drive(plan: Drive, ports: Connection, stop: StopRequest, quiet: bool) -> RunResult:
    """Run a controller, or another act, on a lamp behind two serial ports.

    Args:
        plan: What to do.
        ports: The lamp's.
        stop: Requests to stop.
        quiet: No live view.

    Returns:
        How it went.

    Raises:
        BusError: A port does not exist or does not answer, or a servo is missing.
        SafetyError: The lamp is in no state to be moved.
        FileError: The log cannot be written.
    """
    stage = plan.stage or STAGES["full"]
    lamp = stage.lamp(plan.setup.lamp)
    pilot = plan.pilot(lamp)  # compiled before anything is connected
    robot = ports.robot(lamp, duty=stage.duty, fix=plan.fix)
    backend = robot if stage.powered else ShadowLamp(robot, lamp)
    if ports.epoch is None:
        plan.host.patience = ports.patience
        backend = Witness(backend, plan.watch, pilot.control_period, ports.patience, ports.opening)
    context = run_context(
        backend=plan.backend,
        lamp=lamp,
        calibration=plan.setup.calibration,
        controller="",
        controller_name=plan.act.name,
        terminals=pilot.terminals,
        goal=plan.goal,
        goal_time=plan.goal_time,
        control_period=pilot.control_period,
    )
    context |= {**plan.texts, DURATION: repr(float(plan.duration))}
    if plan.stage:
        context |= {"stage": stage.name, "duty_limit": repr(stage.duty), "slew_share": repr(stage.slew)}

    @contextlib.contextmanager
    def audience() -> Iterator[Audience]:
        doing = "hopping" if isinstance(plan.act, Controller) else plan.act.name
        with (
            StopKeys() as keys,
            LiveView(lamp, plan.goal, plan.duration, quiet, keys=keys.listening, doing=doing) as view,
        ):
            stop.asked = keys.pressed

            def tick(entry: Tick) -> None:
                plan.phases[entry.phase] += 1
                plan.watch.landing = entry.phase == "landing"
                view.tick(entry)

            yield Audience(tick, view.event)

    return record_run(
        backend, pilot, lamp, RunLog(plan.log, context, ports.epoch), duration=plan.duration, stop=stop,
        inspected=robot, audience=audience, powered=stage.powered, reconnect=robot.reconnect if plan.resume else None,
        clamped=plan.clamped,
    )  # fmt: skip


def run_folder(output: Path | None, name: str, goal: float = math.nan) -> Path:
    """Return the folder a run's files go to.

    Args:
        output: `--output`; None: a new folder in runs/, named by time, controller and goal.
        name: Of the controller, or of what else drives.
        goal: [m]; NaN: there is none.

    Raises:
        FileError: The folder holds a run already, or its name cannot be one.
    """
    way = "" if math.isnan(goal) else f"-{goal * 100:.0f}cm"
    folder = output or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}{way}"
    try:
        if (folder / "log.mcap").exists():
            raise FileError("holds a run already; give another folder with -o", str(folder))
        if folder.exists() and not folder.is_dir():
            raise FileError("is not a folder", str(folder))
    except OSError as error:  # such as a name that is too long
        raise FileError(f"cannot be used: {error.strerror or error}", str(folder)) from None
    return folder
