"""Recording a lamp for its calibration: the steps of the procedure, one log each, through the same loop as deploy."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from robolamp.assets import Assets
from robolamp.calibrate.manifest import Entry, Manifest, check_recordings, load_manifest
from robolamp.calibrate.procedure import WEIGH, Step
from robolamp.calibration import Calibration
from robolamp.controller.controller_file import load_controller
from robolamp.controller.goal_pilot import GoalPilot
from robolamp.controller.pilot import Pilot
from robolamp.errors import FileError, SafetyError
from robolamp.files import alone, partial, sha256, suffix_of
from robolamp.lamp import Lamp
from robolamp.log.run_context import run_context
from robolamp.robot.connection import Connection
from robolamp.runtime.recorded_run import Audience, RunLog, record_run
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import StopRequest

_UNFINISHED = ".part"  # suffix of a log that is being written


@dataclass(frozen=True)
class StepConnection(Connection):
    """A lamp's ports, and what is known of it besides.

    Attributes:
        travelled: Returns how far the base went [m], where something but a ruler knows; else None.
        mass: Of the whole lamp [kg], where something but a scale knows.
    """

    travelled: Callable[[], float] | None = None
    mass: float | None = None


Connect = Callable[[Step], AbstractContextManager[StepConnection]]
"""Gives the lamp for one step, and takes it back."""


@dataclass(frozen=True)
class Person:
    """Who does what has hands.

    Attributes:
        prompt: Called with what to do; returns when it is done.
        travel: Called with what to measure; returns metres.
        mass: Called with what to weigh; returns kilograms.
    """

    prompt: Callable[[str], None]
    travel: Callable[[str], float]
    mass: Callable[[str], float]


@dataclass(frozen=True)
class Session:
    """What is recorded, and where it goes.

    Attributes:
        lamp: The lamp's description.
        calibration: The calibration in force, for the logs.
        assets: Where controllers are.
        folder: Where the recordings go.
        source: What is recorded: "lamp", or "emulator" and the name of its reality.
        by: Who records; may be empty.
        date: Today, as 2026-11-22.
        stop: Requests to stop.
        servo: Model of the servo, where one alone is recorded on a bench: nothing is weighed then.
        fix: Whether servo settings that are wrong are mended.
    """

    lamp: Lamp
    calibration: Calibration
    assets: Assets
    folder: Path
    source: str
    by: str
    date: str
    stop: StopRequest
    servo: str = ""
    fix: bool = False


def record(
    session: Session,
    steps: Sequence[Step],
    connect: Connect,
    *,
    person: Person | None = None,
    say: Callable[[str], None] = lambda text: None,
    told: Callable[[Step, RunResult], None] = lambda step, result: None,
) -> Manifest:
    """Record the steps that are not yet recorded.

    Args:
        session: What is recorded, and where it goes.
        steps: The procedure's.
        connect: Gives the lamp for a step.
        person: Does what has hands; None: nobody has to.
        say: Called with a line for each step.
        told: Called with how each run went, whatever comes of it.

    Returns:
        The manifest, with every step that is done.

    Raises:
        FileError: The folder holds another session, or a file cannot be written.
        BusError: A port or servo does not answer.
        SafetyError: The lamp may not be moved, or a step did not finish; what was recorded before stays.
    """
    with alone(session.folder):
        manifest = _open(session)
        if person and manifest.mass is None and not session.servo:
            manifest = replace(manifest, mass=person.mass(WEIGH))
        manifest.write(session.folder)
        for number, step in enumerate(steps, 1):
            place = f"{number}/{len(steps)} {step.name}"
            if manifest.done(step.name):
                say(f"{place}: recorded already")
                continue
            if person:
                person.prompt(f"{place} - {step.shows}.\n  {step.hands}")
            else:
                say(f"{place}: {step.shows}")
            entry, mass = _record_step(session, step, connect, person, say, told)
            manifest = replace(manifest.with_entry(entry), mass=manifest.mass or mass)
            manifest.write(session.folder)
    return manifest


def _open(session: Session) -> Manifest:
    """Return the folder's manifest, or a new one."""
    ours = hashlib.sha256(session.lamp.source.encode()).hexdigest()
    found = load_manifest(session.folder)
    if found is None:
        others = sorted(item.name for item in session.folder.iterdir() if suffix_of(item) == ".mcap")
        if others:
            raise FileError(f"holds {others[0]}, but no manifest; give a new or empty folder", str(session.folder))
        return Manifest(ours, session.source, session.by, session.date, servo=session.servo)
    if found.lamp_sha256 != ours:
        raise FileError(
            f"was begun with another {session.lamp.path.name} ({found.lamp_sha256[:12]}, now {ours[:12]}); "
            "give a new folder",
            str(session.folder),
        )
    if found.source != session.source:
        raise FileError(f"is of {found.source}, not of {session.source}; give a new folder", str(session.folder))
    check_recordings(found, session.folder)
    return found


