"""`robolamp compare`: does the lamp still do what its twin says, or what it did yesterday?"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.output import counted, print_json
from robolamp.errors import FileError, RobolampError

if TYPE_CHECKING:
    from robolamp.compare.comparison import Comparison
    from robolamp.compare.folder import Folder


def compare(
    run: Path,
    other: Path | None = None,
    /,
    *,
    calibration: str = "nominal",
    lamp: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    truth: Path | None = None,
    tolerances: str = "default",
    diagnosis: bool = True,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Compare a run of the lamp with its twin, with another run, or a folder of runs with the twin.

    One log: the twin replays its goals, and the two are laid over each other. Two logs of one controller: yesterday's
    lamp and today's, or a lamp and a simulation. A folder: every run in it, how they go over time, and how well the
    twin's scores go along with the lamp's over controllers.

    Tells each joint's lag and error, every hop's take-off and landing, what differs and what settles it, and writes a
    report to look at. Exit code 0: inside the tolerances; 1: outside; 2: could not compare. A folder is 0 or 2.

    Args:
        run: The log of a run (MCAP), from `robolamp dry-run` or `robolamp deploy`; or a folder of them.
        other: A second log. The later one is held against the earlier one; a lamp's against a simulation's.
        calibration: What the twin is calculated with: a calibration file, or the name of one.
        lamp: Your own lamp's folder (laid out like robolamp's: hardware/, sim/, calibration/).
        output: The report (HTML); by default beside the log, with its name. The replay's log goes beside it.
        truth: What an emulated lamp truly did: the log of `robolamp emulate --truth`; of the first log.
        tolerances: What is allowed: a TOML file, or the name of one in calibration/tolerances/.
        diagnosis: Say what differs, from replays of the twin bent in many ways; without it, a few seconds less.
        as_json: Print one JSON object.
    """
    from robolamp.compare.tolerances import load_tolerances  # the heavy libraries load after the arguments

    assets = Assets.of(lamp)
    numbers, allowed = load_calibration(assets, calibration), load_tolerances(assets, tolerances)
    if run.is_dir():
        if other is not None or truth is not None:
            raise RobolampError("is for logs; a folder is compared by itself", "--truth" if truth else str(other))
        from robolamp.compare.folder import compare_folder
        from robolamp.compare.folder_report import write_folder_report

        folder = compare_folder(run, assets=assets, calibration=numbers)
        report = output or run / "compare.html"
        write_folder_report(folder, report)
        if as_json:
            print_json({**folder.as_dict(), "report": report})
        else:
            _tell_folder(folder, report)
        return 0
    from robolamp.compare.run import compare_log, compare_logs, read_either

    if not run.name or (other is not None and (not other.name or other.is_dir())):
        raise FileError("is a folder; expected a log (.mcap)", str(run if not run.name else other))
    if other is None:
        out = output or run.with_suffix(".html")
        result = compare_log(
            run, assets=assets, calibration=numbers, out=out, truth=truth, tolerances=allowed, diagnosis=diagnosis
        )
    else:
        truths = (truth, None)
        first, second = read_either(run), read_either(other)
        simulated = [each.context.get("backend") == "twin" for each in (first, second)]
        # Without a simulation among them, the earlier run is what the later one is held against.
        if simulated == [True, False] or (not any(simulated) and first.log_time[0] < second.log_time[0]):
            run, other, truths = other, run, (None, truth)
        out = output or run.with_name(f"{run.stem}-{other.stem}.html")
        result = compare_logs(
            run, other, assets=assets, calibration=numbers, out=out, truths=truths, tolerances=allowed,
            diagnosis=diagnosis,
        )  # fmt: skip
    if as_json:
        print_json(result.as_dict())
    else:
        _tell(result)
    return 1 if result.exceeded else 0


def _tell(result: Comparison) -> None:
    from robolamp.compare.report import sentence

    print(f"{result.verdict} tolerances. {sentence(result)}")
    for joint in result.joints:
        lag = f"{joint.lag * 1e3:+6.1f} ms" if math.isfinite(joint.lag) else "unknown  "
        print(
            f"  {joint.name:<8} lag {lag}   MAE {joint.before.mae * 1e3:6.1f} -> "
            f"{joint.after.mae * 1e3:5.1f} mrad   RMSE {joint.before.rmse * 1e3:6.1f} -> "
            f"{joint.after.rmse * 1e3:5.1f} mrad"
        )
    for number, hop in enumerate(result.flights, start=1):
        if hop.lamp and hop.twin:
            print(
                f"  hop {number}    takes off {hop.off_late * 1e3:+4.0f} ms, lands {hop.on_late * 1e3:+4.0f} ms; in "
                f"the air {hop.lamp.time * 1e3:.0f} ms for {hop.twin.time * 1e3:.0f}"
            )
        else:
            print(f"  hop {number}    only on the {result.lamp.name if hop.lamp else result.other.name}")
    print(f"  controller {result.control.text}")
    for line in result.exceeded:
        print(f"  outside: {line}")
    for number, finding in enumerate(result.diagnosis, start=1):
        print(f"  {number}. {finding.cause} ({finding.explains}): {finding.evidence}\n     {finding.remedy}")
    print(f"  {result.account.left}")
    print(f"report: {result.report}")


def _tell_folder(folder: Folder, report: Path) -> None:
    print(f"{counted(len(folder.rows), 'run')} in {folder.path}, against the twin ({folder.calibration.name})")
    print(f"  {'controller':<16} {'goal':>7} {'lamp':>8} {'twin':>8} {'MAE':>10} {'lag':>9}  log")
    for row in folder.rows:
        print(
            f"  {row.controller:<16} {_cm(row.goal):>7} {_cm(row.travel):>8} {_cm(row.twin_travel):>8} "
            f"{row.mae * 1e3:5.1f} mrad {row.lag * 1e3:+6.1f} ms  {row.log.relative_to(folder.path)}"
        )
    for path, why in folder.skipped:
        print(f"  skipped {path.relative_to(folder.path)}: {why}")
    print("\n".join(folder.sentences()))
    print(f"report: {report}")


def _cm(metres: float) -> str:
    return f"{metres * 100:.1f} cm" if math.isfinite(metres) else "unknown"
