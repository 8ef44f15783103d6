"""The page: scene, motions and traces of a run in one HTML file that needs nothing else, not even a server."""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.palette import css
from robolamp.player.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Where a lamp's parts were.

    Attributes:
        name: As the page shows it: "lamp", "twin".
        poses: At the page's frames (`scene.poses_of`), shape (k, bodies, 7).
        ghost: Whether it is drawn see-through, over the other.
    """

    name: str
    poses: NDArray[np.float32]
    ghost: bool = False


@dataclass(frozen=True)
class Series:
    """One line of a chart.

    Attributes:
        name: As the legend shows it: "goal", "lamp", "twin"; it also gives the colour.
        time: Shape (m,) [s].
        values: Shape (m,), in the chart's unit; NaN is a gap.
    """

    name: str
    time: Array
    values: Array


@dataclass(frozen=True)
class Chart:
    """A trace beside the lamp.

    Attributes:
        title: What it shows.
        unit: Its unit.
        series: The lines.
    """

    title: str
    unit: str
    series: Sequence[Series]


@dataclass(frozen=True)
class Playback:
    """All that the page shows. Times count from the beginning of the log [s].

    Attributes:
        title: Heading.
        subtitle: A line below it.
        scene: The lamp.
        time: Moments of the frames, ascending, shape (k,) [s].
        motions: What is played.
        charts: What is drawn beside it.
        period: Of a tick: how far a step goes [s].
        goal: Where on the floor the lamp was sent [m]; NaN: unknown.
        phases: Parts of the run: name, begin and end [s].
        marks: Moments to be marked: when [s], level, text.
    """

    title: str
    subtitle: str
    scene: Scene
    time: Array
    motions: Sequence[Motion]
    charts: Sequence[Chart]
    period: float
    goal: float
    phases: Sequence[tuple[str, float, float]]
    marks: Sequence[tuple[float, str, str]]


def page(playback: Playback) -> str:
    """Return the page's HTML, with scripts, styles and data inside.

    Args:
        playback: What to show.
    """
    here = files("robolamp.player") / "web"
    scripts = [(here / name).read_text(encoding="utf-8") for name in ("stage.js", "charts.js", "player.js")]
    data = json.dumps(_data(playback), allow_nan=False, separators=(",", ":")).replace("</", "<\\/")
    return Template((here / "player.html").read_text(encoding="utf-8")).substitute(
        title=html.escape(playback.title),
        subtitle=html.escape(playback.subtitle),
        style=css() + (here / "player.css").read_text(encoding="utf-8"),
        script="\n".join(scripts),
        data=data,
    )


def _data(playback: Playback) -> dict[str, Any]:
    scene = playback.scene
    return {
        "vertices": _packed(scene.vertices, np.float32),
        "indices": _packed(scene.indices, np.uint32),
        "parts": [
            [part.body, part.first, part.count, *(round(c, 4) for c in part.color), part.emission, part.shine]
            for part in scene.parts
        ],
        "bodies": len(scene.bodies),
        "base": scene.base,
        "time": _packed(playback.time, np.float32),
        "motions": [
            {"name": motion.name, "ghost": motion.ghost, "poses": _packed(motion.poses, np.float32)}
            for motion in playback.motions
        ],
        "charts": [
            {
                "title": chart.title,
                "unit": chart.unit,
                "series": [
                    {
                        "name": series.name,
                        "time": _packed(series.time, np.float32),
                        "values": _packed(series.values, np.float32),
                    }
                    for series in chart.series
                ],
            }
            for chart in playback.charts
        ],
        "period": playback.period,
        "goal": None if math.isnan(playback.goal) else playback.goal,
        "phases": [list(phase) for phase in playback.phases],
        "marks": [list(mark) for mark in playback.marks],
    }


def _packed(values: NDArray[Any], kind: type[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<")).tobytes()).decode()