def _record_step(
    session: Session,
    step: Step,
    connect: Connect,
    person: Person | None,
    say: Callable[[str], None],
    told: Callable[[Step, RunResult], None],
) -> tuple[Entry, float | None]:
    """Return the recording, and the lamp's mass [kg] where the connection knows it."""
    lamp, final = step.lamp(session.lamp), session.folder / f"{step.name}.mcap"
    pilot, source = _pilot(session, step, lamp)
    with partial(final, final.name + _UNFINISHED) as part, connect(step) as ports:
        result = _play(session, step, lamp, pilot, source, ports, part, say)
        told(step, result)
        if result.log_error:
            raise FileError(f"the log ended early: {result.log_error}", str(part))
        if result.ended != "finished":
            raise SafetyError(f"{result.ended}: {result.reason}; start again to go on with this step", step.name)
        travel = None
        if step.controller:
            if ports.travelled:
                travel = ports.travelled()
            elif person:
                travel = person.travel("How far did the base come?")
        if travel is not None and not math.isfinite(travel):
            raise SafetyError("how far it went is not known", step.name)
    return Entry(step.name, final.name, sha256(final), step.clamped, travel), ports.mass


def _pilot(session: Session, step: Step, lamp: Lamp) -> tuple[Pilot | GoalPilot, str]:
    """Return what drives, compiled, and its file's text."""
    if step.excitation:
        return GoalPilot(step.excitation.goal, lamp, step.excitation.period), ""
    path = session.assets.named(step.controller, "sim/lamp/controllers", "controller")
    controller = load_controller(path, session.lamp, on_board=True)
    return Pilot(controller, lamp, step.goal), controller.source


def _play(
    session: Session,
    step: Step,
    lamp: Lamp,
    pilot: Pilot | GoalPilot,
    source: str,
    ports: StepConnection,
    path: Path,
    say: Callable[[str], None],
) -> RunResult:
    """Return how the run went."""
    robot = ports.robot(lamp, fix=session.fix)
    context = run_context(
        backend=session.source.split()[0],
        lamp=session.lamp,
        calibration=session.calibration,
        controller=source,
        controller_name=step.controller or step.name,
        terminals=pilot.terminals,
        goal=step.goal,
        control_period=pilot.control_period,
    )
    context["step"] = step.name
    context["clamped"] = "yes" if step.clamped else "no"
    context["position_p_gain"] = " ".join(str(joint.position_p_gain) for joint in lamp.joints)

    @contextmanager
    def audience() -> Iterator[Audience]:
        for text in robot.mended:
            say(f"mended: {text}")
        yield Audience()

    return record_run(
        robot, pilot, lamp, RunLog(path, context, ports.epoch), duration=step.duration, stop=session.stop,
        inspected=robot, audience=audience, limp=step.limp, clamped=step.clamped,
    )  # fmt: skip
