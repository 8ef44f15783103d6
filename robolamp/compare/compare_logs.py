"""The whole comparison: read the log, replay it, align, judge, diagnose, write the report."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.compare.align import JointError, Trace, compare_joint
from robolamp.compare.causes.between_runs import changed
from robolamp.compare.causes.evidence import Evidence
from robolamp.compare.causes.ranking import NOT_ASKED, Account, explain
from robolamp.compare.causes.words import Finding, diagnose
from robolamp.compare.comparison import Comparison
from robolamp.compare.divergence import parting, plain, residuals, spectrum
from robolamp.compare.pauses import origin
from robolamp.compare.replays.controller_replay import replay_controller
from robolamp.compare.replays.goal_replay import Replay, replays
from robolamp.compare.replays.trajectory import Side, compared, of_replay, of_run
from robolamp.compare.report.comparison_page import write_report
from robolamp.compare.run_ending import ending_of
from robolamp.compare.travel.landing import Landing, landing_of
from robolamp.compare.travel.measured_way import measured_way
from robolamp.compare.travel.sensed_flights import flights, hops
from robolamp.compare.verdicts.controller_alone import alone_of
from robolamp.compare.verdicts.ensemble import Spread, between, nearest, starts
from robolamp.compare.verdicts.task_verdict import task_of
from robolamp.compare.verdicts.tolerances import Tolerances, load_tolerances
from robolamp.compare.verdicts.twin_verdict import verdict_of
from robolamp.errors import FileError
from robolamp.files import partial
from robolamp.lamp import Lamp, load_lamp
from robolamp.log.reader import Run, Truth, read_run, read_truth
from robolamp.log.run_context import PLAYED
from robolamp.log.schemas import TWIN_PREFIX
from robolamp.log.writer import LogWriter


def compare_log(
    log: Path | str,
    *,
    assets: Assets,
    calibration: Calibration,
    out: Path | str,
    truth: Path | str | None = None,
    landed: float | None = None,
    tolerances: Tolerances | None = None,
    diagnosis: bool = True,
) -> Comparison:
    """Replay a log in the twin, compare, and write the report and the replay's own log beside it.

    Args:
        log: The lamp's log.
        assets: Where lamp, model and tolerances are.
        calibration: What the twin is calculated with.
        out: The HTML report; the replay's log gets the same name with ".twin.mcap".
        truth: The truth log of an emulated lamp, where there is one.
        landed: How far the base came by a ruler [m]; it counts before the truth.
        tolerances: What is allowed; None: calibration/tolerances/default.toml.
        diagnosis: Find causes by replays of twins with one knob changed; takes a few seconds.

    Raises:
        FileError: A file is missing, is no log, or belongs to another lamp; the report cannot be written.
        SafetyError: A logged goal is outside the lamp's limits.
    """
    report = Path(out)
    twin_log = report.with_name(f"{report.stem}.twin.mcap")
    _spare((log, truth), (report, twin_log))
    allowed = tolerances or load_tolerances(assets)
    run = read_run(log)
    true = None if truth is None else read_truth(truth)
    lamp = load_lamp(assets)
    twins = replays(run, lamp, calibration, assets, starts)
    ours, landing = seen(run, true, landed, lamp)
    place, spread = nearest(run, lamp, ours, twins, allowed)
    comparison = _lay_over(
        run, twins[place], lamp, ours, landing, of_replay(run, twins[place]), spread, None, calibration, assets,
        allowed, report, twin_log,
    )  # fmt: skip
    account = explain(Evidence(run, lamp, calibration, assets), lamp) if diagnosis else NOT_ASKED
    found = diagnose(run, account, comparison.joints, calibration, lamp, truth=true)
    return _finish(comparison, tuple(found), account)


def compare_logs(
    log: Path | str,
    reference: Path | str,
    *,
    assets: Assets,
    calibration: Calibration,
    out: Path | str,
    truths: tuple[Path | None, Path | None] = (None, None),
    tolerances: Tolerances | None = None,
    diagnosis: bool = True,
) -> Comparison:
    """Compare two runs of one controller to one goal: a lamp's with a twin's, or today's with yesterday's.

    Both begin at the controller's first tick. The diagnosis replays both in the twin, and says
    what must have changed between them.

    Args:
        log: The run that is judged.
        reference: What it is compared with.
        assets: Where lamp, model and tolerances are.
        calibration: What the twin is calculated with, for the diagnosis.
        out: The HTML report.
        truths: What truly happened in each, of emulated lamps.
        tolerances: What is allowed; None: calibration/tolerances/default.toml.
        diagnosis: Find causes by replays of twins with one knob changed; takes a few seconds.

    Raises:
        FileError: A file is missing, is no log, or belongs to another lamp; the two are of different controllers or
            goals; the report cannot be written.
        SafetyError: A logged goal is outside the lamp's limits.
    """
    report = Path(out)
    _spare((log, reference, *truths), (report,))
    allowed = tolerances or load_tolerances(assets)
    run, held = read_either(log), read_either(reference)
    _same_task(run, held)
    lamp = load_lamp(assets)
    true = [None if truth is None else read_truth(truth) for truth in truths]
    twins = replays(run, lamp, calibration, assets, starts)
    names = called(run, held)
    ours, landing = seen(run, true[0], None, lamp, names[0])
    other = of_run(held, true[1], names[1])
    # Beyond the end of the other's run the two no longer do the same.
    rows = compared(held)
    end = float(held.scheduled[rows][-1]) - origin(held) + held.control_period
    other = dataclasses.replace(other, angle=np.where(other.time <= end, other.angle, np.nan))
    other = other.on_clock_of(run, held)
    spread = between(run, lamp, twins, allowed)
    comparison = _lay_over(
        run, twins[0], lamp, ours, landing, other, spread, held, calibration, assets, allowed, report, None
    )
    account = NOT_ASKED
    if diagnosis:
        both = Evidence(run, lamp, calibration, assets), Evidence(held, lamp, calibration, assets)
        account = changed(*both, lamp)
    than = "on the twin" if comparison.other.name == "twin" else "before"
    found = diagnose(run, account, comparison.joints, calibration, lamp, than, truth=true[0])
    return _finish(comparison, tuple(found), account)


def read_either(path: Path | str) -> Run:
    """Read a lamp's log, or the log of a twin's replay.

    Args:
        path: The log.

    Raises:
        FileError: It is neither.
    """
    try:
        return read_run(path)
    except FileError as error:
        try:
            return read_run(path, TWIN_PREFIX)
        except FileError:
            raise error from None


def compare_joints(run: Run, lamp: Side, other: Side) -> tuple[JointError, ...]:
    """Return the difference joint by joint over phase "run"; over everything where that phase is missing or cut short.

    Args:
        run: The lamp's run.
        lamp: What the lamp did.
        other: What it is compared with.
    """
    rows = compared(run)
    return tuple(
        compare_joint(
            name,
            other.trace(index),
            Trace.of(lamp.time[rows, index], lamp.angle[rows, index]),
            int(np.count_nonzero(rows)),
        )
        for index, name in enumerate(run.joints)
    )


def _lay_over(
    run: Run,
    twin: Replay,
    lamp: Lamp,
    ours: Side,
    landing: Landing,
    other: Side,
    spread: Spread,
    reference: Run | None,
    calibration: Calibration,
    assets: Assets,
    allowed: Tolerances,
    report: Path,
    twin_log: Path | None,
) -> Comparison:
    joints = compare_joints(run, ours, other)
    if not any(joint.samples for joint in joints):
        raise FileError("no joint has a reading to compare", str(run.path))
    found = hops(flights(ours, lamp), flights(other, lamp))
    off = residuals(run, ours, other, joints)
    rows = compared(run)
    zero = origin(run)
    ending = ending_of(run)
    endings = [ending] if reference is None else [ending, ending_of(reference)]
    alone = alone_of(run, ending, lamp, calibration, assets, allowed.goal)
    begin, end = float(run.scheduled[rows][0]) - zero, float(run.scheduled[rows][-1]) - zero
    within = [(time[(time >= begin) & (time <= end)], error[(time >= begin) & (time <= end)]) for time, error in off]
    return Comparison(
        run=run,
        lamp=ours,
        other=other,
        reference=reference,
        replay=twin,
        joints=joints,
        plain=plain(ours, other, rows),
        spectra=tuple(spectrum(joint.name, *each) for joint, each in zip(joints, within, strict=True)),
        flights=tuple(found),
        parting=parting(run, ours, other, joints, found, allowed.joint_mae, allowed.travel),
        control=replay_controller(run, lamp),
        calibration=calibration,
        tolerances=allowed,
        task=task_of(run, lamp, ending, landing, alone, allowed.goal),
        judged=verdict_of(run, endings, joints, found, ours, other, allowed, spread, reference),
        spread=spread,
        alone=alone,
        landing=landing,
        way=measured_way(run, landing.travel),
        diagnosis=(),
        account=NOT_ASKED,
        report=report,
        twin_log=twin_log,
    )


def seen(run: Run, truth: Truth | None, ruler: float | None, lamp: Lamp, name: str = "lamp") -> tuple[Side, Landing]:
    """Return the lamp's side of a run, and where it landed: by the ruler if there is one, else by the truth log.

    Args:
        run: The log.
        truth: What the emulated lamp truly did, where that is known.
        ruler: How far the base came [m]; None: nobody measured it.
        lamp: The lamp's description.
        name: What to call it.

    Raises:
        FileError: The truth is of another run.
    """
    side, landing = of_run(run, truth, name), landing_of(run, truth, lamp)
    if ruler is None:
        return side, landing
    return dataclasses.replace(side, travel=ruler), dataclasses.replace(landing, travel=ruler)


def _finish(comparison: Comparison, found: tuple[Finding, ...], account: Account) -> Comparison:
    whole = dataclasses.replace(comparison, diagnosis=found, account=account)
    if whole.twin_log is not None:
        _write_twin_log(whole, whole.twin_log)
    write_report(whole)
    return whole


def _spare(given: tuple[Path | str | None, ...], made: tuple[Path, ...]) -> None:
    for path in given:
        if path is not None and Path(path).resolve() in [each.resolve() for each in made]:
            raise FileError("would be overwritten by the report or the replay's log; choose another -o", str(path))


def _same_task(run: Run, held: Run) -> None:
    if run.joints != held.joints:
        raise FileError(
            f"is of joints {', '.join(held.joints)}; {run.path} is of {', '.join(run.joints)}", str(held.path)
        )
    if any(run.context.get(kind) != held.context.get(kind) for kind in ("controller", *PLAYED)):
        raise FileError(
            f"is a run of controller {held.context.get('controller_name', 'unknown')!r}; {run.path} is one of "
            f"{run.context.get('controller_name', 'unknown')!r}: only runs of one controller compare",
            str(held.path),
        )
    if run.goal_m != held.goal_m and not (np.isnan(run.goal_m) and np.isnan(held.goal_m)):
        raise FileError(f"goes to {held.goal_m:g} m, {run.path} to {run.goal_m:g} m: not one task", str(held.path))


def called(run: Run, held: Run) -> tuple[str, str]:
    """Return what to call the two sides of two logs: by the file, or by the first folder that is not the same.

    Args:
        run: The run that is judged.
        held: What it is compared with.
    """
    if held.context.get("backend") == "twin":
        return "lamp", "twin"
    ours, theirs = run.path.absolute().with_suffix("").parts, held.path.absolute().with_suffix("").parts
    for one, other in zip(reversed(ours), reversed(theirs), strict=False):
        if one != other:
            return f"lamp {one}", f"lamp {other}"
    return "lamp", "lamp (the same log)"


def _write_twin_log(comparison: Comparison, path: Path) -> None:
    run = comparison.run
    context: Mapping[str, str] = {
        **run.context,
        "backend": "twin",
        "replay_of": str(run.path),
        "calibration": comparison.calibration.source,
        "calibration_name": comparison.calibration.name,
        "calibration_hash": comparison.calibration.hash,
    }
    # The log's own clock, read now: lamp and twin overlay in any viewer without matching of clocks.
    now = float(run.write_done[0]) + (time.time_ns() - int(run.log_time[0])) * 1e-9
    with partial(path) as temporary:
        with LogWriter(temporary, context=context, joints=run.joints, now=now, lossless=True) as log:
            for tick in comparison.replay.ticks:
                log.tick(tick, prefix=TWIN_PREFIX)
        if log.error:
            raise FileError(f"cannot be written: {log.error}", str(path))
