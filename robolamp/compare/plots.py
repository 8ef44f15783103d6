"""The report's plots, as SVG that takes its ink from the page: readable on light and on dark."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from robolamp.compare.comparison import Comparison

Array = NDArray[np.float64]

TWIN, LAMP = "#3a86c8", "#e0782a"
"""Colours of the two; the page's legend uses the same."""
_INK, _FAINT = "#010203", "#010204"  # stand-ins, replaced by the page's own ink
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "robolamp",
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": _FAINT,
    "axes.labelcolor": _INK,
    "text.color": _INK,
    "xtick.color": _FAINT,
    "ytick.color": _FAINT,
    "xtick.labelcolor": _INK,
    "ytick.labelcolor": _INK,
    "grid.color": _FAINT,
    "grid.alpha": 0.18,
    "grid.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
}
_WIDTH = 9.4
_MOST_POINTS = 3000


def joint_plot(comparison: Comparison, index: int) -> str:
    """Return one joint's angles, twin over lamp, with the residual below.

    Args:
        comparison: What to draw.
        index: Which joint.
    """
    run, replay, error = comparison.run, comparison.replay, comparison.joints[index]
    shift = error.lag if np.isfinite(error.lag) else 0.0
    seen = run.sampled_at[:, index]
    residual = run.angle[:, index] - np.interp(seen - shift, replay.time, replay.angle[:, index])
    with rc_context(_STYLE):
        figure = _figure(3.3)
        top, bottom = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [3, 1.15]})
        _phases(comparison, top, bottom)
        _line(top, _clock(comparison, run.write_done), run.goal[:, index], color=_FAINT, linewidth=0.8, alpha=0.6)
        _line(top, _clock(comparison, replay.time), replay.angle[:, index], color=TWIN)
        _line(top, _clock(comparison, seen), run.angle[:, index], color=LAMP, linewidth=1.2)
        top.set_ylabel("angle [rad]")
        bottom.axhline(0.0, color=_FAINT, linewidth=0.7, alpha=0.6)
        allowed = comparison.tolerances.joint_mae * 1e3
        bottom.axhspan(-allowed, allowed, color=TWIN, alpha=0.10, linewidth=0)
        _line(bottom, _clock(comparison, seen), residual * 1e3, color=LAMP, linewidth=1.0)
        bottom.set_ylabel("off [mrad]")
        bottom.set_xlabel("time [s]")
        figure.align_ylabels()
        return _svg(figure, f"{error.name}: angle of lamp and twin over time, and their difference")


def force_plot(comparison: Comparison) -> str:
    """Return the foot force of lamp and twin."""
    run, replay = comparison.run, comparison.replay
    with rc_context(_STYLE):
        figure = _figure(2.2)
        axes = figure.subplots()
        _phases(comparison, axes)
        time = np.array([tick.observation.time for tick in replay.ticks])
        force = np.array([tick.observation.foot_force for tick in replay.ticks])
        _line(axes, _clock(comparison, time), force, color=TWIN)
        _line(axes, _clock(comparison, run.measured_at), run.foot_force, color=LAMP, linewidth=1.2)
        axes.set_ylabel("foot force [N]")
        axes.set_xlabel("time [s]")
        return _svg(figure, "Foot force of lamp and twin over time")


def travel_plot(comparison: Comparison) -> str:
    """Return the base's way along the floor, twin's and, where the truth is known, lamp's."""
    run, replay, truth = comparison.run, comparison.replay, comparison.truth
    with rc_context(_STYLE):
        figure = _figure(2.2)
        axes = figure.subplots()
        _phases(comparison, axes)
        if np.isfinite(run.goal_m):
            axes.axhline(run.goal_m * 1e2, color=_FAINT, linewidth=0.9, linestyle=(0, (4, 3)))
            axes.annotate("goal", (1.0, run.goal_m * 1e2), xycoords=("axes fraction", "data"), ha="right", va="bottom")
        _line(axes, _clock(comparison, replay.time), (replay.base_x - replay.base_x[0]) * 1e2, color=TWIN)
        if truth is not None:
            time = run.at(truth.log_time)
            during = (time >= run.began[0]) & (time <= run.write_done[-1])
            start = np.interp(run.began[0], time, truth.base_x)
            _line(axes, _clock(comparison, time[during]), (truth.base_x[during] - start) * 1e2, color=LAMP)
        axes.set_ylabel("base travel [cm]")
        axes.set_xlabel("time [s]")
        return _svg(figure, "Travel of the base over time")


def period_plot(comparison: Comparison) -> str:
    """Return the histogram of the time between ticks."""
    run = comparison.run
    periods = np.diff(run.began) * 1e3
    target = run.control_period * 1e3
    reach = max(float(np.max(np.abs(periods - target), initial=0.0)) * 1.1, 0.05 * target)
    with rc_context(_STYLE):
        figure = _figure(1.9)
        axes = figure.subplots()
        axes.hist(periods, bins=np.linspace(target - reach, target + reach, 81).tolist(), color=LAMP, alpha=0.9)
        axes.axvline(target, color=_FAINT, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_ylim(bottom=0)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_ylabel("ticks")
        axes.set_xlabel("time from tick to tick [ms]")
        return _svg(figure, "Histogram of the time from tick to tick")


def _figure(height: float) -> Figure:
    """Margins in inches, so that every plot's time axis lies under the others' (and no solver is needed)."""
    figure = Figure(figsize=(_WIDTH, height))
    figure.subplots_adjust(0.68 / _WIDTH, 0.46 / height, 1 - 0.12 / _WIDTH, 1 - 0.12 / height, hspace=0.1)
    return figure


def _clock(comparison: Comparison, time: Array) -> Array:
    return time - comparison.run.scheduled[0]


def _line(axes: Axes, x: Array, y: Array, **style: object) -> None:
    stride = max(1, x.size // _MOST_POINTS)
    axes.plot(x[::stride], y[::stride], **style)  # pyright: ignore[reportArgumentType] (line properties by name)


def _phases(comparison: Comparison, *all_axes: Axes) -> None:
    run = comparison.run
    running = np.flatnonzero(run.phase == "run")
    begin, end = _clock(comparison, run.scheduled)[[0, -1]]
    for axes in all_axes:
        axes.set_xlim(begin, end)
        if running.size:
            first, last = _clock(comparison, run.scheduled)[[running[0], running[-1]]]
            for low, high in ((begin, first), (last, end)):
                axes.axvspan(low, high, color=_FAINT, alpha=0.06, linewidth=0)


def _svg(figure: Figure, title: str) -> str:
    stream = io.StringIO()
    figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None, "Title": title, "Creator": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r' width="[\d.]+pt" height="[\d.]+pt"| height="[\d.]+pt"| width="[\d.]+pt"', "", text, count=2)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = text.replace(_INK, "var(--ink)").replace(_FAINT, "var(--faint)")
    return text.replace("<svg", f'<svg role="img" aria-label="{title}"', 1)
