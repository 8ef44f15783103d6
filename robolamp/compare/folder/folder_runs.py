"""A folder of runs against the twin: each run's results, their trend, and the sim-to-real correlation."""

from __future__ import annotations

import csv
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.compare.compare_logs import compare_joints, seen
from robolamp.compare.logged_motion import truth_of
from robolamp.compare.replays.goal_replay import replays
from robolamp.compare.replays.trajectory import of_replay
from robolamp.compare.run_ending import ending_of
from robolamp.compare.travel.sensed_flights import flights, hops
from robolamp.compare.verdicts.controller_alone import Alone, alone_of
from robolamp.compare.verdicts.ensemble import nearest, starts
from robolamp.compare.verdicts.task_verdict import DONE, Task, task_of
from robolamp.compare.verdicts.tolerances import Tolerances, load_tolerances
from robolamp.compare.verdicts.twin_verdict import INSIDE, Verdict, verdict_of
from robolamp.errors import FileError, RobolampError
from robolamp.files import all_below, is_file, read_text, shown, suffix_of
from robolamp.lamp import Lamp, load_lamp
from robolamp.log.reader import read_run

TRAVELS = "travel.csv"
"""File of a folder that holds travels taken with a ruler: columns log, travel_m."""
LEAST = 3
"""Fewer controllers than this have no correlation."""


@dataclass(frozen=True)
class Row:
    """One run.

    Attributes:
        log: Its log.
        began: When it began [s since the epoch].
        controller: The controller's name.
        goal: Where it was sent [m]; NaN where the log does not say.
        mae: Mean over the joints of the MAE without the lag [rad].
        lag: Median lag of the joints [s].
        hops: The lamp's hops.
        twin_hops: The twin's.
        travel: The lamp's travel [m]; NaN where nobody knows.
        twin_travel: The twin's, on the goals that the lamp was sent [m].
        task: Whether the lamp did its task.
        judged: Whether the twin explains it.
        alone: What the controller does alone on the twin.
    """

    log: Path
    began: float
    controller: str
    goal: float
    mae: float
    lag: float
    hops: int
    twin_hops: int
    travel: float
    twin_travel: float
    task: Task
    judged: Verdict
    alone: Alone

    @property
    def why(self) -> str:
        """Return why it is not done, or not inside; empty where it is both."""
        words = (self.task.word, self.task.why, DONE), (self.judged.word, self.judged.why, INSIDE)
        return "; ".join(f"{word}: {'; '.join(why)}" for word, why, well in words if word != well)

    @property
    def score(self) -> float:
        """Return the lamp's landing error |travel - goal| [m]; NaN where nobody knows. Smaller is better."""
        return abs(self.travel - self.goal)

    @property
    def twin_score(self) -> float:
        """Return the landing error of the twin's replay [m]."""
        return abs(self.twin_travel - self.goal)


