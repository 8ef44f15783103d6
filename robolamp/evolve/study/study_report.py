"""The report of studies: pictures, data, tables and verdicts, all made anew from the folder of runs."""

from __future__ import annotations

import csv
import inspect
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.controller.controller_file import load_controller
from robolamp.evolve.platform import machine
from robolamp.evolve.study import claims, claims_gep
from robolamp.evolve.study.claims import ClaimVerdict
from robolamp.evolve.study.plan import HERE, HOP, JUMPER, STUDIES, TASK, Order, Point, Study
from robolamp.evolve.study.plots import curves_picture, goals_picture
from robolamp.evolve.study.study_runs import Curve, Scale, Shelf
from robolamp.evolve.study.unseen_goals import Tried, try_goals
from robolamp.files import write_atomic
from robolamp.lamp import Lamp

_VERSIONS = ("robolamp", "mujoco", "numpy", "numba")
_INTRODUCTIONS = {
    TASK: """\
# Convergence studies

Section 4 of Gritz & Hahn, "Genetic Programming Evolution of Controllers for 3-D Character Animation" (1997), run again
on this lamp. `robolamp study` wrote this page from the folder of runs and writes it again from there; `make studies`
runs everything at the paper's own points.
""",
    JUMPER: """\
# Studies of gene expression programming

Section 5.1 of Kwasnicka & Wozniak, "EMOT - Evolutionary Approach to 3D Computer Animation", run again on this project's
Jumper. `robolamp study` wrote this page from the folder of runs and writes it again from there.
""",
    HOP: """\
# Trees against genes

The two representations on the hop, with the same task, seeds, goals and lamps. `robolamp study` wrote this page from
the folder of runs and writes it again from there.
""",
}
_FITNESS_RULES = claims.FITNESS_RULES | claims_gep.FITNESS_RULES
_GRID = 60  # points of a curve over physics steps
_METHOD = f"""\
## How to read it

Fitness is lower where better; Gritz & Hahn say that motion looked good below 0.5 (dashed). Left, "as run": the best of
each generation, its style counted by the phase of that generation, as the papers draw it. Right: the same individual
with its style counted in full. Lines are means over seeds, bands go from the smallest to the largest. All points of a
study have the same seeds, and a seed has the same goals everywhere.

A run's result is the fitness of its champion at phase 1, a point's the median over seeds. Two points (or groups) differ
*clearly* when their medians differ by more than twice the standard error of a difference of medians, from the standard
deviation over seeds pooled over the study, and by more than {claims.ALIKE:g}; they are *alike* when they differ by at
most {claims.ALIKE:g} and that bound is at most {claims.COARSE:g}. Anything else is unclear, and a verdict that hangs on
it is "{claims.UNKNOWN}". A controller *arrives* when it ends upright within {claims.ARRIVES:.0%} of the goal's
distance, or within 1.5 cm. The rules were fixed before the runs.
"""


@dataclass(frozen=True)
class Report:
    """What a report says.

    Attributes:
        path: The page; pictures and data are in the folder of its name beside it.
        pictures: PNG files.
        verdicts: On each claim.
    """

    path: Path
    pictures: tuple[Path, ...]
    verdicts: tuple[ClaimVerdict, ...]


@dataclass(frozen=True)
class _Section:
    study: Study
    picture: bytes | None
    rows: list[list[Any]]
    table: list[str]
    verdicts: list[ClaimVerdict]
    rule: str
    missing: list[str]


