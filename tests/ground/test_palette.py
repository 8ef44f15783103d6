"""One colour a role, wherever it is drawn, and to be seen on light and on dark."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import robolamp
from robolamp.palette import ROLES, css, dressed, rgb, stand_in

PACKAGE = Path(robolamp.__file__).parent
LINES, TEXT = ("lamp", "twin", "goal", "bad", "good"), ("ink", "faint")


def luminance(colour: str) -> float:
    """Relative luminance (WCAG 2.2)."""
    parts = np.frombuffer(bytes.fromhex(colour[1:]), np.uint8) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("shade", ["light", "dark"])
def test_every_role_is_seen(shade: str) -> None:
    for ground in ("card", "paper"):
        behind = getattr(ROLES[ground], shade)
        for role in (*LINES, *TEXT):
            least = 4.5 if role in TEXT else 3.0
            assert contrast(getattr(ROLES[role], shade), behind) >= least, (role, ground)
    for one, other in combinations(("lamp", "twin", "goal"), 2):
        colours = [np.frombuffer(bytes.fromhex(getattr(ROLES[role], shade)[1:]), np.uint8) for role in (one, other)]
        assert np.abs(np.subtract(*[colour.astype(int) for colour in colours])).max() > 60, (one, other)


def test_a_drawing_takes_the_colours_of_its_page() -> None:
    assert dressed(f"stroke: {stand_in('lamp')}; fill: {stand_in('ink')}") == "stroke: var(--lamp); fill: var(--ink)"
    assert len({stand_in(role) for role in ROLES}) == len(ROLES)
    for role, colour in ROLES.items():
        assert css().count(f"--{role}: {colour.light};") == css().count(f"--{role}: {colour.dark};") == 1
    assert "#{:02x}{:02x}{:02x}".format(*rgb("twin")) == ROLES["twin"].light


def test_no_other_place_has_a_colour_for_a_role() -> None:
    """Pages and plots name a role, not a colour; what is no role (the desk, the sky) may have its own."""
    sheets = [PACKAGE / "compare" / "report" / "web" / "report.css", PACKAGE / "player" / "web" / "player.css"]
    for sheet in sheets:
        assert not re.search(rf"--({'|'.join(ROLES)}):", sheet.read_text()), sheet
    scripts = [*(PACKAGE / "player" / "web").glob("*.js"), PACKAGE / "compare" / "report" / "web" / "report.js"]
    plots = [
        PACKAGE / "compare" / "folder" / "folder_report.py",
        PACKAGE / "calibrate" / "report" / "plots.py",
        PACKAGE / "compare" / "report" / "svg_plots.py",
    ]
    for source in (*scripts, *plots, PACKAGE / "evolve" / "study" / "plots.py"):
        assert not re.search(r"#[0-9a-fA-F]{6}\b", source.read_text()), source
