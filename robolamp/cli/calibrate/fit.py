"""`robolamp calibrate fit`: a servo's parameters from recordings of it on a pendulum bench."""

from __future__ import annotations

import datetime
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.screen.output import print_json
from robolamp.cli.screen.progress_bar import bar, note
from robolamp.files import spare


def fit(
    recordings: Annotated[list[Path], Parameter(negative="")],
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    base: str = "nominal",
    leave_out: Annotated[list[str] | None, Parameter(negative="")] = None,
    starts: Annotated[int, Parameter(validator=validators.Number(gte=1, lte=100))] = 3,
    seed: Annotated[int, Parameter(validator=validators.Number(gte=0))] = 1,
    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
    by: str = "",
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Fit a servo's parameters to recordings of it on a pendulum bench.

    Args:
        recordings: Recordings, or folders of them; three or more: of `robolamp calibrate record --servo` (.mcap),
            .json of Rhoban/bam, .csv.
        output: The calibration file to write.
        base: Calibration to start from, which gives the priors: a file, or a name in calibration/. Parameters stay near
            its values unless the recordings say otherwise.
        leave_out: Names of recordings (files) to leave out of the fit and judge it by; by default each third of the
            recordings is predicted by a fit to the others.
        starts: Starting points of each fit: more find better fits, and take longer.
        seed: Seed of the starting points.
        workers: Threads; by default one for each core.
        by: Your name, for the file's provenance.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object: file, parameters (value, stderr, unit, identified), mae_mrad,
            left_out_mae_mrad, ladder, findings.
    """
    from robolamp.calibrate.servo.calibration_file import write_servo_file
    from robolamp.calibrate.servo.recordings import read_recordings
    from robolamp.calibrate.servo.servo_fit import advice, fit_servo  # mujoco and numba load after the arguments
    from robolamp.calibrate.servo.soundness import require_sound
    from robolamp.calibration import JOINT, SERVO

    known = load_calibration(Assets.of(lamp), base)
    notes: list[str] = []
    found = read_recordings(recordings, notes.append)
    spare(output, *(recording.path for recording in found))
    require_sound(found)
    for text in notes if not as_json else []:
        note(text)
    with bar("fitting", quiet=as_json) as share:
        result = fit_servo(
            found,
            known,
            leave_out=leave_out or (),
            seed=seed,
            starts=starts,
            workers=workers,
            told=lambda line: print(line, file=sys.stderr, flush=True),
            share=share,
        )
    write_servo_file(output, result, by=by, date=datetime.date.today().isoformat())
    legal, values, stderr = {**SERVO, **JOINT}, result.solution.values, result.stderr
    if as_json:
        print_json(
            {
                "file": output,
                "parameters": {
                    name: {
                        "value": values[name],
                        "stderr": stderr[name],
                        "unit": legal[name].unit,
                        "identified": result.identified(name),
                    }
                    for name in result.solution.chart.names
                },
                "mae_mrad": result.mae.mean() * 1e3,
                "left_out_mae_mrad": result.left_out_mae * 1e3,
                "ladder": [
                    {
                        "rung": each.rung.name,
                        "kept": each.kept,
                        "mae_mrad": each.mae * 1e3,
                        "left_out_mae_mrad": each.left_out_mae * 1e3,
                    }
                    for each in result.ladder
                ],
                "findings": advice(result),
                "notes": notes,
                "wall_s": result.seconds,
                "servo_s": result.servo_seconds,
            }
        )
        return 0
    for name in result.solution.chart.names:
        error = f"± {stderr[name]:<9.2g}" if result.identified(name) else "not known  "
        print(f"  {name:<24} {values[name]:>10.5g} {error} {legal[name].unit}")
    seen, unseen = result.mae.mean() * 1e3, result.left_out_mae * 1e3
    print(f"mean absolute error {seen:.1f} mrad, on left-out recordings {unseen:.1f} mrad")
    for line in advice(result):
        print(f"  {line}")
    print(f"{output}   ({result.seconds:.0f} s; {result.servo_seconds:.0f} s of servo time simulated)")
    return 0
