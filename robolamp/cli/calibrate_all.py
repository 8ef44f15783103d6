"""`robolamp calibrate all`: the whole calibration of an emulated lamp, and its proof on a hop that it has not seen."""

from __future__ import annotations

import dataclasses
import datetime
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from robolamp.cli.calibrate_lamp import fit_session, tell
from robolamp.cli.calibrate_record import emulated
from robolamp.cli.options import Setup, length
from robolamp.cli.output import print_json
from robolamp.errors import RobolampError


def all(
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    emulate: Annotated[bool, Parameter(negative="")] = False,
    reality: str = "worn",
    goal: str = "22cm",
    base: str = "nominal",
    rigid: Annotated[bool, Parameter(negative="")] = False,
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Calibrate an emulated lamp from end to end: record, fit, predict a hop that was not recorded, report.

    The fit knows nothing of the reality but what passes through the ports, a ruler and a scale. Exit code 0: the twin
    predicts the lamp; 1: it does not. The steps one by one, as for a physical lamp: record, lamp, report.

    Args:
        output: Folder for recordings, calibration and report; goes on where it stopped.
        emulate: Say that an emulated lamp is meant; a physical one needs hands: `robolamp calibrate record`.
        reality: How the lamp differs from its twin: a file, the name of one (worn), none, or random:SEED.
        goal: Of the hop that proves it, as 22cm; not one of those recorded.
        base: What is known before: a calibration file, or a name in calibration/.
        rigid: Do not look for play in the gears and bending of the arm, as for `robolamp calibrate lamp`.
        lamp: A folder of your own lamp, laid out like robolamp's.
        as_json: Print one JSON object.
    """
    if not emulate:
        raise RobolampError(
            "is missing; a physical lamp needs hands: `robolamp calibrate record`, then lamp, then report", "--emulate"
        )
    setup = Setup.of(lamp, base)
    distance = length(goal, "--goal")

    from robolamp.calibrate.procedure import procedure
    from robolamp.calibrate.proof import prove
    from robolamp.calibrate.record import Session, record
    from robolamp.calibrate.report import write_report
    from robolamp.calibrate.session import read_session
    from robolamp.calibrate.shown import show_session
    from robolamp.calibration import load_calibration
    from robolamp.runtime.stop import StopRequest

    steps, connect = procedure(setup.lamp), emulated(setup, reality)
    proof = dataclasses.replace(steps[-1], name="proof", shows="the proof: it is not fitted to", goal=distance)
    say = (lambda text: None) if as_json else print
    today = datetime.date.today().isoformat()
    with StopRequest() as stop:
        for name, plan in (("recordings", steps), ("proof", (proof,))):
            session = Session(
                setup.lamp, setup.calibration, setup.assets, output / name, f"emulator {reality}", "", today, stop
            )
            record(session, plan, connect, say=say)
    file = output / "calibration.toml"
    judged, facts = fit_session(setup, output / "recordings", file, quiet=as_json, rigid=rigid)
    fitted = load_calibration(setup.assets, file)
    hop = read_session(output / "proof", setup.lamp).recordings[0]
    before, after = (prove(hop, setup.lamp, one, setup.assets) for one in (setup.calibration, fitted))
    shown = show_session(read_session(output / "recordings", setup.lamp), setup.lamp, fitted, setup.assets)
    write_report(output / "report.html", fitted, shown)
    told: dict[str, Any] = {
        "goal_m": distance,
        "travelled_m": after.travelled,
        **{
            f"{key}_{when}": value
            for when, one in (("before", before), ("after", after))
            for key, value in (
                ("mae_mrad", one.mae * 1e3), ("travel_m", one.travel), ("time_error_s", one.time_error)
            )
        },
    }  # fmt: skip
    if as_json:
        print_json({**facts, "proof": told, "report": output / "report.html"})
    else:
        tell(judged, facts)
        print(
            f"proof       a hop to {distance * 100:.0f} cm that was not recorded: joints {before.mae * 1e3:.1f} -> "
            f"{after.mae * 1e3:.1f} mrad; went {after.travelled * 100:.1f} cm, twin {before.travel * 100:.1f} -> "
            f"{after.travel * 100:.1f} cm\nreport      {output / 'report.html'}"
        )
    return 0 if judged.good else 1
