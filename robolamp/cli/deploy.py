"""`robolamp deploy`: a controller on the physical lamp."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from robolamp.cli.options import DURATION, GOAL_TIME, Setup, length
from robolamp.cli.screen.output import print_json
from robolamp.controller.controller_file import check_goal_time
from robolamp.errors import FileError, RobolampError


def deploy(
    controller: str,
    /,
    *,
    goal: str,
    goal_time: Annotated[float | None, GOAL_TIME] = None,
    port: str | None = None,
    foot_port: str | None = None,
    duration: Annotated[float, DURATION] = 5.0,
    calibration: str = "nominal",
    lamp: Path | None = None,
    stage: Literal["shadow", "gentle", "full"] | None = None,
    after: Path | None = None,
    force: Annotated[bool, Parameter(negative="")] = False,
    fix: Annotated[bool, Parameter(negative="")] = False,
    resume_after_replug: Annotated[bool, Parameter(negative="")] = False,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run a controller on the physical lamp: soft start, hop, soft landing, torque off; then compare with the twin.

    Stand the lamp upright with room to hop and a hand near its plug. Ctrl-C, and in a terminal q, Space or Esc, lands
    it softly; Ctrl-C again turns its torque off at once.

    Args:
        controller: A controller file, or the name of a shipped one (hop).
        goal: How far to go, as 0.30 (metres) or 30cm.
        goal_time: Time to take for the way in seconds, for a controller that reads goal_time.
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        duration: How long the controller drives, in seconds.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        stage: How much of itself the lamp may use; by default full, without the others before. For a first run, in
            turn: shadow (torque stays off; shows what it would do), gentle (half the supply, a quarter of the speed),
            full (everything).
        after: The log of the stage before, which gentle and full need.
        force: Run the stage without that log.
        fix: Mend settings of the servos that are wrong and that software may mend.
        resume_after_replug: Continue if the servo port is unplugged and comes back within 10 seconds: clear the
            watchdogs, hold each joint where it is, then move it softly to where it was. By default the run ends.
        output: Folder for log and report; by default a new one in runs/.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, calibration)
    if setup.calibration.other_lamp(setup.lamp.source):
        print(
            f"robolamp: {setup.calibration.path}: was fitted to another lamp, or {setup.lamp.path.name} was changed "
            "since; what the twin is compared with may not be this lamp",
            file=sys.stderr,
        )
    loaded = setup.controller(controller, on_board=True)
    check_goal_time(loaded, goal_time)
    distance = length(goal, "--goal")
    servos, foot = port or setup.lamp.bus_port, foot_port or setup.lamp.foot_port
    for key, option, value in (("bus.port", "--port", servos), ("foot.port", "--foot-port", foot)):
        if not value.strip():
            raise FileError(
                f"{key}: {value!r} is not a serial port; name it there or by {option}", str(setup.lamp.path)
            )

    from robolamp.cli.run.drive import Drive, drive, run_folder  # after the arguments are checked
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
    from robolamp.compare.tolerances import load_tolerances
    from robolamp.lateness import Lateness
    from robolamp.robot.connection import Connection
    from robolamp.runtime.clock import MonotonicClock
    from robolamp.runtime.stop import StopRequest

    chosen = STAGES[stage] if stage else None
    for option, given in (("--after", after is not None), ("--force", force)):
        if given and not (chosen and chosen.before):
            raise RobolampError("is for --stage gentle and --stage full", option)
    if chosen and not force:
        check_before(chosen, after, loaded.source, setup.lamp)
    allowed = load_tolerances(setup.assets)
    folder = run_folder(output, loaded, distance)
    plan = Drive(
        setup, loaded, distance, duration, "lamp", folder / "log.mcap", goal_time, chosen, fix, resume_after_replug
    )
    with tidying(plan), StopRequest() as stop:
        result = drive(plan, Connection.real(servos, foot, MonotonicClock()), stop, as_json)
    plan.host.busy = judged(plan.watch, Lateness(), result.ended, plan.host.patience)
    if not plan.phases["run"]:
        return tell_of_none(plan, result, as_json)
    if chosen and not chosen.powered:
        return tell_of_shadow(plan, result, as_json)
    failures: list[Failure] = []
    comparison = reported(lambda: compared(plan, folder / "report.html", allowed), failures, plan.log)
    if as_json:
        found = {**comparison.parts, "report": comparison.report} if comparison else {}
        print_json({**facts(plan, result), **found, **noted(failures)})
    else:
        ruler = shlex.join(["robolamp", "compare", str(plan.log)])
        tell(
            comparison.word if comparison else f"Run {ended(result)}.",
            (f"{comparison.text}\n" if comparison else " ")
            + f"Where it landed is for your ruler, and then: `{ruler} --landed 28.1cm`.\n"
            + (f"Run {ended(result)}. " if comparison else "")
            + f"{account(result)}\n"
            + busy(plan, result)
            + f"log     {plan.log}"
            + (f"\nreport  {comparison.report}" if comparison else ""),
        )
    return concluded(0 if result.ended == "finished" else 1, failures)
