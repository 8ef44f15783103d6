"""Pictures of studies: fitness against individuals examined, and where champions end on other goals."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from robolamp.evolve.study.claims import ARRIVES
from robolamp.evolve.study.plan import Study
from robolamp.evolve.study.study_runs import Curve
from robolamp.evolve.study.unseen_goals import WITHIN, Tried
from robolamp.palette import ROLES

_STYLE: dict[Any, Any] = {
    "font.size": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "axes.axisbelow": True,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
}
_SIZE, _DPI = (12.0, 5.2), 100  # 1200 x 520 pixels
_GOOD = 0.5  # "raw fitness values below 0.5 tended to correspond to good-looking motion" (section 4)
_ODD = ROLES["bad"].light  # for the one point that is of another kind
_FAR = 20  # runs that are so many times as long as others would press those against the edge
_LAST = 0.88  # viridis beyond it is too pale on white


def curves_picture(study: Study, found: Mapping[str, Mapping[int, Curve]]) -> bytes:
    """Return a PNG, 1200 pixels wide: best fitness against individuals, as run and again at phase 1.

    A line is the mean over seeds, the band their smallest and largest.

    Args:
        study: The study.
        found: Finished runs by point and seed.
    """
    with rc_context(_STYLE):
        figure, axes = _figure(f"{study.title} ({'' if study.equal_steps else 'redraws '}{study.source})", found)
        colours = _colours([name for name in found if found[name]])
        tops: list[float] = []
        spans: list[tuple[float, float]] = []
        for panel, attribute, title in ((axes[0], "as_run", "as run"), (axes[1], "whole", "again at phase 1")):
            for name, colour in colours.items():
                runs = list(found[name].values())
                individuals = runs[0].physics_steps / 1e6 if study.equal_steps else runs[0].individuals
                values = np.stack([getattr(curve, attribute) for curve in runs])
                _band(panel, individuals, values, colour, name)
                tops.append(values.max())
                spans.append((individuals[0], individuals[-1]))
            _fitness_axes(panel, title, "physics steps [M]" if study.equal_steps else "individuals examined")
        # A run that nothing can be made of is scored with a huge number: it must not flatten the others.
        for panel in axes:
            panel.set_ylim(0.0, 1.05 * max(min(max(tops, default=1.0), 3.0), _GOOD))
            firsts, lasts = zip(*spans, strict=True) if spans else ((0.0,), (0.0,))
            if max(lasts) > _FAR * min(lasts):
                panel.set_xscale("log")
                panel.set_xlim(min(firsts), 1.2 * max(lasts))
        axes[0].set_ylabel("fitness of the best of the generation")
        handles, labels = axes[1].get_legend_handles_labels()
        _legend(figure, study, handles, labels)
        return _png(figure)


def goals_picture(study: Study, found: Mapping[str, Sequence[Tried]]) -> bytes:
    """Return a PNG, 1200 pixels wide: distance left at the end, and the share of seeds that arrive, against the goal.

    Args:
        study: The study.
        found: What the champions did, by point; one entry a seed.
    """
    with rc_context(_STYLE):
        figure, (left, right) = _figure(f"{study.title} (1997, {study.source})", found)
        for name, colour in _colours([name for name in found if found[name]]).items():
            tries = found[name]
            goals = tries[0].goal * 100
            missed = np.stack([np.abs(each.error) / each.goal for each in tries])
            _band(left, goals, np.minimum(missed, 2.0), colour, name)
            right.plot(goals, np.mean([each.arrives for each in tries], axis=0), color=colour, label=name)
        left.axhline(ARRIVES, color="0.4", linewidth=1.0, linestyle="--")
        left.set_title("distance left at the end / goal (cut off at 2)", fontsize=11)
        left.set_ylim(0.0, None)
        right.set_title("share of seeds that arrive", fontsize=11)
        right.set_ylim(-0.03, 1.03)
        for panel in (left, right):
            panel.axvspan(WITHIN[0] * 100, WITHIN[-1] * 100, color="0.5", alpha=0.08, linewidth=0)
            panel.set_xlim(0, None)
            panel.set_xlabel("goal [cm]; shaded: what robust controllers are evolved on")
        handles, labels = right.get_legend_handles_labels()
        _legend(figure, study, handles, labels)
        return _png(figure)


def _figure(title: str, found: Mapping[str, Sequence[Any] | Mapping[int, Any]]) -> tuple[Figure, Sequence[Axes]]:
    counts = sorted({len(runs) for runs in found.values() if runs})
    seeds = " to ".join(str(count) for count in dict.fromkeys((counts[0], counts[-1])))
    figure = Figure(figsize=_SIZE, dpi=_DPI)
    figure.subplots_adjust(0.065, 0.12, 0.865, 0.85, wspace=0.12)
    figure.suptitle(title, x=0.065, ha="left", fontsize=13)
    figure.text(0.875, 0.12, f"seeds: {seeds}\nline: mean\nband: smallest\nto largest", color="0.35", fontsize=10)
    return figure, list(figure.subplots(1, 2))


def _legend(figure: Figure, study: Study, handles: Sequence[Any], labels: Sequence[str]) -> None:
    where = {"loc": "center left", "bbox_to_anchor": (0.87, 0.5)}
    figure.legend(handles, labels, title=study.axis, fontsize=10, **where)


def _colours(names: Sequence[str]) -> dict[str, Any]:
    """Dark to light along the axis; a point that is no number among numbers stands apart."""
    numbers = [name for name in names if name.isdigit()]
    if not numbers:
        return dict(zip(names, (colormaps["viridis"](x) for x in np.linspace(0.15, 0.7, len(names))), strict=True))
    shades = dict(zip(numbers, np.linspace(0.0, _LAST, len(numbers)), strict=True))
    return {name: colormaps["viridis"](shades[name]) if name in shades else _ODD for name in names}


def _band(axes: Axes, x: NDArray[Any], values: NDArray[np.float64], colour: Any, label: str) -> None:
    axes.fill_between(x, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.13, linewidth=0)
    mean = values.mean(axis=0)
    axes.plot(x, mean, color=colour, label=label)
    axes.plot(x[-1:], mean[-1:], "o", color=colour, markersize=4)


def _fitness_axes(axes: Axes, title: str, label: str) -> None:
    axes.set_title(title, fontsize=11)
    axes.set_xlabel(label)
    axes.axhline(_GOOD, color="0.4", linewidth=1.0, linestyle="--")
    axes.set_xlim(0, None)


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()