@dataclass(frozen=True)
class Folder:
    """A folder's runs, in order of time.

    Attributes:
        path: The folder.
        rows: Its runs.
        skipped: Logs that could not be compared, and why.
        calibration: What the twin was calculated with.
    """

    path: Path
    rows: tuple[Row, ...]
    skipped: tuple[tuple[Path, str], ...]
    calibration: Calibration

    def correlation(self, lamp: Callable[[Row], float], twin: Callable[[Row], float]) -> tuple[float, int]:
        """Return Pearson's correlation of lamp and twin over controllers, and the number of controllers.

        A controller's value is the mean over its runs; runs of which one of the two is not known do not count.

        Args:
            lamp: The lamp's value of a run.
            twin: The twin's.
        """
        groups: dict[str, list[tuple[float, float]]] = defaultdict(list)
        for row in self.rows:
            pair = (lamp(row), twin(row))
            if np.isfinite(pair).all():
                groups[row.controller].append(pair)
        means = np.array([np.mean(pairs, axis=0) for pairs in groups.values()])
        if len(means) < LEAST or (means.std(axis=0) < 1e-12).any():
            return math.nan, len(means)
        return float(np.corrcoef(means.T)[0, 1]), len(means)

    def trend(self) -> tuple[float, float]:
        """Return how the error grows from run to run and its standard error [rad a run]; NaN below four runs."""
        error = np.array([row.mae for row in self.rows])
        error = error[np.isfinite(error)]
        if error.size < 4:
            return math.nan, math.nan
        number = np.arange(error.size) - (error.size - 1) / 2
        slope = float((number * error).sum() / (number**2).sum())
        left = error - error.mean() - slope * number
        return slope, float(np.sqrt((left**2).sum() / (error.size - 2) / (number**2).sum()))

    def sentences(self) -> list[str]:
        """Return counts of tasks and verdicts, trend and correlations in words."""
        tasks, verdicts = Counter(row.task.word for row in self.rows), Counter(row.judged.word for row in self.rows)
        good = sum((row.task.word, row.judged.word) == (DONE, INSIDE) for row in self.rows)
        said = [
            f"Of {len(self.rows)}, {_counts(tasks)}; by the twin's replay {_counts(verdicts)}; {good} done and inside."
        ]
        slope, error = self.trend()
        if math.isfinite(slope):
            word = "grows" if slope > 0 else "falls"
            sure = "" if abs(slope) > 2 * error else ", which is no more than its own scatter"
            said.append(f"The error {word} by {abs(slope) * 1e3:.2f} ± {error * 1e3:.2f} mrad from run to run{sure}.")
        for what, lamp, twin in (
            ("landing error (|travel - goal|)", lambda row: row.score, lambda row: row.twin_score),
            ("travel", lambda row: row.travel, lambda row: row.twin_travel),
            ("hops", lambda row: row.hops, lambda row: row.twin_hops),
        ):
            value, count = self.correlation(lamp, twin)
            if math.isfinite(value):
                said.append(f"Sim-to-real correlation (SRCC) of the {what} over {count} controllers: {value:+.2f}.")
            elif what != "travel":
                why = f"{count} with both sides known, {LEAST} needed" if count < LEAST else "they do not differ in it"
                said.append(f"No correlation of the {what} over controllers: {why}.")
        return said

    def as_dict(self) -> dict[str, Any]:
        """Return what `robolamp compare FOLDER --json` prints."""
        landing, controllers = self.correlation(lambda row: row.score, lambda row: row.twin_score)
        travel, _ = self.correlation(lambda row: row.travel, lambda row: row.twin_travel)
        hops, _ = self.correlation(lambda row: row.hops, lambda row: row.twin_hops)
        slope, error = self.trend()
        return {
            "runs": [
                {
                    "log": row.log,
                    "began": datetime.fromtimestamp(row.began).astimezone().isoformat(timespec="seconds"),
                    "task": row.task.word,
                    "task_why": list(row.task.why),
                    "verdict": row.judged.word,
                    "verdict_why": list(row.judged.why),
                    "twin_alone_m": row.alone.travel,
                    "controller": row.controller,
                    "goal_m": row.goal,
                    "mae_mrad": row.mae * 1e3,
                    "lag_ms": row.lag * 1e3,
                    "hops": row.hops,
                    "twin_hops": row.twin_hops,
                    "travel_m": row.travel,
                    "twin_travel_m": row.twin_travel,
                    "landing_error_m": row.score,
                    "twin_landing_error_m": row.twin_score,
                }
                for row in self.rows
            ],
            "skipped": [{"log": path, "why": why} for path, why in self.skipped],
            "srcc": {"landing_error": landing, "travel": travel, "hops": hops, "controllers": controllers},
            "trend_mae_mrad_per_run": slope * 1e3,
            "trend_stderr_mrad_per_run": error * 1e3,
            "calibration": self.calibration.name,
        }


def _counts(words: Counter[str]) -> str:
    return ", ".join(f"{count} {word}" for word, count in words.most_common())


