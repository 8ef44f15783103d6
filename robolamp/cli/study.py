"""`robolamp study`: runs, draws and judges the papers' convergence studies."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from robolamp.cli.options import Setup
from robolamp.cli.screen.output import counted, print_json
from robolamp.errors import RobolampError
from robolamp.evolve.progress import Generation
from robolamp.evolve.study.plan import HERE, STUDIES, TASK, Order, Point, chosen_points, orders, settled
from robolamp.evolve.study.study_report import Report, Reporter
from robolamp.evolve.study.study_runs import Scale, Shelf, carry_out
from robolamp.files import suffix_of

_SPEED_OVER = 3600.0  # time left is reckoned from this long a while [s]: runs differ
_ALL = "all"


def study(
    which: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("runs/studies"),
    seeds: Annotated[int, Parameter(validator=validators.Number(gte=1, lte=1000))] = 3,
    points: str = "paper",
    settings: Annotated[list[str] | None, Parameter(name="--set", negative="")] = None,
    report: Path | None = None,
    draw_only: Annotated[bool, Parameter(negative="")] = False,
    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run the papers' studies of their searches, draw them, and say which of their claims hold here.

    Parameters
    ----------
    which
        For the lamp of 1997: population, generations, selection, crossover (Figures 5 to 8), tuned, specific, distance,
        or all (of these). For Jumper: jumper (ten runs), head, gep-population. For the hop: representation (tree or
        gep).
    output
        Folder of the runs. Runs that are finished there are kept, and a stopped one is continued.
    seeds
        Runs for each point, with seeds 1, 2, ...
    points
        Values of the studied parameter: paper (all), small (three or four), or some, as 50,200,400.
    settings
        KEY=VALUE: change a key of the studies' task (luxo-1997, jumper or hop) for all runs, as --set duration=3.
    report
        The page to write (Markdown), with pictures and data in a folder beside it; by default OUTPUT/studies.md, or
        studies-jumper.md, studies-hop.md.
    draw_only
        Run nothing, only write the report. It shows all finished runs, also of other points and seeds.
    workers
        Threads; by default one for each core.
    calibration
        Calibration, the twin's numbers: a file, or a name in calibration/.
    lamp
        Folder of your own lamp, as `robolamp new` makes it.
    as_json
        Print one JSON object instead of progress and prose.
    """
    if which not in (*STUDIES, _ALL):
        raise RobolampError(f"{which!r} is not one of {', '.join(STUDIES)}, {_ALL}", "study")
    if which == _ALL and points not in ("paper", "small"):
        raise RobolampError(f"{points!r}: all studies together take paper or small", "--points")
    names = [name for name, each in STUDIES.items() if each.task == TASK] if which == _ALL else [which]
    task = STUDIES[names[0]].task
    chosen = {name: chosen_points(STUDIES[name], points) for name in names}
    page = output / ("studies.md" if task == TASK else f"studies-{task}.md") if report is None else report
    if suffix_of(page) != ".md":
        raise RobolampError(f"{str(page)!r} does not end in .md", "--report")
    setup, shelf = Setup.of(lamp, calibration), Shelf(output, task)
    scale = shelf.scale() if draw_only and not settings else _scale(setup, settings or (), task)
    if scale is None:
        raise RobolampError("holds no runs of studies yet", str(output))
    every = {
        name: {point: settled(STUDIES[name], point, setup.assets, scale.settings) for point in STUDIES[name].points}
        for name in names
    }
    wanted = orders([every[name][point] for name in names for point in chosen[name]], seeds)
    if draw_only:
        shelf.check(_scale(setup, scale.settings, task))
    else:
        with shelf.alone():
            shelf.claim(scale)
            _run(wanted, shelf, setup, scale, workers, quiet=as_json)
    reporter = Reporter(shelf, scale, setup.lamp, setup.calibration, setup.assets, workers)
    made_by = _Made(which, output, report, calibration, lamp, scale, shelf)
    result = reporter.write(page, every, made_by.commands(every) or [made_by.command(which, seeds, points)])
    finished = sum(shelf.curve(order) is not None for order in wanted)
    if as_json:
        print_json(
            {
                "report": result.path,
                "pictures": result.pictures,
                "runs": len(wanted),
                "finished": finished,
                "verdicts": [vars(verdict) for verdict in result.verdicts],
            }
        )
        return 0
    _print(result, finished, len(wanted), HERE[task])
    return 0


def _scale(setup: Setup, words: Sequence[str], task: str) -> Scale:
    return Scale.of(setup.assets, setup.lamp, setup.calibration, words, task)


