"""What `--help` looks like: it fits the terminal, and breaks lines where the terminal does, not the source."""

from __future__ import annotations

import io
from collections.abc import Iterator

import pytest
from cyclopts import App
from rich.console import Console

from robolamp.cli.main import app
from robolamp.cli.screen.help import joined


def verbs(of: App = app, chain: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every verb, and the verbs below it."""
    yield chain
    for name in of:
        if not name.startswith("-"):
            yield from verbs(of[name], (*chain, name))


def told(verb: tuple[str, ...], width: int) -> list[str]:
    page = io.StringIO()
    app.help_print(verb, console=Console(file=page, width=width))
    return page.getvalue().splitlines()


@pytest.mark.parametrize("verb", list(verbs()), ids=" ".join)
def test_help_is_wrapped_to_the_terminal(verb: tuple[str, ...]) -> None:
    assert max(len(line) for line in told(verb, 80)) <= 80
    wide = told(verb, 4000)  # as no text is: what breaks here is broken by the source
    assert not [line for line in wide if line.startswith("│" + 8 * " ")]
    above = [line.rstrip() for line in wide if line and line[0] not in "│╭╰"]
    assert all(line.endswith(".") for line in above[1:]), "a paragraph is broken"


def test_paragraphs_stay_apart() -> None:
    assert joined("one\n  line\n\nanother\none") == "one line\n\nanother one"
