"""The calibration's report: one self-contained HTML page that a person can judge a calibration by, by looking."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robolamp.calibrate.report import plots
from robolamp.calibrate.report.plots import Track
from robolamp.calibrate.report.published import PUBLISHED
from robolamp.calibration import JOINT, LAMP, SERVO, Calibration, Parameter
from robolamp.compare.report.comparison_page import document
from robolamp.files import write_atomic

_UNIT = re.compile(r"(\d) (cm|mrad|ms|s|N|V|Nm|Ohm)\b")  # a number is not torn from its unit at a line's end
_STYLE = """
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); gap: .8rem; margin: 1.6rem 0 0; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: .7rem .9rem; }
.card b { display: block; font-size: 1.5rem; line-height: 1.25; }
.card span { color: var(--faint); font-size: .88rem; }
.unknown td, .unknown th { color: var(--faint); font-style: italic; }
td.source { white-space: normal; text-align: left; color: var(--faint); font-size: .86rem; min-width: 16rem; }
figcaption .mae { color: var(--faint); }
header.plain { border-color: var(--faint); }
.plain .badge { color: var(--ink); }
h3 { margin: 1.6rem 0 .3rem; font-size: 1rem; }
"""


@dataclass(frozen=True)
class Shown:
    """One recording beside its simulation.

    Attributes:
        name: Of the recording.
        note: What it is for, or where it is from.
        fitted: Whether the calibration was fitted to it; None: not known.
        tracks: Its joints.
        before: Mean absolute error with the base calibration [rad]; NaN where not known.
    """

    name: str
    note: str
    fitted: bool | None
    tracks: tuple[Track, ...]
    before: float = math.nan

    @property
    def mae(self) -> float:
        """Mean absolute error of its joints [rad]."""
        return sum(track.mae for track in self.tracks) / len(self.tracks)


def write_report(path: Path, calibration: Calibration, shown: Sequence[Shown]) -> None:
    """Write the page.

    Args:
        path: Where to.
        calibration: What is judged.
        shown: The recordings that it is judged by, simulated with it.

    Raises:
        FileError: It cannot be written.
    """
    write_atomic(path, page(calibration, shown))


def page(calibration: Calibration, shown: Sequence[Shown]) -> str:
    """Return the report's HTML."""
    sections = [
        _head(calibration, shown),
        _findings(calibration.provenance),
        _table(shown),
        _ladder(calibration.provenance),
        _parameters(calibration),
        _overlays(shown),
        _sources(calibration),
    ]
    body = "\n".join(section for section in sections if section)
    return document(f"{calibration.name}: calibration", body, "", _STYLE)


def _head(calibration: Calibration, shown: Sequence[Shown]) -> str:
    provenance = calibration.provenance
    said = str(provenance.get("verdict", ""))
    good = said.startswith("The twin predicts") if said else None
    unseen = [one for one in shown if one.fitted is False]
    judged = unseen or list(shown)
    mae = sum(one.mae for one in judged) / len(judged)
    cards = [
        (f"{mae * 1e3:.1f} mrad", f"mean absolute error, {'recordings left out' if unseen else 'all recordings'}"),
        (str(len(shown)), f"recordings, {len(unseen)} of them left out" if unseen else "recordings"),
    ]
    if "hop_travel_error" in provenance:
        cards.append((f"{provenance['hop_travel_error']:.0%}", "largest error of a hop's length"))
    if "hop_time_error" in provenance:
        cards.append((f"{provenance['hop_time_error'] * 1e3:.0f} ms", "largest error of a take-off or landing"))
    badge = {True: "Good", False: "Poor", None: f"{mae * 1e3:.1f} mrad"}[good]
    colour = {True: "inside", False: "outside", None: "plain"}[good]
    told = said or f"Open loop, on average {mae * 1e3:.1f} mrad from {len(judged)} recordings."
    return (
        f"<header class='{colour}'><p class='kicker'>Calibration {_text(calibration.name)}, "
        f"{_text(str(provenance.get('date', '')))}</p>"
        f"<h1><span class='badge'>{badge}</span></h1><p class='verdict'>{_text(told)}</p></header>"
        "<div class='cards'>"
        + "".join(f"<div class='card'><b>{_text(value)}</b><span>{_text(label)}</span></div>" for value, label in cards)
        + "</div>"
    )


def _findings(provenance: Mapping[str, Any]) -> str:
    found = provenance.get("findings", [])
    if not found:
        return ""
    items = "".join(f"<li>{_text(str(item))}</li>" for item in found)
    return f"<section><h2>What it says</h2><ul class='diagnosis'>{items}</ul></section>"


