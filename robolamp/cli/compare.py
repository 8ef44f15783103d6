"""`robolamp compare`: does the lamp still do what its twin does, or what it did yesterday?"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.options import MAX_GOAL, length
from robolamp.cli.screen.output import counted, print_json
from robolamp.errors import FileError, RobolampError

if TYPE_CHECKING:
    from robolamp.compare.comparison import Comparison
    from robolamp.compare.folder.folder_runs import Folder


def compare(
    run: Path,
    other: Path | None = None,
    /,
    *,
    calibration: str = "nominal",
    lamp: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    truth: Path | None = None,
    landed: str | None = None,
    tolerances: str = "default",
    diagnosis: bool = True,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Compare a run of the lamp with its twin, with another run, or a folder of runs with the twin.

    One log: the twin replays its goal angles, and the two are compared. Two logs of one controller: yesterday's lamp
    and today's, or a lamp and a twin. A folder: every run in it, the trend, and how well the twin's scores correlate
    with the lamp's over controllers.

    It answers three questions first. Did it do the task: at rest at its goal, upright, at the end of a whole run? Does
    the twin explain it: driven with the goal angles that the lamp was sent, is it within the tolerances? And what does
    the controller do alone on the twin, in its own closed loop? Where something was not measured, or a run was cut, the
    answer is "cannot say", with the reason.

    Then it shows each joint's lag and error, every hop's take-off and landing, causes and remedies; and it writes a
    report. Exit code 0: inside the tolerances, and nothing says that the task was not done; 1: outside, not
    done, or cannot say whether it is inside; 2: could not compare. A folder is 0 or 2.

    Args:
        run: The log of a run (MCAP), from `robolamp dry-run` or `robolamp deploy`; or a folder of them.
        other: A second log. The later one is compared with the earlier one, a lamp's with a twin's.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        output: The report (HTML) to write, with the replay's log beside it; by default beside the log, with its name.
        truth: The truth log of the first log: what an emulated lamp really did (`robolamp emulate --truth`). By default
            truth.mcap, or NAME.truth.mcap, beside each log.
        landed: How far the lamp's base came, measured with a ruler, as 28.1cm; for one log. A physical lamp cannot
            measure it itself; without it compare cannot say whether it did its task, nor whether the twin explains it.
        tolerances: How far lamp and twin may differ: a TOML file, or the name of one in calibration/tolerances/.
        diagnosis: Name causes, found by replays of twins with one number changed; without it, a few seconds faster.
        as_json: Print one JSON object.
    """
    from robolamp.compare.verdicts.tolerances import load_tolerances  # the heavy libraries load after the arguments

    assets = Assets.of(lamp)
    numbers, allowed = load_calibration(assets, calibration), load_tolerances(assets, tolerances)
    ruler = None if landed is None else length(landed, "--landed", low=-MAX_GOAL)
    if ruler is not None and (other is not None or run.is_dir()):
        raise RobolampError("is for one log; a folder has travel.csv", "--landed")
    if run.is_dir():
        if other is not None or truth is not None:
            raise RobolampError("is for logs; a folder is compared by itself", "--truth" if truth else str(other))
        from robolamp.compare.folder.folder_report import write_folder_report
        from robolamp.compare.folder.folder_runs import compare_folder

        folder = compare_folder(run, assets=assets, calibration=numbers, tolerances=allowed)
        report = output or run / "compare.html"
        write_folder_report(folder, report)
        if as_json:
            print_json({**folder.as_dict(), "report": report})
        else:
            _tell_folder(folder, report)
        return 0
    from robolamp.compare.compare_logs import compare_log, compare_logs, read_either
    from robolamp.compare.logged_motion import truth_of

    if not run.name or (other is not None and (not other.name or other.is_dir())):
        raise FileError("is a folder; expected a log (.mcap)", str(run if not run.name else other))
    if other is None:
        out = output or run.with_suffix(".html")
        known = truth_of(read_either(run), truth)
        result = compare_log(
            run, assets=assets, calibration=numbers, out=out, truth=known and known.path, landed=ruler,
            tolerances=allowed, diagnosis=diagnosis,
        )  # fmt: skip
    else:
        first, second = read_either(run), read_either(other)
        known = truth_of(first, truth), truth_of(second, None)
        truths = known[0] and known[0].path, known[1] and known[1].path
        simulated = [each.context.get("backend") == "twin" for each in (first, second)]
        # Without a twin among them, the later run is compared with the earlier one.
        if simulated == [True, False] or (not any(simulated) and first.log_time[0] < second.log_time[0]):
            run, other, truths = other, run, (truths[1], truths[0])
        out = output or run.with_name(f"{run.stem}-{other.stem}.html")
        result = compare_logs(
            run, other, assets=assets, calibration=numbers, out=out, truths=truths, tolerances=allowed,
            diagnosis=diagnosis,
        )  # fmt: skip
    if as_json:
        print_json(result.as_dict())
    else:
        _tell(result)
    return 0 if result.good else 1


def _tell(result: Comparison) -> None:
    from robolamp.compare.report.comparison_page import sentence, three

    for asked, word, why in three(result):
        print(f"{asked:<38} {word}. {why}".rstrip())
    print(sentence(result))
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
    for number, finding in enumerate(result.diagnosis, start=1):
        print(f"  {number}. {finding.cause} ({finding.explains}): {finding.evidence}\n     {finding.remedy}")
    print(f"  {result.account.left}")
    print(f"report: {result.report}")


def _tell_folder(folder: Folder, report: Path) -> None:
    print(f"{counted(len(folder.rows), 'run')} in {folder.path}, against the twin ({folder.calibration.name})")
    print(
        f"  {'task':<10} {'twin':<10} {'controller':<16} {'goal':>7} {'lamp':>8} {'alone':>8} {'replay':>8} "
        f"{'MAE':>10} {'lag':>9}  log"
    )
    for row in folder.rows:
        print(
            f"  {row.task.word:<10} {row.judged.word:<10} {row.controller:<16} {_cm(row.goal):>7} "
            f"{_cm(row.travel):>8} {_cm(row.alone.travel):>8} {_cm(row.twin_travel):>8} "
            f"{row.mae * 1e3:5.1f} mrad {row.lag * 1e3:+6.1f} ms  {row.log.relative_to(folder.path)}"
        )
        if row.why:
            print(f"    {row.why}")
    for path, why in folder.skipped:
        print(f"  skipped {path.relative_to(folder.path)}: {why}")
    print("\n".join(folder.sentences()))
    print(f"report: {report}")


def _cm(metres: float) -> str:
    return f"{metres * 100:.1f} cm" if math.isfinite(metres) else "unknown"
