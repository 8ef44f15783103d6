"""`robolamp compare`: does the lamp still do what its twin says?"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.output import print_json
from robolamp.errors import FileError


def compare(
    log: Path,
    /,
    *,
    calibration: str = "nominal",
    lamp: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    truth: Path | None = None,
    tolerances: str = "default",
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Compare a run of the lamp with its twin: the twin replays the log's goals, and the two are laid over each other.

    Tells each joint's lag and error, the base's travel, and what probably differs, and writes a report to look at.
    Exit code 0: inside the tolerances; 1: outside; 2: could not compare.

    Args:
        log: The log of the run (MCAP), from `robolamp dry-run` or `robolamp deploy`.
        calibration: What the twin is calculated with: a calibration file, or the name of one.
        lamp: Your own lamp's folder (laid out like robolamp's: hardware/, sim/, calibration/).
        output: The report (HTML); by default beside the log, with its name. The replay's log goes beside it.
        truth: What an emulated lamp truly did: the log of `robolamp emulate --truth`.
        tolerances: What is allowed: a TOML file, or the name of one in calibration/tolerances/.
        as_json: Print one JSON object.
    """
    from robolamp.compare.report import sentence  # mujoco and matplotlib load after the arguments
    from robolamp.compare.run import compare_log
    from robolamp.compare.tolerances import load_tolerances

    if not log.name:
        raise FileError("is a folder; expected a log (.mcap)", str(log))
    assets = Assets.of(lamp)
    result = compare_log(
        log,
        assets=assets,
        calibration=load_calibration(assets, calibration),
        out=output or log.with_suffix(".html"),
        truth=truth,
        tolerances=load_tolerances(assets, tolerances),
    )
    if as_json:
        print_json(result.as_dict())
    else:
        print(f"{result.verdict} tolerances. {sentence(result)}")
        for joint in result.joints:
            lag = f"{joint.lag * 1e3:+6.1f} ms" if math.isfinite(joint.lag) else "unknown  "
            print(
                f"  {joint.name:<8} lag {lag}   MAE {joint.before.mae * 1e3:6.1f} -> "
                f"{joint.after.mae * 1e3:5.1f} mrad   RMSE {joint.before.rmse * 1e3:6.1f} -> "
                f"{joint.after.rmse * 1e3:5.1f} mrad"
            )
        for line in result.exceeded:
            print(f"  outside: {line}")
        for finding in result.diagnosis:
            print(f"  {finding.cause}: {finding.evidence}")
        print(f"report: {result.report}")
    return 1 if result.exceeded else 0
