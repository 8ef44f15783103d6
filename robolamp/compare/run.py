"""The whole comparison: read the log, replay it, align, judge, diagnose, write the report."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.compare.align import MIN_SAMPLES, JointError, Trace, compare_joint
from robolamp.compare.comparison import Comparison
from robolamp.compare.diagnosis import diagnose
from robolamp.compare.replay import Replay, replay
from robolamp.compare.report import write_report
from robolamp.compare.tolerances import Tolerances, load_tolerances
from robolamp.errors import FileError
from robolamp.lamp import load_lamp
from robolamp.log.reader import Run, read_run, read_truth
from robolamp.log.schemas import TWIN_PREFIX
from robolamp.log.writer import LogWriter


def compare_log(
    log: Path | str,
    *,
    assets: Assets,
    calibration: Calibration,
    out: Path | str,
    truth: Path | str | None = None,
    tolerances: Tolerances | None = None,
) -> Comparison:
    """Replay a log in the twin, compare, and write the report and the replay's own log beside it.

    Args:
        log: The lamp's log.
        assets: Where lamp, model and tolerances are.
        calibration: What the twin is calculated with.
        out: The HTML report; the replay's log gets the same name with ".twin.mcap".
        truth: The truth log of an emulated lamp, where there is one.
        tolerances: What is allowed; None: calibration/tolerances/default.toml.

    Raises:
        FileError: A file is missing, is no log, or belongs to another lamp; the report cannot be written.
        SafetyError: A logged goal is outside the lamp's limits.
    """
    report = Path(out)
    twin_log = report.with_name(f"{report.stem}.twin.mcap")
    for given in (log, truth):
        if given is not None and Path(given).resolve() in (report.resolve(), twin_log.resolve()):
            raise FileError("would be overwritten by the report or the replay's log; choose another -o", str(given))
    allowed = tolerances or load_tolerances(assets)
    run = read_run(log)
    true = None if truth is None else read_truth(truth)
    lamp = load_lamp(assets)
    twin = replay(run, lamp, calibration, assets)
    joints = compare_joints(run, twin)
    if not any(joint.samples for joint in joints):
        raise FileError("no joint has a reading to compare", str(run.path))
    travel = (
        (math.nan if true is None else _travel(run, run.at(true.log_time), true.base_x, true.path)),
        _travel(run, twin.time, twin.base_x, run.path),
    )
    comparison = Comparison(
        run=run,
        replay=twin,
        truth=true,
        joints=joints,
        lamp_travel=travel[0],
        twin_travel=travel[1],
        calibration=calibration,
        tolerances=allowed,
        exceeded=tuple(_exceeded(joints, travel, allowed)),
        diagnosis=tuple(diagnose(run, twin, joints, calibration, travel)),
        report=report,
        twin_log=twin_log,
    )
    _write_twin_log(comparison)
    write_report(comparison)
    return comparison


def compare_joints(run: Run, twin: Replay) -> tuple[JointError, ...]:
    """Return the difference joint by joint over phase "run"; over everything where that phase is missing or cut short.

    Args:
        run: The lamp's run.
        twin: The twin's replay.
    """
    rows = compared(run)
    return tuple(
        compare_joint(
            name,
            Trace.of(twin.time, twin.angle[:, index]),
            Trace.of(run.sampled_at[rows, index], run.angle[rows, index]),
            int(np.count_nonzero(rows)),
        )
        for index, name in enumerate(run.joints)
    )


def compared(run: Run) -> NDArray[np.bool_]:
    """Return which ticks are compared, shape (N,): standing still at the start would dilute the errors.

    Args:
        run: The lamp's run.
    """
    running = run.phase == "run"
    return running if np.count_nonzero(running) >= MIN_SAMPLES else np.ones(run.index.size, bool)


def _travel(run: Run, time: NDArray[np.float64], base_x: NDArray[np.float64], path: Path) -> float:
    begin, end = float(run.began[0]), float(run.write_done[-1])
    if time[-1] < begin or time[0] > end:
        raise FileError(f"has nothing of the time of {run.path}: it is of another run", str(path))
    start, stop = np.interp([begin, end], time, base_x)
    return float(stop - start)


def _exceeded(joints: tuple[JointError, ...], travel: tuple[float, float], allowed: Tolerances) -> list[str]:
    found = []
    for joint in joints:
        if joint.samples == 0:
            found.append(f"{joint.name}: no readings to compare")
        if joint.after.mae > allowed.joint_mae:
            found.append(
                f"{joint.name}: MAE {joint.after.mae * 1e3:.1f} mrad with the lag removed, "
                f"allowed {allowed.joint_mae * 1e3:.1f} mrad"
            )
        if abs(joint.lag) > allowed.lag:
            found.append(f"{joint.name}: lag {joint.lag * 1e3:+.1f} ms, allowed {allowed.lag * 1e3:.1f} ms")
    difference = travel[0] - travel[1]
    if abs(difference) > allowed.travel:
        found.append(
            f"travel: lamp {travel[0] * 1e2:.1f} cm, twin {travel[1] * 1e2:.1f} cm, "
            f"allowed difference {allowed.travel * 1e2:.1f} cm"
        )
    return found


def _write_twin_log(comparison: Comparison) -> None:
    run, path = comparison.run, comparison.twin_log
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
    partial = path.with_name(f".{path.name}.partial")
    try:
        with LogWriter(partial, context=context, joints=run.joints, now=now, lossless=True) as log:
            for tick in comparison.replay.ticks:
                log.tick(tick, prefix=TWIN_PREFIX)
        if log.error:
            raise FileError(f"cannot be written: {log.error}", str(path))
        partial.replace(path)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()
