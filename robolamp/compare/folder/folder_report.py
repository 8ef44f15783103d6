"""The report of a folder of runs: a table, the trend over time, and the lamp's scores against the twin's."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from robolamp.compare.folder.folder_runs import Folder, Row
from robolamp.compare.report.comparison_page import document, text
from robolamp.compare.report.svg_plots import FAINT, LAMP, STYLE, TWIN, svg
from robolamp.compare.verdicts.task_verdict import DONE
from robolamp.compare.verdicts.twin_verdict import CANNOT_SAY, INSIDE
from robolamp.files import write_atomic


def write_folder_report(folder: Folder, path: Path) -> None:
    """Write the report of a folder.

    Args:
        folder: What to tell.
        path: The HTML file.

    Raises:
        FileError: It cannot be written.
    """
    said = " ".join(folder.sentences())
    rows = "".join(_row(folder, row) for row in folder.rows)
    skipped = "".join(
        f"<li>{text(str(where.relative_to(folder.path)))}: {text(why)}</li>" for where, why in folder.skipped
    )
    reasons = "".join(
        f"<li><b>{text(str(row.log.relative_to(folder.path)))}</b>: {text(row.why)}</li>"
        for row in folder.rows
        if row.why
    )
    head = (
        "<th>began</th><th>task</th><th>twin explains</th><th>controller</th><th>goal <small>cm</small></th>"
        "<th>lamp <small>cm</small></th><th>twin alone <small>cm</small></th>"
        "<th>replay <small>cm</small></th><th>hops</th><th>replay's</th><th>MAE <small>mrad</small></th>"
        "<th>lag <small>ms</small></th><th class='file'>log</th>"
    )
    body = (
        f"<header><p class='kicker'>{text(folder.path.resolve().name)}, against the twin (calibration "
        f"{text(folder.calibration.name)})</p><h1>{len(folder.rows)} run{'s' * (len(folder.rows) != 1)}</h1>"
        f"<p class='verdict'>{text(said)}</p></header>"
        "<section><h2>The runs</h2><p class='note'>Twin alone: where the controller lands in its own closed loop on "
        "the twin. Replay: where the twin lands on the goals that the lamp was sent; that is what “twin explains” is "
        f"about.</p><div class='scroll'><table class='numbers'><thead><tr>{head}</tr></thead>"
        f"<tbody>{rows}</tbody></table></div>{f'<h3>Why</h3><ul>{reasons}</ul>' if reasons else ''}"
        f"{f'<h3>Skipped</h3><ul>{skipped}</ul>' if skipped else ''}</section>"
        f"<section><h2>Over time</h2>{_trend(folder)}</section>"
        "<section><h2>Lamp against twin</h2><p class='note'>A score is the landing error, the distance between where "
        "the base came to rest and the goal: of the lamp by its truth log or the ruler (travel.csv), of the twin on "
        "the goals that the lamp was sent. Each point is a controller, the mean of its runs; on the line they agree."
        f"</p>{_scores(folder)}</section>"
    )
    write_atomic(path, document(f"{folder.path.resolve().name}: runs against the twin", body, ""))


def _row(folder: Folder, row: Row) -> str:
    began = datetime.fromtimestamp(row.began).astimezone().strftime("%Y-%m-%d %H:%M")
    cells = [
        _number(row.goal * 100, ".1f"), _number(row.travel * 100, ".1f"), _number(row.alone.travel * 100, ".1f"),
        _number(row.twin_travel * 100, ".1f"),
        str(row.hops), str(row.twin_hops), _number(row.mae * 1e3, ".1f"), _number(row.lag * 1e3, "+.1f"),
    ]  # fmt: skip
    body = "".join(f"<td>{cell}</td>" for cell in cells)
    log = text(str(row.log.relative_to(folder.path)))
    words = "".join(
        f"<td class='{'good' if word in (DONE, INSIDE) else 'open' if word == CANNOT_SAY else 'bad'}'>{text(word)}</td>"
        for word in (row.task.word, row.judged.word)
    )
    return f"<tr><th>{began}</th>{words}<td>{text(row.controller)}</td>{body}<td class='file'>{log}</td></tr>"


def _trend(folder: Folder) -> str:
    number = np.arange(1, len(folder.rows) + 1)

    def draw(axes: Axes) -> None:
        axes.plot(number, [row.mae * 1e3 for row in folder.rows], "o-", color=LAMP, markersize=4, linewidth=1.2)
        axes.set_ylim(bottom=0)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("run, in order of time")
        axes.set_ylabel("mean MAE of the joints [mrad]")

    return _svg(draw, (9.4, 2.6), "Error from run to run")


def _scores(folder: Folder) -> str:
    pairs: list[tuple[str, str, Callable[[Row], float], Callable[[Row], float], float]] = [
        ("landing error", "cm", lambda row: row.score, lambda row: row.twin_score, 100.0),
        ("hops", "", lambda row: row.hops, lambda row: row.twin_hops, 1.0),
    ]
    drawn = []
    for what, unit, lamp, twin, scale in pairs:
        points = _means(folder.rows, lamp, twin)
        if not points:
            continue
        label = f"{what} [{unit}]" if unit else what

        def draw(axes: Axes, points: dict[str, tuple[float, float]] = points, scale: float = scale, label: str = label):
            values = np.array(list(points.values())) * scale
            most = float(values.max()) * 1.1 or 1.0
            axes.plot([0, most], [0, most], color=FAINT, linewidth=0.8, linestyle=(0, (4, 3)))
            axes.plot(values[:, 0], values[:, 1], "o", color=TWIN)
            for (x, y), names in _labels(points, values).items():
                left = x > most / 2  # towards the middle, where there is room
                axes.annotate(
                    names, (x, y), xytext=(-6 if left else 6, 4), textcoords="offset points", fontsize=8,
                    ha="right" if left else "left",
                )  # fmt: skip
            axes.set(xlim=(0, most), ylim=(0, most), xlabel=f"twin: {label}", ylabel=f"lamp: {label}")

        drawn.append(_svg(draw, (4.6, 3.8), f"{what}, lamp against twin"))
    return f"<div class='pair'>{''.join(drawn)}</div>" if drawn else "<p>Nothing is known of both.</p>"


def _labels(names: Iterable[str], values: NDArray[np.float64]) -> dict[tuple[float, float], str]:
    """Return the label of each point; controllers at the same point share one."""
    labels: dict[tuple[float, float], list[str]] = {}
    for name, (x, y) in zip(names, values.round(3).tolist(), strict=True):
        labels.setdefault((x, y), []).append(name)
    return {point: ", ".join(found) for point, found in labels.items()}


def _means(
    rows: Sequence[Row], lamp: Callable[[Row], float], twin: Callable[[Row], float]
) -> dict[str, tuple[float, float]]:
    names = dict.fromkeys(row.controller for row in rows)
    found = {}
    for name in names:
        pairs = np.array([(twin(row), lamp(row)) for row in rows if row.controller == name], float)
        pairs = pairs[np.isfinite(pairs).all(axis=1)]
        if len(pairs):
            found[name] = (float(pairs[:, 0].mean()), float(pairs[:, 1].mean()))
    return found


def _svg(draw: Callable[[Axes], None], size: tuple[float, float], title: str) -> str:
    with rc_context(STYLE):
        figure = Figure(figsize=size)
        figure.subplots_adjust(0.62 / size[0], 0.5 / size[1], 1 - 0.12 / size[0], 1 - 0.12 / size[1])
        draw(figure.subplots())
        return f"<figure>{svg(figure, title)}</figure>"


def _number(value: float, form: str) -> str:
    return format(value, form).replace("-", "−") if math.isfinite(value) else "–"
