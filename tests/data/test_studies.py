"""The pages of studies show what the commands on them make."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from robolamp.evolve.study.plan import STUDIES, TASK, chosen_points

from .readme import ROOT

PAGES = ("docs/studies.md", "docs/emot/studies.md", "docs/emot/heads.md", "docs/emot/populations.md",
         "docs/emot/representation.md")  # fmt: skip


def made(page: str) -> tuple[set[tuple[str, str, int]], list[str]]:
    """The runs (study, point, seeds) that a page's commands make, and the pages that they write."""
    block = re.search(r"```\n((?:robolamp study .*\n)+)```", (ROOT / page).read_text(encoding="utf-8"))
    assert block, page
    runs, pages = set(), []
    for line in block[1].splitlines():
        _, _, which, *words = shlex.split(line)
        options = {words[at]: words[at + 1] for at in range(len(words) - 1) if words[at].startswith("-")}
        pages += [options["--report"]] if "--report" in options else []
        if "--draw-only" in words:
            continue
        names = [name for name, study in STUDIES.items() if study.task == TASK] if which == "all" else [which]
        for name in names:
            points = chosen_points(STUDIES[name], options["--points"])
            runs |= {(name, point, int(options["--seeds"])) for point in points}
    return runs, pages


def shown(page: str, studies: set[str]) -> set[tuple[str, str, int]]:
    """The runs of some studies that a page's tables show."""
    found: dict[tuple[str, str], int] = {}
    titles = {STUDIES[name].title: name for name in studies}
    name = ""
    for line in (ROOT / page).read_text(encoding="utf-8").splitlines():
        if heading := re.match(r"## (.+?) \(", line):
            name = titles.get(heading[1], "")
        row = re.match(r"\| (\S+) \| (\d+) \| ", line)
        if row and name and row[1] in STUDIES[name].points:
            found[name, row[1]] = max(found.get((name, row[1]), 0), int(row[2]))
    return {(*key, seeds) for key, seeds in found.items()}


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_on_a_page_make_what_it_shows(page: str) -> None:
    runs, pages = made(page)
    assert runs == shown(page, {name for name, _, _ in runs})
    assert {Path(path) for path in pages} == {Path(page)}
