"""Every table of controllers says of each whether it is evolved, tuned or by hand, as the controller's file does."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from robolamp.controller.controller_file import BY_HAND, ORIGINS

from .readme import ROOT

COLUMN = " / ".join(ORIGINS)
FILES = {path.stem: path for path in sorted((ROOT / "sim").glob("*/controllers/*.toml"))}
PAGES = sorted(
    page
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "sim").rglob("*.md")]
    if page.parent.name != "tasks"  # tasks are named like controllers
)
LISTS = {
    "lamp": ROOT / "sim/lamp/controllers/README.md",
    "jumper": ROOT / "sim/jumper/README.md",
    "spider": ROOT / "sim/spider/README.md",
}


def origin(name: str) -> str:
    return tomllib.loads(FILES[name].read_text(encoding="utf-8"))["origin"]


def named(cell: str) -> list[str]:
    """The shipped controllers that a cell lists and nothing else; none where it says something else."""
    names = [re.sub(r"^(.*/)?(.+?)(\.toml)?$", r"\2", word) for word in re.findall(r"`([^`]+)`", cell)]
    rest = re.sub(r"`[^`]+`|[,\s]", "", cell)
    return names if names and not rest and set(names) <= set(FILES) else []


def told(page: Path) -> list[tuple[str, str]]:
    """What a page's tables of controllers say: (name, word), the word empty where a table has no such column."""
    found, header = [], []
    for line in page.read_text(encoding="utf-8").splitlines():
        if not line.startswith("|"):
            header = []
            continue
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not header:
            header = cells
        word = cells[header.index(COLUMN)] if COLUMN in header else ""
        found += [(name, word) for cell in cells for name in named(cell)]
    return found


@pytest.mark.parametrize("name", FILES)
def test_a_shipped_controller_says_how_it_was_made(name: str) -> None:
    held = tomllib.loads(FILES[name].read_text(encoding="utf-8"))
    assert held["origin"] in ORIGINS
    if not held.get("provenance") and name != "jumper-anywhere":  # whose search is no command
        assert held["origin"] == BY_HAND


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_of_controllers_say_what_the_files_say(page: Path) -> None:
    for name, word in told(page):
        assert word == origin(name), name


@pytest.mark.parametrize("figure", LISTS)
def test_every_shipped_controller_is_listed(figure: str) -> None:
    own = {path.stem for path in FILES.values() if path.parts[-3] == figure}
    assert own
    assert {name for name, _ in told(LISTS[figure])} == own
