"""`robolamp calibrate all`: the whole calibration of an emulated lamp, and its proof on a hop that it has not seen."""

from __future__ import annotations

import dataclasses
import datetime
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from robolamp.cli.calibrate.lamp import fit_session, tell
from robolamp.cli.calibrate.record import emulated, telling
from robolamp.cli.options import Setup, length
from robolamp.cli.screen.output import print_json
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
        output: Folder for recordings, calibration and report; with the same folder it continues where it stopped.
        emulate: Confirms that you want an emulated lamp; for a physical one see `robolamp calibrate record`.
        reality: Reality, which says how the lamp differs from its twin: a file, the name of one (worn), none, or
            random:SEED.
        goal: Goal of the hop that tests the calibration, as 22cm; not one of those recorded.
        base: Calibration to start from, which gives the priors: a file, or a name in calibration/.
        rigid: Do not look for play in the gears and bending of the arm, as for `robolamp calibrate lamp`.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    if not emulate:
        raise RobolampError(
            "is missing; a physical lamp needs hands: `robolamp calibrate record`, then lamp, then report", "--emulate"
        )
    setup = Setup.of(lamp, base)
    distance = length(goal, "--goal")

    from robolamp.calibrate.lamp.hop_proof import prove
    from robolamp.calibrate.lamp.session import read_session
    from robolamp.calibrate.procedure import procedure
    from robolamp.calibrate.recorder import Session, record
    from robolamp.calibrate.report.calibration_page import write_report
    from robolamp.calibrate.report.simulations import show_session
    from robolamp.calibration import load_calibration
    from robolamp.cli.run.outcome import Failure, attempt, concluded, noted
    from robolamp.runtime.stop import StopRequest

    steps, connect = procedure(setup.lamp), emulated(setup, reality)
    proof = dataclasses.replace(steps[-1], name="proof", shows="the proof: it is not fitted to", goal=distance)
    say = (lambda text: None) if as_json else print
    today = datetime.date.today().isoformat()
    runs: list[dict[str, Any]] = []
    failures: list[Failure] = []
    file, page = output / "calibration.toml", output / "report.html"
    go_on = f"stopped; give the same folder again to go on: {output}"

    def recorded() -> None:
        for name, plan in (("recordings", steps), ("proof", (proof,))):
            session = Session(
                setup.lamp, setup.calibration, setup.assets, output / name, f"emulator {reality}", "", today, stop
            )
            record(session, plan, connect, say=say, told=telling(runs, say))

    def proven() -> dict[str, Any]:
        hop = read_session(output / "proof", setup.lamp).recordings[0]
        fitted = load_calibration(setup.assets, file)
        before, after = (prove(hop, setup.lamp, one, setup.assets) for one in (setup.calibration, fitted))
        return {
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

    def drawn() -> Path:
        fitted = load_calibration(setup.assets, file)
        shown = show_session(read_session(output / "recordings", setup.lamp), setup.lamp, fitted, setup.assets)
        write_report(page, fitted, shown)
        return page

    with StopRequest() as stop:
        try:
            recorded()
        except RobolampError as error:
            if not runs:
                raise
            failures.append(Failure(error.message, error.where))
    fit = None
    if not failures:
        fit = attempt(
            lambda: fit_session(setup, output / "recordings", file, quiet=as_json, rigid=rigid), failures, output, go_on
        )
    shown_proof = attempt(proven, failures, output, go_on) if fit else None
    report = attempt(drawn, failures, output, go_on) if fit else None
    if as_json:
        print_json({**(fit[1] if fit else {}), "runs": runs, "proof": shown_proof, "report": report, **noted(failures)})
    elif fit:
        tell(*fit)
        if shown_proof:
            print(_sentence(shown_proof))
        if report:
            print(f"report      {report}")
    return concluded(0 if fit and fit[0].good else 1, failures)


def _sentence(proof: dict[str, Any]) -> str:
    goal, came, *twin = (proof[key] * 100 for key in ("goal_m", "travelled_m", "travel_m_before", "travel_m_after"))
    before, after = proof["mae_mrad_before"], proof["mae_mrad_after"]
    return (
        f"proof       a hop to {goal:.0f} cm that was not recorded: joints {before:.1f} -> {after:.1f} mrad; "
        f"went {came:.1f} cm, twin {twin[0]:.1f} -> {twin[1]:.1f} cm"
    )