class Reporter:
    """Writes reports of a folder of runs.

    Args:
        shelf: The runs.
        scale: What they were made with.
        lamp: The lamp.
        calibration: The twin's numbers.
        assets: Where data files are.
        workers: Threads for trying champions on other goals; None: one a core.
    """

    def __init__(
        self, shelf: Shelf, scale: Scale, lamp: Lamp, calibration: Calibration, assets: Assets, workers: int | None
    ) -> None:
        self._shelf, self._scale, self._workers = shelf, scale, workers
        self._lamp, self._calibration, self._assets = lamp, calibration, assets

    def write(self, path: Path, points: Mapping[str, Mapping[str, Point]], commands: Sequence[str]) -> Report:
        """Write a report from the runs that are finished.

        Args:
            path: The page (Markdown).
            points: Of each study, by name, its points as they are run, by the value as typed.
            commands: What makes the runs and the page.

        Raises:
            FileError: A run is damaged, or something cannot be written.
        """
        sections = [self._section(STUDIES[name], settled) for name, settled in points.items()]
        pictures, data = [], path.with_suffix("")
        for section in sections:
            if section.picture is not None:
                pictures.append(data / f"{section.study.name}.png")
                write_atomic(pictures[-1], section.picture)
                write_atomic(data / f"{section.study.name}.csv", _csv(section.rows))
        write_atomic(path, self._page(sections, data.name, commands))
        return Report(path, tuple(pictures), tuple(verdict for section in sections for verdict in section.verdicts))

    def _section(self, study: Study, settled: Mapping[str, Point]) -> _Section:
        runs = {name: self._shelf.curves(point) for name, point in settled.items()}
        missing = [name for name, curves in runs.items() if not curves]
        runs = {name: curves for name, curves in runs.items() if curves}
        compared = _after_equal_steps(runs) if study.equal_steps else runs
        picture = curves_picture(study, compared) if runs and study.name not in claims.GOAL_RULES else None
        if study.name in _FITNESS_RULES:
            rule = _FITNESS_RULES[study.name]
            finals = {name: [curve.final for curve in curves.values()] for name, curves in compared.items()}
            return _Section(
                study, picture, _curve_rows(runs), _curve_table(study, compared), rule(finals), _rule(rule), missing
            )
        if study.name in claims_gep.SUCCESS_RULES:
            rule = claims_gep.SUCCESS_RULES[study.name]
            succeeded = {name: [curve.succeeded for curve in curves.values()] for name, curves in runs.items()}
            return _Section(
                study, picture, _curve_rows(runs), _curve_table(study, runs), rule(succeeded), _rule(rule), missing
            )
        tried = {name: self._tried(study, settled[name], list(curves)) for name, curves in runs.items()}
        rule = claims.GOAL_RULES[study.name]
        shares = {name: [each.shares() for each in tries.values()] for name, tries in tried.items()}
        picture = goals_picture(study, {name: list(tries.values()) for name, tries in tried.items()}) if tried else None
        return _Section(
            study, picture, _goal_rows(tried), _goal_table(study, tried), rule(shares), _rule(rule), missing
        )

    def _tried(self, study: Study, point: Point, seeds: Sequence[int]) -> dict[int, Tried]:
        champions = [
            load_controller(self._shelf.path(Order(point, seed)) / "controller.toml", self._lamp) for seed in seeds
        ]
        task = Order(point, seeds[0]).task(self._assets, self._scale.settings, study.task)
        found = try_goals(
            champions, task, self._lamp, self._calibration, self._assets,
            beyond=study.name == "distance", workers=self._workers,
        )  # fmt: skip
        return dict(zip(seeds, found, strict=True))

    def _page(self, sections: Sequence[_Section], data: str, commands: Sequence[str]) -> str:
        settings = ", ".join(f"`{word}`" for word in self._scale.settings)
        versions = ", ".join(f"{name} {text}" for name, text in machine().items() if name in _VERSIONS)
        scale = (
            f"Task `{self._shelf.task}`"
            + (f" with {settings}" if settings else " as it stands")
            + (
                f", calibration `{self._scale.calibration}`, flights of {self._lamp.flight_time * 1e3:g} ms or longer"
                if self._shelf.task != JUMPER
                else ""
            )
            + f"; {versions}. What makes these runs and this page, and goes on where it was stopped:\n\n"
            + "\n".join(["```", *commands, "```"])
            + "\n"
        )
        verdicts = [(section, verdict) for section in sections for verdict in section.verdicts]
        summary = [f"| the claim | {HERE[self._shelf.task]} |", "| --- | --- |"]
        summary += [
            f"| {verdict.claim} ({section.study.source}) | {verdict.verdict} |" for section, verdict in verdicts
        ]
        parts = [_INTRODUCTIONS[self._shelf.task], scale, "\n".join(summary) + "\n", _METHOD]
        return "\n".join([*parts, *(_told(section, data) for section in sections)])


def _after_equal_steps(runs: Mapping[str, Mapping[int, Curve]]) -> dict[str, dict[int, Curve]]:
    """Cut runs at the physics steps of the shortest, and put their courses on one grid of steps."""
    every = [curve for curves in runs.values() for curve in curves.values()]
    if not every:
        return {}
    first, last = max(curve.physics_steps[0] for curve in every), min(curve.physics_steps[-1] for curve in every)
    grid = np.linspace(first, max(first, last), _GRID).astype(np.int64)
    return {name: {seed: curve.after(grid) for seed, curve in curves.items()} for name, curves in runs.items()}