def compare_folder(
    path: Path, *, assets: Assets, calibration: Calibration, tolerances: Tolerances | None = None
) -> Folder:
    """Compare every lamp's log of a folder, and of the folders in it, with the twin.

    A run's travel is that of `truth.mcap` (or NAME.truth.mcap) beside its log, or the folder's travel.csv.

    Args:
        path: The folder.
        assets: Where lamp and model are.
        calibration: What the twin is calculated with.
        tolerances: What is allowed; None: calibration/tolerances/default.toml.

    Raises:
        FileError: The folder holds no log that can be compared, or one that cannot be looked into, or its travel.csv is
            malformed.
    """
    lamp, allowed = load_lamp(assets), tolerances or load_tolerances(assets)
    measured = _travels(path / TRAVELS)
    rows, skipped = [], []
    for log in all_below(path):
        if suffix_of(log) != ".mcap" or log.name.lower().endswith(("truth.mcap", ".twin.mcap")):
            continue
        try:
            ruler = measured.get(log.relative_to(path).as_posix())
            rows.append(_row(log, lamp, calibration, assets, allowed, ruler))
        except RobolampError as error:
            skipped.append((log, error.message))
    skipped += [(path / name, f"is in {TRAVELS}, but not here") for name in measured if not (path / name).is_file()]
    if not rows:
        why = f"; {skipped[0][0].name} {skipped[0][1]}" if skipped else ""
        raise FileError(f"holds no log (.mcap) that can be compared{why}", str(path))
    rows.sort(key=lambda row: row.began)
    return Folder(path, tuple(rows), tuple(skipped), calibration)


def _row(
    log: Path, lamp: Lamp, calibration: Calibration, assets: Assets, allowed: Tolerances, ruler: float | None
) -> Row:
    run = read_run(log)
    ours, landing = seen(run, truth_of(run, None), ruler, lamp)
    twins = replays(run, lamp, calibration, assets, starts)
    place, spread = nearest(run, lamp, ours, twins, allowed)
    other = of_replay(run, twins[place])
    ending, all_joints = ending_of(run), compare_joints(run, ours, other)
    alone = alone_of(run, ending, lamp, calibration, assets, allowed.goal)
    found = hops(flights(ours, lamp), flights(other, lamp))
    joints = [joint for joint in all_joints if joint.samples]
    lags = [joint.lag for joint in joints if math.isfinite(joint.lag)]
    return Row(
        log=log,
        began=float(run.log_time[0]) * 1e-9,
        controller=run.context.get("controller_name") or "unknown",
        goal=run.goal_m,
        mae=float(np.mean([joint.after.mae for joint in joints])) if joints else math.nan,
        lag=float(np.median(lags)) if lags else math.nan,
        hops=ours.hops,
        twin_hops=other.hops,
        travel=ours.travel,
        twin_travel=other.travel,
        task=task_of(run, lamp, ending, landing, alone, allowed.goal),
        judged=verdict_of(run, [ending], all_joints, found, ours, other, allowed, spread),
        alone=alone,
    )


def _travels(path: Path) -> dict[str, float]:
    if not is_file(path):
        return {}
    found: dict[str, float] = {}
    reader = csv.reader(read_text(path).splitlines())
    try:
        for number, fields in enumerate(reader, start=1):
            if number == 1 and [field.strip() for field in fields] == ["log", "travel_m"]:
                continue
            where = f"{path}, line {number}"
            new = _travel(fields, where)
            if new.keys() & found.keys():
                raise FileError(f"{shown(*new)} stands twice", where)
            found |= new
    except csv.Error as error:
        raise FileError(f"line {reader.line_num}: {error}", str(path)) from None
    return found


def _travel(fields: Sequence[str], where: str) -> dict[str, float]:
    if not "".join(fields).strip():
        return {}
    try:
        log, travel = fields
        if not math.isfinite(float(travel)):
            raise ValueError
        return {log.strip(): float(travel)}
    except ValueError:
        raise FileError(f"{shown(','.join(fields))} is not LOG,METRES, as run-3/log.mcap,0.281", where) from None
