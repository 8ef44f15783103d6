"""`robolamp play`: gestures and hops one after the other, in one run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from robolamp.cli.options import Setup


def play(
    sequence: str,
    /,
    *,
    port: str | None = None,
    foot_port: str | None = None,
    stage: Literal["shadow", "gentle", "full"] | None = None,
    after: Path | None = None,
    force: Annotated[bool, Parameter(negative="")] = False,
    fix: Annotated[bool, Parameter(negative="")] = False,
    reality: str | None = None,
    lockstep: Annotated[bool, Parameter(negative="")] = False,
    calibration: str = "nominal",
    lamp: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    browse: Annotated[bool, Parameter(name="--open", negative="")] = False,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Play a sequence of gestures and hops: on the emulated lamp, or with --port on the physical one.

    Its gestures are checked on the twin first, as `robolamp gesture check` does. Before a hop and after one the lamp
    goes through its neutral pose. Ctrl-C, and in a terminal q, Space or Esc, lands the lamp softly; Ctrl-C again turns
    its torque off at once.

    Args:
        sequence: A sequence file, or the name of a shipped one (greeting).
        port: Serial port of the servos: play it on the physical lamp there.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        stage: With --port, how much of itself the lamp may use: shadow (torque stays off), gentle, full; see
            `robolamp deploy --help`.
        after: The log of the stage before, which gentle and full need.
        force: Run --stage gentle or full without the log of the stage before.
        fix: With --port, mend wrong servo settings (EEPROM) first.
        reality: Without --port, how the emulated lamp differs from its twin, as dry-run takes it (worn).
        lockstep: Without --port, run lamp and loop by turns in one process, in virtual time.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        output: Folder for log and report; by default a new one in runs/.
        browse: Without --port, play the run in the browser at the end.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, calibration)

    from robolamp.cli.run.gesture_check import check_sequence  # after the arguments are checked
    from robolamp.cli.run.played import Player
    from robolamp.pose.sequence import load_sequence

    found = load_sequence(sequence, setup.lamp, setup.assets)
    player = Player(
        setup, calibration, lamp, port, foot_port, stage, after, force, fix, reality, lockstep, browse, output, as_json
    )
    check_sequence(found, setup)
    return player.play(found, found.goal, found.duration)
