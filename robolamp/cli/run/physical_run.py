"""A run on the physical lamp, from the ports to the report: what deploy, `gesture play` and `play` do."""

from __future__ import annotations

import math
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Act, Drive, drive, run_folder
from robolamp.cli.run.followed import followed
from robolamp.cli.run.outcome import (
    Failure,
    account,
    busy,
    compared,
    concluded,
    ended,
    facts,
    noted,
    reported,
    tell,
    tell_of_none,
    tell_of_shadow,
    tidying,
)
from robolamp.cli.run.stages import STAGES, check_before
from robolamp.cli.run.witness import judged
from robolamp.cli.screen.output import print_json
from robolamp.compare.verdicts.tolerances import load_tolerances
from robolamp.controller.controller_file import Controller
from robolamp.errors import FileError, RobolampError
from robolamp.lateness import Lateness
from robolamp.robot.connection import Connection
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.stop import StopRequest


@dataclass(frozen=True)
class PhysicalRun:
    """On which lamp, and how.

    Attributes:
        setup: The lamp and its twin's numbers.
        port: Serial port of the servos; None: as lamp.toml says.
        foot_port: Serial port of the foot sensor; None: as lamp.toml says.
        stage: How far it may go, one of `STAGES`; None: all the way, and no stage before is asked for.
        after: The log of the stage before.
        force: Whether none is needed.
        fix: Whether settings of the servos that are wrong are mended first.
        resume: Whether the run goes on after the servo port was unplugged and came back.
    """

    setup: Setup
    port: str | None = None
    foot_port: str | None = None
    stage: str | None = None
    after: Path | None = None
    force: bool = False
    fix: bool = False
    resume: bool = False


def run_physical(
    how: PhysicalRun,
    act: Controller | Act,
    goal: float,
    duration: float,
    goal_time: float | None = None,
    *,
    output: Path | None,
    as_json: bool,
) -> int:
    """Run a controller or another act on the physical lamp, compare the run with the twin, and tell of it.

    Args:
        how: On which lamp.
        act: What drives.
        goal: Commanded distance [m]; NaN: none is.
        duration: How long it drives [s].
        goal_time: Commanded time to take for the way [s].
        output: Folder of the run; None: a new one in runs/.
        as_json: Print one JSON object.

    Returns:
        The exit code.

    Raises:
        RobolampError: It cannot be run.
    """
    setup = how.setup
    if setup.calibration.other_lamp(setup.lamp.source):
        print(
            f"robolamp: {setup.calibration.path}: was fitted to another lamp, or {setup.lamp.path.name} was changed "
            "since; what the twin is compared with may not be this lamp",
            file=sys.stderr,
        )
    servos, foot = how.port or setup.lamp.bus_port, how.foot_port or setup.lamp.foot_port
    for key, option, value in (("bus.port", "--port", servos), ("foot.port", "--foot-port", foot)):
        if not value.strip():
            raise FileError(
                f"{key}: {value!r} is not a serial port; name it there or by {option}", str(setup.lamp.path)
            )
    chosen = STAGES[how.stage] if how.stage else None
    for option, given in (("--after", how.after is not None), ("--force", how.force)):
        if given and not (chosen and chosen.before):
            raise RobolampError("is for --stage gentle and --stage full", option)
    allowed = load_tolerances(setup.assets)
    folder = run_folder(output, act.name, goal)
    plan = Drive(setup, act, goal, duration, "lamp", folder / "log.mcap", goal_time, chosen, how.fix, how.resume)
    if chosen and not how.force:
        check_before(chosen, how.after, plan.texts, setup.lamp)
    with tidying(plan), StopRequest() as stop:
        result = drive(plan, Connection.real(servos, foot, MonotonicClock()), stop, as_json)
    plan.host.busy = judged(plan.watch, Lateness(), result.ended, plan.host.patience)
    if not plan.phases["run"]:
        return tell_of_none(plan, result, as_json)
    if chosen and not chosen.powered:
        return tell_of_shadow(plan, result, as_json)
    failures: list[Failure] = []
    plays = followed(plan, failures)
    comparison = reported(lambda: compared(plan, folder / "report.html", allowed), failures, plan.log)
    if as_json:
        found = {**comparison.parts, "report": comparison.report} if comparison else {}
        print_json({**facts(plan, result), **found, **plays.facts, **noted(failures)})
    else:
        ruler = shlex.join(["robolamp", "compare", str(plan.log), *setup.words])
        tell(
            comparison.word if comparison else f"Run {ended(result)}.",
            (f"{comparison.text}\n" if comparison else " ")
            + plays.text
            + ("" if math.isnan(goal) else f"Where it landed is for your ruler, and then: `{ruler} --landed 28.1cm`.\n")
            + (f"Run {ended(result)}. " if comparison else "")
            + f"{account(result)}\n"
            + busy(plan, result)
            + f"log     {plan.log}"
            + (f"\nreport  {comparison.report}" if comparison else ""),
        )
    return concluded(0 if result.ended == "finished" else 1, failures)
