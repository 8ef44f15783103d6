"""Layout of `--help`: paragraphs are wrapped to the terminal, not where the source wraps them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from cyclopts.help import DefaultFormatter

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions


def joined(text: str) -> str:
    """Return a text with one line a paragraph: an empty line between them stays, a single line break does not."""
    return re.sub(r"(?<!\n)\n(?!\n) *", " ", text)


class Wrapped(DefaultFormatter):
    """Sets help as cyclopts does, after the line breaks of the docstrings are taken out."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print the panel of commands, arguments or parameters."""
        for entry in panel.entries:
            _join(entry.description)
        super().__call__(console, options, panel)

    def render_description(self, console: Console, options: ConsoleOptions, description: Any) -> None:
        """Print the text above the panels."""
        _join(description)
        super().render_description(console, options, description)


def _join(description: Any) -> None:
    text = getattr(description, "primary_renderable", description)
    if hasattr(text, "plain"):  # rich's Text
        text.plain = joined(text.plain)
