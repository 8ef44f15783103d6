"""Every data file is named in a README, and what a README links to is there."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from .readme import FOLDERS, ROOT, files, table, text

READMES = sorted(str(path.relative_to(ROOT)) for folder in FOLDERS for path in (ROOT / folder).rglob("README.md"))
PAGES = [
    *READMES,
    "README.md",
    "CONTRIBUTING.md",
    *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")),
]


@pytest.mark.parametrize("path", [path for path in files() if path.name != "README.md"], ids=str)
def test_file_is_named_in_a_readme(path: Path) -> None:
    above = [folder for folder in path.parents if (ROOT / folder / "README.md").is_file() and folder != Path()]
    assert above, f"no README above {path}"
    names = {str(path.relative_to(folder)): text(f"{folder}/README.md") for folder in above[:2]}
    assert any(re.search(rf"(?<![\w./]){re.escape(name)}(?![\w/])", page) for name, page in names.items())


def test_every_script_has_a_row_in_its_readme() -> None:
    for folder in ("benchmarks", "examples"):
        scripts = {path.name for path in (ROOT / folder).glob("*.py") if not path.name.startswith("_")}
        assert {row[0] for row in table(f"{folder}/README.md", "script")} == scripts


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    links = re.findall(r"\]\((?!https://)([^)\s]+)\)", text(page))
    for link in links:
        target, _, anchor = link.partition("#")
        path = (ROOT / page).parent / target if target else ROOT / page
        assert path.exists(), f"{page} links to {link}"
        if anchor:
            headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_folder_of_data_has_a_way_down_to_its_readmes(folder: str) -> None:
    for readme in (ROOT / folder).rglob("README.md"):
        if readme.parent == ROOT / folder:
            continue
        name = readme.parent.name
        above = [parent / "README.md" for parent in readme.parents[1:] if (parent / "README.md").is_file()]
        assert f"{name}/README.md" in above[0].read_text(encoding="utf-8"), f"{above[0]} does not lead to {readme}"


@pytest.mark.parametrize("drawing", [path for path in files() if path.suffix == ".svg"], ids=str)
def test_drawing_is_well_formed_and_self_contained(drawing: Path) -> None:
    root = ElementTree.parse(ROOT / drawing).getroot()
    assert root.tag.endswith("svg")
    assert root.find("{http://www.w3.org/2000/svg}title") is not None
    assert "href" not in (ROOT / drawing).read_text(encoding="utf-8")
