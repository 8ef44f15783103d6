"""What `robolamp evolve` shows while it works: a live table on a terminal, a line a generation elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from robolamp.evolve.progress import Generation

_ROWS = 12  # of the table
_COLUMNS = (
    "stage",
    "generation",
    "best",
    "at full style",
    "hits",
    "falls",
    "flight",
    "nodes",
    "physics",
    "not simulated",
)


def _row(entry: Generation) -> tuple[str, ...]:
    trials = entry.tried + entry.cached + entry.inherited + entry.stopped
    saved = f"{(trials - entry.tried) / max(trials, 1):.0%}"
    return (
        entry.stage,
        str(entry.generation),
        f"{entry.best_fitness:.3f}",
        f"{entry.champion_fitness:.3f}",
        f"{entry.hits}/{entry.cases}",
        str(entry.falls),
        f"{entry.flight_share:.2f}",
        str(entry.nodes),
        f"{entry.physics_s / max(entry.wall_s, 1e-9):.0%}",
        f"{saved} ({entry.cached:,} cached, {entry.inherited:,} inherited, {entry.stopped:,} stopped)",
    )


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
                self._console.print("  ".join(_COLUMNS), soft_wrap=True)
            self._told = True
            self._console.print("  ".join(_row(entry)), markup=False, soft_wrap=True)
        self._entries.append(entry)
        self._progress.advance(self._bar)

    def _drawn(self) -> Group:
        table = Table(box=None, pad_edge=False)
        for name in _COLUMNS:
            table.add_column(name, justify="left" if name in ("stage", "not simulated") else "right")
        for entry in self._entries[-_ROWS:]:
            table.add_row(*_row(entry))
        return Group(table, self._progress)
