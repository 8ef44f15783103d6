"""One colour a role, on light and on dark: in reports, plots, pictures and the player."""

from __future__ import annotations

from typing import NamedTuple


class Colour(NamedTuple):
    """A colour as "#rrggbb".

    Attributes:
        light: On a light page, and in pictures.
        dark: On a dark page.
    """

    light: str
    dark: str


# Chosen: what lamp and twin did is orange and blue, which those who see no red or green tell apart, too; a line has a
# contrast of 3 to 1 with what it is drawn on, text and ticks one of 4.5 to 1 (WCAG 2.2, criteria 1.4.11 and 1.4.3).
ROLES = {
    "lamp": Colour("#c05a0a", "#f0954a"),
    "twin": Colour("#1f6fb5", "#6cb2f2"),
    "goal": Colour("#7a3fa8", "#c39af0"),
    "bad": Colour("#b3372d", "#ea7a6c"),
    "good": Colour("#2c7a4b", "#63b583"),
    "open": Colour("#8a6100", "#d9a93f"),
    "ink": Colour("#1d2126", "#e6e8ea"),
    "faint": Colour("#5f6872", "#9ea7b0"),
    "line": Colour("#e2e4e7", "#31373d"),
    "paper": Colour("#fbfbfa", "#15181b"),
    "card": Colour("#ffffff", "#1c2024"),
}
"""lamp: what the lamp did, measured or true. twin: what its replay did, or what was simulated. goal: what was asked.
bad: outside, failed, a warning. open: nobody can say. The others are those of the page: text, ticks, rules, ground."""


def css() -> str:
    """Return the roles as custom properties of a page, "--lamp" and its like."""
    light, dark = (
        " ".join(f"--{role}: {getattr(colour, shade)};" for role, colour in ROLES.items()) for shade in Colour._fields
    )
    return (
        f":root {{ color-scheme: light dark; {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
    )


def stand_in(role: str) -> str:
    """Return a colour for a plot that `dressed` puts the page's own in the place of."""
    return f"#01{list(ROLES).index(role):02x}03"


def dressed(drawing: str) -> str:
    """Return an SVG drawing with the page's colours in the place of their stand-ins.

    Args:
        drawing: As matplotlib wrote it.
    """
    for role in ROLES:
        drawing = drawing.replace(stand_in(role), f"var(--{role})")
    return drawing


def rgb(role: str) -> tuple[int, int, int]:
    """Return a role's light colour for a picture, 0 to 255."""
    red, green, blue = bytes.fromhex(ROLES[role].light[1:])
    return red, green, blue
