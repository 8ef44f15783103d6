"""What the tests read out of the READMEs: their tables."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("sim", "calibration", "hardware")


def table(readme: str, *header: str) -> list[list[str]]:
    """Return the rows of the first Markdown table whose header begins with these cells, without back-quotes.

    Args:
        readme: The README's path in the checkout.
        header: The first cells of the header.
    """
    rows: list[list[str]] | None = None
    for line in (ROOT / readme).read_text(encoding="utf-8").splitlines():
        if not line.startswith("|"):
            if rows:
                return rows
            rows = None
            continue
        cells = [cell.strip().replace("`", "") for cell in line.strip().strip("|").split("|")]
        if rows is not None:
            if set(cells[0]) - set("-: "):
                rows.append(cells)
        elif tuple(cells[: len(header)]) == header:
            rows = []
    assert rows, f"{readme} has no table that begins with {header}"
    return rows


def text(readme: str) -> str:
    """Return a README's text."""
    return (ROOT / readme).read_text(encoding="utf-8")


def files() -> list[Path]:
    """Return every file of the data folders that is shipped, as paths in the checkout."""
    found = [path.relative_to(ROOT) for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
    return sorted(path for path in found if not any(part.startswith((".", "__")) for part in path.parts))
