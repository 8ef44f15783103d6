"""Plots as SVG with the colours of their page: readable on light and on dark."""

from __future__ import annotations

import io
import re
from typing import Any

from matplotlib.figure import Figure

from robolamp.palette import dressed, stand_in

TWIN, LAMP, GOAL, INK, FAINT = map(stand_in, ("twin", "lamp", "goal", "ink", "faint"))
"""Stand-ins, replaced by the page's own colours."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "robolamp", "font.family": "sans-serif", "font.size": 9.5,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": FAINT, "axes.labelcolor": INK,
    "text.color": INK, "xtick.color": FAINT, "ytick.color": FAINT, "xtick.labelcolor": INK, "ytick.labelcolor": INK,
    "grid.color": FAINT, "grid.alpha": 0.18, "grid.linewidth": 0.6, "axes.grid": True, "axes.axisbelow": True,
    "lines.linewidth": 1.3,
}  # fmt: skip
"""For matplotlib's `rc_context`."""


def svg(figure: Figure, title: str) -> str:
    """Return a figure drawn in STYLE as an SVG element of a page.

    Args:
        figure: The plot.
        title: What it shows, for who cannot see it.
    """
    stream = io.StringIO()
    figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None, "Title": title, "Creator": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r' width="[\d.]+pt"| height="[\d.]+pt"', "", text, count=2)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    return dressed(text).replace("<svg", f'<svg role="img" aria-label="{title}"', 1)
