"""`robolamp deploy`: a controller on the physical lamp."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from robolamp.cli.options import DURATION, GOAL_TIME, Setup, length
from robolamp.controller.controller_file import check_goal_time, time_for


def deploy(
    controller: str,
    /,
    *,
    goal: str,
    goal_time: Annotated[float | None, GOAL_TIME] = None,
    port: str | None = None,
    foot_port: str | None = None,
    duration: Annotated[float | None, DURATION] = None,
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
        duration: How long the controller drives, in seconds (8; beyond 64 cm what the goal takes at 8 cm/s).
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
    loaded = setup.controller(controller, on_board=True)
    check_goal_time(loaded, goal_time)
    distance = length(goal, "--goal")

    from robolamp.cli.run.physical_run import PhysicalRun, run_physical  # after the arguments are checked

    how = PhysicalRun(setup, port, foot_port, stage, after, force, fix, resume_after_replug)
    return run_physical(
        how, loaded, distance, duration or time_for(distance), goal_time, output=output, as_json=as_json
    )
