"""`robolamp calibrate lamp`: a whole lamp's calibration from its recorded session."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from robolamp.cli.options import Setup
from robolamp.cli.screen.output import print_json
from robolamp.cli.screen.progress_bar import bar

if TYPE_CHECKING:
    from robolamp.calibrate.lamp.findings import FitVerdict
    from robolamp.calibrate.lamp.lamp_fit import LampFit


def lamp(
    session: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    base: str = "nominal",
    lamp: Path | None = None,
    rigid: Annotated[bool, Parameter(negative="")] = False,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Fit a whole lamp to a session: each joint's motor, friction, delay, zero, play; the arm; the foot; the floor.

    A value that the recordings do not determine keeps that of the base calibration, and is named. Exit code 0: the twin
    predicts what it was not fitted to; 1: it does not yet; 2: there was nothing to fit. Some minutes.

    Args:
        session: Folder that `robolamp calibrate record` made.
        output: The calibration file to write (TOML).
        base: Calibration to start from, which gives the priors: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        rigid: Do not look for play in the gears and bending of the arm. A twin with them predicts better where they
            matter, but takes more than twice as long to simulate.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, base)
    judged, facts = fit_session(setup, session, output, quiet=as_json, rigid=rigid)
    if as_json:
        print_json(facts)
    else:
        tell(judged, facts)
    return 0 if judged.good else 1


def fit_session(
    setup: Setup, session: Path, output: Path, *, quiet: bool, rigid: bool = False
) -> tuple[FitVerdict, dict[str, Any]]:
    """Fit a session and write its calibration file.

    Args:
        setup: The lamp, and the base calibration.
        session: Folder of the recordings.
        output: The file to write.
        quiet: No lines of progress.
        rigid: Do not look for play and bending.

    Returns:
        The verdict, and what `--json` says.

    Raises:
        FileError: There is no session, or a file cannot be read or written.
        RobolampError: It holds too little.
    """
    from robolamp.calibrate.lamp.calibration_file import write_lamp_file
    from robolamp.calibrate.lamp.findings import findings, verdict
    from robolamp.calibrate.lamp.lamp_fit import fit_lamp
    from robolamp.calibrate.lamp.session import read_session

    began = time.monotonic()
    recorded = read_session(session, setup.lamp)

    def progress(text: str) -> None:
        print(f"{time.monotonic() - began:5.0f} s  {text}", flush=True)

    with bar("fitting", quiet=quiet) as share:
        fit = fit_lamp(
            recorded,
            setup.lamp,
            setup.calibration,
            setup.assets,
            gears=not rigid,
            progress=(lambda text: None) if quiet else progress,
            done=share,
        )
    write_lamp_file(output, fit, recorded, setup.lamp, setup.calibration)
    judged = verdict(fit)
    facts = {
        "file": output,
        "verdict": "good" if judged.good else "poor",
        "said": judged.text,
        "findings": findings(fit, recorded, setup.lamp, setup.calibration),
        "parameters": _parameters(fit),
        "mae_mrad": _mean([after for name, (_, after) in fit.mae.items() if name in fit.trained]),
        "left_out_mae_mrad": judged.held_out[1] * 1e3,
        "left_out_mae_before_mrad": judged.held_out[0] * 1e3,
        "hop_travel_error": judged.travel,
        "hop_time_error_s": judged.time,
        "wall_s": time.monotonic() - began,
    }
    return judged, facts


def tell(judged: FitVerdict, facts: dict[str, Any]) -> None:
    """Print the results of a fit."""
    print(judged.text)
    for text in facts["findings"]:
        print(f"  {text}")
    print(f"calibration {facts['file']}")


def _parameters(fit: LampFit) -> dict[str, Any]:
    found = {
        unknown.label: {
            "value": unknown.value(float(fit.z[index])),
            "stderr": unknown.stderr(float(fit.z[index]), float(fit.sigma[index])),
            "unit": unknown.unit,
            "identified": fit.identified(index),
        }
        for index, unknown in enumerate(fit.asked)
    }
    from robolamp.calibration import LAMP

    for name, (value, stderr) in fit.lamp.items():
        found[f"lamp.{name}"] = {"value": value, "stderr": stderr, "unit": LAMP[name].unit, "identified": True}
    return found


def _mean(values: list[float]) -> float:
    return 1e3 * sum(values) / len(values) if values else float("nan")
