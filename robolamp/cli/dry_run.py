"""`robolamp dry-run`: a controller on the emulated lamp, through real serial ports."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.cli.options import DURATION, GOAL_TIME, Setup, length
from robolamp.controller.controller_file import check_goal_time, time_for


def dry_run(
    controller: str,
    /,
    *,
    goal: str,
    goal_time: Annotated[float | None, GOAL_TIME] = None,
    duration: Annotated[float | None, DURATION] = None,
    reality: str = "worn",
    calibration: str = "nominal",
    lamp: Path | None = None,
    faults: Path | None = None,
    lockstep: Annotated[bool, Parameter(negative="")] = False,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    browse: Annotated[bool, Parameter(name="--open", negative="")] = False,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run a controller on the emulated lamp: the same loop as deploy, through real serial ports, with log and report.

    Where this computer is too busy for real time, so that it and not the lamp ends the run, the run is repeated in
    lockstep, which says so; one with --faults is not.

    Args:
        controller: A controller file, or the name of a shipped one (hop).
        goal: How far to go, as 0.30 (metres) or 30cm.
        goal_time: Time to take for the way in seconds, for a controller that reads goal_time.
        duration: How long the controller drives, in seconds (8; beyond 64 cm what the goal takes at 8 cm/s).
        reality: Reality, which says how the emulated lamp differs from its twin: none, a file, or the name of one
            (worn); random:SEED: everything differs; knob:KIND:SEED: one number does, as knob:backlash:7.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        faults: A TOML script of faults on the emulated bus; injections.jsonl lists those that were injected.
        lockstep: Run lamp and loop by turns in one process, in virtual time: fast, and the same numbers each time.
        output: Folder for log, truth log and report; by default a new one in runs/.
        browse: Play the run in the browser at the end, where there is a terminal and a display.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, calibration)
    loaded = setup.controller(controller, on_board=True)
    check_goal_time(loaded, goal_time)
    distance = length(goal, "--goal")

    from robolamp.cli.run.emulated_run import EmulatedRun, run_emulated  # after the arguments are checked

    how = EmulatedRun(setup, reality, faults, lockstep)
    return run_emulated(
        how, loaded, distance, duration or time_for(distance), goal_time, output=output, browse=browse, as_json=as_json
    )
