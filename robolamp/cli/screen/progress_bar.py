"""A bar with the time that is left, for verbs that take a while."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from robolamp.errors import on_one_line


@contextlib.contextmanager
def bar(words: str, *, quiet: bool) -> Iterator[Callable[[float], None]]:
    """Show a bar on stderr while the block runs.

    Args:
        words: What goes on.
        quiet: Show nothing; nor is anything shown where stderr is no terminal.

    Yields:
        What is called with the share that is done, 0 to 1.
    """
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("left"),
        TimeRemainingColumn(),
    )  # fmt: skip
    shown = console.is_terminal and not quiet
    with Progress(
        *columns, console=console, transient=True, disable=not shown, redirect_stdout=sys.stdout.isatty()
    ) as progress:
        task = progress.add_task(words, total=1.0)
        yield lambda share: progress.update(task, completed=min(share, 1.0))


def note(text: str) -> None:
    """Print on stderr what was left out or filled in: stdout is for the answer."""
    print(f"robolamp: {on_one_line(text)}", file=sys.stderr, flush=True)