def _told(section: _Section, data: str) -> str:
    study = section.study
    lines = [f"## {study.title} ({study.source})", ""]
    if section.picture is not None:
        lines += [f"![{study.title}]({data}/{study.name}.png)", "", *section.table, ""]
        lines += [f"Data: [{study.name}.csv]({data}/{study.name}.csv).", ""]
    if section.missing:
        lines += [f"Not run here: {study.axis} {', '.join(section.missing)}.", ""]
    for verdict in section.verdicts:
        lines += [
            f"**{verdict.claim}** {_sentence(HERE[study.task])}: **{verdict.verdict}**. {_sentence(verdict.figures)}",
            "",
        ]
    return "\n".join([*lines, section.rule, ""])


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _rule(function: Callable[..., Any]) -> str:
    """The rule as the function's own description has it."""
    text = " ".join((inspect.getdoc(function) or "").split())
    return text[text.find("Rule:") :] if "Rule:" in text else ""


def _row(cells: Iterable[object]) -> str:
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def _curve_table(study: Study, runs: Mapping[str, Mapping[int, Curve]]) -> list[str]:
    head = (
        study.axis,
        "seeds",
        "median at phase 1",
        "smallest",
        "largest",
        "median as run",
        "individuals",
        "steps [M]",
    )
    lines = [_row(head), _row(["---"] * len(head))]
    for name, curves in runs.items():
        finals = [curve.final for curve in curves.values()]
        lines.append(
            _row(
                [
                    name,
                    len(finals),
                    *(f"{pick(finals):.3f}" for pick in (np.median, np.min, np.max)),
                    f"{np.median([curve.as_run[-1] for curve in curves.values()]):.3f}",
                    f"{next(iter(curves.values())).individuals[-1]:,}",
                    f"{np.median([curve.physics_steps[-1] for curve in curves.values()]) / 1e6:.1f}",
                ]
            )
        )
    return lines


def _curve_rows(runs: Mapping[str, Mapping[int, Curve]]) -> list[list[Any]]:
    rows: list[list[Any]] = [
        ["point", "seed", "generation", "individuals", "best_fitness", "best_whole", "champion", "physics_steps"]
    ]
    for name, curves in runs.items():
        for seed, curve in curves.items():
            columns = (curve.individuals, curve.as_run, curve.whole, curve.champion, curve.physics_steps)
            rows += [[name, seed, index, *values] for index, values in enumerate(zip(*columns, strict=True))]
    return rows


def _goal_table(study: Study, tried: Mapping[str, Mapping[int, Tried]]) -> list[str]:
    head = (study.axis, "seed", "goals [cm]", "arrives", "hits", "came within 1.5 cm", "falls", "median error / goal")
    lines = [_row(head), _row(["---"] * len(head))]
    for name, tries in tried.items():
        for seed, each in tries.items():
            within = each.goal <= 0.6 + 1e-9
            for part in (within, ~within) if (~within).any() else (within,):
                goal = each.goal[part]
                counts = [f"{values[part].sum()} of {len(goal)}" for values in (each.arrives, each.hit, each.hit_1997)]
                missed = np.median(np.abs(each.error[part]) / goal)
                span = f"{goal[0] * 100:.0f} to {goal[-1] * 100:.0f}"
                lines.append(_row([name, seed, span, *counts, each.fell[part].sum(), f"{missed:.2f}"]))
    return lines


def _goal_rows(tried: Mapping[str, Mapping[int, Tried]]) -> list[list[Any]]:
    rows: list[list[Any]] = [["evolved_for", "seed", "goal_m", "time_s", "error_m", "fell", "hit", "hit_1997"]]
    for name, tries in tried.items():
        for seed, each in tries.items():
            flags = (values.astype(int) for values in (each.fell, each.hit, each.hit_1997))
            columns = (each.goal.round(6), each.time.round(6), each.error, *flags)
            rows += [[name, seed, *values] for values in zip(*columns, strict=True)]
    return rows


def _csv(rows: Iterable[Sequence[Any]]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([f"{cell:.9g}" if isinstance(cell, float) else cell for cell in row] for row in rows)
    return stream.getvalue()