def _run(
    wanted: Sequence[Order], shelf: Shelf, setup: Setup, scale: Scale, workers: int | None, *, quiet: bool
) -> None:
    missing = [order for order in wanted if shelf.curve(order) is None]
    columns = (  # within 80 characters, the longest name included
        TextColumn("{task.description}"), BarColumn(9), TextColumn("{task.fields[count]}"), TextColumn("left"),
        TimeRemainingColumn(),
    )  # fmt: skip
    bar = Progress(*columns, console=Console(stderr=True, quiet=quiet), speed_estimate_period=_SPEED_OVER)
    left = {order: order.point.generations - shelf.generations(order) for order in missing}
    lanes = {order: order.point.population * order.point.cases for order in missing}
    whole = bar.add_task("all runs", total=sum(left[order] * lanes[order] for order in missing), count="")
    warned: set[str] = set()

    def warn(line: str) -> None:
        if line not in warned:
            bar.console.print(f"warning: {line}", highlight=False, markup=False)
        warned.add(line)

    done = len(wanted) - len(missing)
    with bar:
        for order in missing:
            bar.update(whole, count=f"{done} of {counted(len(wanted), 'run')}")
            total = order.point.generations
            row = bar.add_task(order.name, total=total, completed=total - left[order], count="")

            def show(entry: Generation, row: TaskID = row, lanes: int = lanes[order], total: int = total) -> None:
                best = f"{entry.generation + 1}/{total} best {entry.champion_fitness:.2f}"
                bar.update(row, completed=entry.generation + 1, count=best)
                bar.advance(whole, lanes)

            carry_out(order, shelf, scale, setup.lamp, setup.calibration, setup.assets, workers, show, warn)
            bar.remove_task(row)
            done += 1
        bar.update(whole, count=f"{done} of {counted(len(wanted), 'run')}")


@dataclass(frozen=True)
class _Made:
    """The commands that make a page, which may have been several calls, on any machine.

    Absolute folders are named by their last part.
    """

    which: str
    output: Path
    report: Path | None
    calibration: str
    lamp: Path | None
    scale: Scale
    shelf: Shelf

    def command(self, which: str, seeds: int, points: str, *, page: bool = True) -> str:
        """Return the command that makes these runs and, unless `page` is false, the page."""
        words = ["-o", _named(self.output), "--seeds", str(seeds), "--points", points]
        for setting in self.scale.settings:
            words += ["--set", setting]
        return self._joined(which, words, page=page)

    def commands(self, every: Mapping[str, Mapping[str, Point]]) -> list[str]:
        """Return the commands of all finished runs of some studies; none where no run is finished.

        Args:
            every: Of each study, by name, its points as they are run, by the value as typed.
        """
        found = [(name, seeds, points) for name in every for seeds, points in self._finished(every[name]).items()]
        if self.which != _ALL:
            return [self.command(name, seeds, _typed(name, points)) for name, seeds, points in found]
        for points in ("paper", "small"):
            whole = [chosen_points(STUDIES[name], points) for name in every]
            if [chosen for _, _, chosen in found] == whole and len({seeds for _, seeds, _ in found}) == 1:
                return [self.command(_ALL, found[0][1], points)]
        if not found:
            return []
        apart = [self.command(name, seeds, _typed(name, points), page=False) for name, seeds, points in found]
        return [*apart, self._joined(_ALL, ["-o", _named(self.output), "--draw-only"], page=True)]

    def _joined(self, which: str, words: list[str], *, page: bool) -> str:
        if self.calibration != "nominal":
            words += ["--calibration", _named(Path(self.calibration))]
        if self.lamp is not None:
            words += ["--lamp", _named(self.lamp)]
        if page and self.report is not None:
            words += ["--report", _named(self.report)]
        return shlex.join(["robolamp", "study", which, *words])

    def _finished(self, points: Mapping[str, Point]) -> dict[int, tuple[str, ...]]:
        """Return the points of finished runs by how many seeds they have."""
        groups: dict[int, tuple[str, ...]] = {}
        for name, point in points.items():
            if seeds := max(self.shelf.curves(point), default=0):
                groups[seeds] = (*groups.get(seeds, ()), name)
        return groups


def _named(path: Path) -> str:
    return path.name if path.is_absolute() else str(path)


def _typed(name: str, points: tuple[str, ...]) -> str:
    return "paper" if points == chosen_points(STUDIES[name], "paper") else ",".join(points)


def _print(result: Report, finished: int, wanted: int, here: str) -> None:
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for verdict in result.verdicts:
        console.print(f"{verdict.claim} {here[:1].upper()}{here[1:]}: {verdict.verdict}.")
    console.print(f"{finished} of {counted(wanted, 'run')} finished. Report: {result.path}")
