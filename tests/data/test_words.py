"""Docs and `--help` say one thing by one word: that of docs/glossary.md."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from robolamp.cli.main import app

from .readme import ROOT, text

OTHERS = {
    r"real lamps?": "physical lamp",
    r"held[- ]out|unseen": "left out",
    r"backlash": "play",
    r"(share|part) of the travel in flight": "flight share",
    r"goals? (that (it|the lamp) was|as they were|as) sent": "goal angle",
    r"clock of the wall": "the computer's clock",
    r"simulation's|a simulation\b": "twin",
}
"""Words that stood for the same thing, and the glossary's."""

PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    *sorted(
        str(path.relative_to(ROOT))
        for folder in ("docs", "hardware", "sim", "calibration", "benchmarks", "examples")
        for path in (ROOT / folder).rglob("*.md")
    ),
]
TERM = re.compile(r"^\| \*\*(.+?)\*\*", re.MULTILINE)


def prose(markdown: str) -> str:
    """A page without code, on one line."""
    return " ".join(re.sub(r"```.*?```|`[^`\n]*`", " ", markdown, flags=re.DOTALL).split())


def helps() -> dict[str, str]:
    """What `--help` prints, by verb."""
    found = {}
    for verb in app:
        if verb.startswith("-"):
            continue
        for chain in ((verb,), *((verb, below) for below in app[verb] if not below.startswith("-"))):
            page = io.StringIO()
            app.help_print(chain, console=Console(file=page, width=4000))
            found[" ".join(chain)] = " ".join(page.getvalue().split())
    return found


@pytest.mark.parametrize("page", PAGES)
def test_a_page_keeps_to_the_glossary(page: str) -> None:
    for words, term in OTHERS.items():
        found = re.search(rf"\b({words})\b", prose(text(page)), re.IGNORECASE)
        assert not found, f"{found[0]!r}: {term}"


def test_help_keeps_to_the_glossary() -> None:
    for verb, said in helps().items():
        for words, term in OTHERS.items():
            found = re.search(rf"\b({words})\b", re.sub(r"knob:backlash:7", "", said), re.IGNORECASE)
            assert not found, f"{verb}: {found[0]!r}: {term}"


def test_the_glossary_is_in_the_order_of_the_alphabet() -> None:
    terms = TERM.findall(text("docs/glossary.md"))
    assert terms == sorted(terms)


@pytest.mark.parametrize(
    "page", ["README.md", "docs/compare.md", "docs/emulator.md", "docs/evolution.md", "docs/logs.md"]
)
def test_a_page_leads_to_the_glossary(page: str) -> None:
    assert "glossary.md)" in text(page)
