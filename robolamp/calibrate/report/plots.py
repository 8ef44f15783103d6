"""The calibration report's plots, as SVG that takes its ink from the page: readable on light and on dark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from robolamp.compare.report.svg_plots import FAINT, GOAL, INK, LAMP, STYLE, TWIN, svg

Array = NDArray[np.float64]

_WIDTH, _PANEL, _RESIDUAL = 9.4, 1.05, 0.95  # [inch]
_SHADES = (1.0, 0.65, 0.4)
_MOST_POINTS = 1200


@dataclass(frozen=True)
class Track:
    """One joint (or servo) in one recording, N samples.

    Attributes:
        label: The joint's name.
        time: Since the recording's first sample, shape (N,) [s].
        goal: Shape (N,) [rad].
        measured: Shape (N,) [rad].
        simulated: Shape (N,) [rad].
    """

    label: str
    time: Array
    goal: Array
    measured: Array
    simulated: Array

    @property
    def mae(self) -> float:
        """Mean absolute error [rad]."""
        return float(np.nanmean(np.abs(self.simulated - self.measured)))


def overlay(tracks: Sequence[Track], title: str) -> str:
    """Return measured and simulated angles of a recording's joints, and what is left between them.

    Args:
        tracks: The joints.
        title: Of the plot, for screen readers.
    """
    height = _PANEL * len(tracks) + _RESIDUAL + 0.55
    with rc_context(STYLE):
        figure = Figure(figsize=(_WIDTH, height))
        figure.subplots_adjust(0.98 / _WIDTH, 0.46 / height, 1 - 0.12 / _WIDTH, 1 - 0.10 / height, hspace=0.12)
        ratios = [*[_PANEL] * len(tracks), _RESIDUAL]
        axes = figure.subplots(len(tracks) + 1, 1, sharex=True, gridspec_kw={"height_ratios": ratios})
        for track, axis in zip(tracks, axes[:-1], strict=True):
            _line(axis, track.time, track.goal, color=GOAL, linewidth=0.9, linestyle=(0, (4, 3)))
            _line(axis, track.time, track.simulated, color=TWIN)
            _line(axis, track.time, track.measured, color=LAMP, linewidth=1.1)
            axis.set_ylabel(f"{track.label}\n[rad]")
        last = axes[-1]
        last.axhline(0.0, color=FAINT, linewidth=0.7, alpha=0.6)
        for track, shade in zip(tracks, np.resize(_SHADES, len(tracks)), strict=True):
            left = (track.simulated - track.measured) * 1e3
            _line(last, track.time, left, color=INK, linewidth=0.9, alpha=float(shade), label=track.label)
        if len(tracks) > 1:
            last.legend(loc="upper right", ncols=len(tracks), fontsize=7.5, frameon=False, borderaxespad=0.1)
        last.set_ylabel("residual\n[mrad]")
        last.set_xlabel("time [s]")
        last.set_xlim(float(tracks[0].time[0]), float(tracks[0].time[-1]))
        figure.align_ylabels()
        return svg(figure, title)


def ladder(rungs: Sequence[tuple[str, float, float, bool]]) -> str:
    """Return the errors of each rung of a model ladder, fitted and held out.

    Args:
        rungs: Name, error on recordings fitted to, error on recordings left out [rad], whether it was kept.
    """
    with rc_context(STYLE):
        height = 0.38 * len(rungs) + 0.75
        figure = Figure(figsize=(_WIDTH, height))
        figure.subplots_adjust(2.4 / _WIDTH, 0.46 / height, 1 - 0.3 / _WIDTH, 1 - 0.10 / height)
        axes = figure.subplots()
        rows = np.arange(len(rungs))[::-1]
        axes.barh(rows, [left_out * 1e3 for _, _, left_out, _ in rungs], height=0.62, color=TWIN, alpha=0.85)
        axes.plot([fitted * 1e3 for _, fitted, _, _ in rungs], rows, "|", color=INK, markersize=11, markeredgewidth=1.6)
        axes.set_yticks(rows, [name if kept else f"({name})" for name, _, _, kept in rungs])
        for row, (_, fitted, left_out, _) in zip(rows, rungs, strict=True):
            shown = left_out if np.isfinite(left_out) else fitted  # with too few recordings none is left out
            axes.annotate(f"{shown * 1e3:.1f}", (shown * 1e3, row), (4, 0), textcoords="offset points", va="center")
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("mean absolute error [mrad]: bar left out, tick fitted to")
        return svg(figure, "Errors of each rung of the model ladder")


def _line(axes: Axes, x: Array, y: Array, **style: object) -> None:
    stride = max(1, x.size // _MOST_POINTS)
    axes.plot(x[::stride], y[::stride], **style)  # pyright: ignore[reportArgumentType] (line properties by name)
