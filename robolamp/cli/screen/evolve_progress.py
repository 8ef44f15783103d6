"""What `robolamp evolve` shows while it works: a live table on a terminal, a line a generation elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

from robolamp.evolve.progress import Generation

_ROWS = 12  # of the table
_COLUMNS = {  # and their widths: with a space between them they fit into 80 characters
    "stage": 9,
    "generation": 10,
    "best": 8,
    "champion": 8,
    "hits": 7,
    "falls": 5,
    "flight": 6,
    "nodes": 5,
    "physics": 7,
    "saved": 5,
}
_KEY = """\
Fitness: lower is better, 0 is perfect. best: of the generation; champion: of
the run so far, at full style. physics: share of the time that it takes; saved:
trials that needed no simulation."""
_HUGE = 1e4  # fitness from which on the places behind the point say nothing


def _row(entry: Generation) -> tuple[str, ...]:
    trials = entry.tried + entry.cached + entry.inherited + entry.stopped
    return (
        entry.stage,
        str(entry.generation),
        _fitness(entry.best_fitness),
        _fitness(entry.champion_fitness),
        f"{entry.hits}/{entry.cases}",
        str(entry.falls),
        f"{entry.flight_share:.2f}",
        str(entry.nodes),
        f"{entry.physics_s / max(entry.wall_s, 1e-9):.0%}",
        f"{(trials - entry.tried) / max(trials, 1):.0%}",
    )


def _fitness(value: float) -> str:
    return f"{value:.3f}" if abs(value) < _HUGE else f"{value:.1e}"


def _line(cells: Sequence[str]) -> str:
    first, *others = zip(cells, _COLUMNS.values(), strict=True)
    return " ".join([f"{first[0]:<{first[1]}}", *(f"{cell:>{width}}" for cell, width in others)])


class Board:
    """The table.

    Args:
        console: Where to; a quiet one shows nothing.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._entries: list[Generation] = []
        columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
        self._progress = Progress(*columns, console=console)
        self._live: Live | None = None
        self._told = False

    def begin(self, generations: int, tuning: int, history: Sequence[Generation] = ()) -> None:
        """Say how long the run will be, and what it has done already.

        Args:
            generations: Generations of the run.
            tuning: Iterations of tuning after them.
            history: What was done before a run that is resumed.
        """
        self._entries = list(history)
        self._bar = self._progress.add_task("", total=generations + tuning, completed=len(history))

    def __enter__(self) -> Self:
        if self._console.is_terminal and not self._console.quiet:
            self._live = Live(console=self._console, get_renderable=self._drawn, refresh_per_second=4)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, entry: Generation) -> None:
        """Add a generation."""
        if self._live is None:
            if not self._told:
                self._console.print(f"{_KEY}\n{_line(tuple(_COLUMNS))}", markup=False, soft_wrap=True)
            self._told = True
            self._console.print(_line(_row(entry)), markup=False, soft_wrap=True)
        self._entries.append(entry)
        self._progress.advance(self._bar)

    def _drawn(self) -> Group:
        rows = "\n".join(_line(_row(entry)) for entry in self._entries[-_ROWS:])
        return Group(Text(_KEY, style="dim"), Text(_line(tuple(_COLUMNS)), style="bold"), Text(rows), self._progress)