def _table(shown: Sequence[Shown]) -> str:
    known = any(math.isfinite(one.before) for one in shown)
    widest = max(len(one.tracks) for one in shown)
    labels = next(one for one in shown if len(one.tracks) == widest).tracks
    head = "".join(f"<th>{_text(track.label or 'servo')}</th>" for track in labels) if widest > 1 else ""
    rows = []
    for one in shown:
        each = "".join(f"<td>{track.mae * 1e3:.1f}</td>" for track in one.tracks) if widest > 1 else ""
        each += "<td></td>" * (widest - len(one.tracks)) if widest > 1 else ""
        before = f"<td>{_number(one.before * 1e3)}</td>" if known else ""
        use = {True: "fitted to", False: "left out", None: ""}[one.fitted]
        rows.append(
            f"<tr><th>{_text(one.name)}</th><td>{use}</td>{before}<td><b>{one.mae * 1e3:.1f}</b></td>{each}</tr>"
        )
    before = "<th>before</th>" if known else ""
    return (
        "<section><h2>Errors</h2><p class='note'>Mean absolute error of the angle in mrad, simulated open loop from "
        "the first sample to the last, with the voltage as recorded.</p>"
        "<div class='scroll'><table class='numbers'><thead>"
        f"<tr><th>recording</th><th></th>{before}<th>now</th>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
        "</div></section>"
    )


def _ladder(provenance: Mapping[str, Any]) -> str:
    rungs = provenance.get("ladder", [])
    if not rungs:
        return ""
    drawn = plots.ladder([
        (str(r["name"]), float(r["mae"]), float(r.get("left_out_mae", math.nan)), bool(r["kept"])) for r in rungs
    ])  # fmt: skip
    return (
        "<section><h2>The ladder of models</h2><p class='note'>Each rung adds a term to those below. One that did not "
        "lower the error on recordings left out was not kept (in brackets), and the rungs above do without it.</p>"
        f"<figure>{drawn}</figure></section>"
    )


def _parameters(calibration: Calibration) -> str:
    servos: dict[str, str] = {}
    sections = []
    groups = [name for name in calibration.groups if name.startswith("joint ") and calibration.groups[name]]
    models = [name for name in calibration.groups if name != "lamp" and not name.startswith("joint ")]
    for name in groups:
        servos[name] = models[0] if len(models) == 1 else ""
    for name in ("lamp", *groups, *models):
        parameters = calibration.groups[name]
        legal = LAMP if name == "lamp" else {**SERVO, **JOINT}
        published = PUBLISHED.get(servos.get(name, name), {})
        rows = "".join(_row(key, parameters[key], published.get(key, "")) for key in legal if key in parameters)
        title = {"lamp": "The lamp as a whole"}.get(name, name.removeprefix("joint "))
        title = title.capitalize() if name in groups else title
        shared = " <small>for joints without a value of their own</small>" if name in models and groups else ""
        sections.append(
            f"<h3>{_text(title)}{shared}</h3><div class='scroll'><table class='numbers'><thead><tr><th>parameter</th>"
            "<th>value</th><th>± error</th><th>unit</th><th style='text-align:left'>data sheet, publications</th>"
            f"<th style='text-align:left'>from</th></tr></thead><tbody>{rows}</tbody></table></div>"
        )
    return (
        "<section><h2>Parameters</h2><p class='note'>± is one standard error. In italics: not measured here, taken "
        f"from the base calibration.</p>{''.join(sections)}</section>"
    )


def _row(name: str, parameter: Parameter, published: str) -> str:
    kind = "" if parameter.stderr is not None else " class='unknown'"
    error = f"{parameter.stderr:.2g}" if parameter.stderr is not None else "–"
    return (
        f"<tr{kind}><th>{_text(name)}</th><td>{parameter.value:.4g}</td><td>{error}</td><td>{_text(parameter.unit)}</td>"
        f"<td class='source'>{_text(published)}</td><td class='source'>{_text(parameter.source)}</td></tr>"
    )


def _overlays(shown: Sequence[Shown]) -> str:
    legend = (
        "<span class='legend'><span><i class='swatch twin'></i>simulated</span>"
        "<span><i class='swatch lamp'></i>measured</span><span><i class='swatch goal'></i>goal</span></span>"
    )
    figures = "".join(
        f"<figure><figcaption><b>{_text(one.name)}</b><span>{_text(one.note)}</span>"
        f"<span class='mae'>{_text(f'{one.mae * 1e3:.1f} mrad')}{', left out' if one.fitted is False else ''}</span>"
        f"{legend}</figcaption>{plots.overlay(one.tracks, f'{one.name}: measured and simulated angles')}</figure>"
        for one in shown
    )
    return f"<section><h2>Recordings</h2>{figures}</section>"


def _sources(calibration: Calibration) -> str:
    rows = "".join(
        f"<tr><th>{_text(str(key).replace('_', ' '))}</th><td>{_text(str(value))}</td></tr>"
        for key, value in calibration.provenance.items()
        if isinstance(value, str | int | float) and key not in ("verdict",)
    )
    return (
        f"<section><h2>Where it comes from</h2><table class='facts'>{rows}<tr><th>file</th>"
        f"<td>{_text(str(calibration.path))}, {calibration.hash[:12]}</td></tr></table>"
        f"<details><summary>The calibration file</summary><pre>{html.escape(calibration.source)}</pre></details>"
        "</section>"
    )


def _number(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "–"


def _text(value: str) -> str:
    return _UNIT.sub("\\1\u00a0\\2", html.escape(value))
