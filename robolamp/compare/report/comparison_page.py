"""The report: one self-contained HTML file that shows how a run went; report.js draws its plots."""

from __future__ import annotations

import base64
import html
import io
import itertools
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files

import numpy as np
from PIL import Image

from robolamp.compare.align import JointError
from robolamp.compare.comparison import Comparison
from robolamp.compare.divergence import BANDS
from robolamp.compare.pauses import origin
from robolamp.compare.replays.trajectory import Base
from robolamp.compare.report.data import moving, page_data
from robolamp.compare.travel.sensed_flights import Flight
from robolamp.compare.verdicts.controller_alone import Alone
from robolamp.compare.verdicts.task_verdict import DONE, NOT_DONE
from robolamp.compare.verdicts.task_verdict import cm as _cm
from robolamp.compare.verdicts.twin_verdict import CANNOT_SAY, INSIDE
from robolamp.files import write_atomic
from robolamp.log.run_context import PLAYED
from robolamp.palette import css
from robolamp.twin.pictures.moments import caption, moments
from robolamp.twin.pictures.render import Picture, qpos_of, strip

_SAMPLE = 0.004  # time between the poses among which those of the strips are found [s]
_FRAMES = 7
_UNIT = re.compile(r"(\d) (cm|mrad|ms|s|N|V|%|ppm|Ohm)(?![\w])")  # a number is not torn from its unit at a line's end
_ARTICLE = {"twin": "a twin in virtual time", "emulator": "an emulated lamp", "lamp": "a physical lamp"}
_CODE = re.compile(r"`([^`]+)`")


def write_report(comparison: Comparison) -> None:
    """Write the HTML file that `comparison.report` names.

    Args:
        comparison: What to tell.

    Raises:
        FileError: It cannot be written.
    """
    write_atomic(comparison.report, page(comparison))


def page(comparison: Comparison) -> str:
    """Return the report's HTML."""
    name = comparison.run.context.get("controller_name") or comparison.run.path.stem
    body = [
        _head(comparison, name),
        _diagnosis(comparison),
        _motion(comparison),
        _joints(comparison),
        _hops(comparison),
        _rest(comparison),
        _facts(comparison, name),
        _sources(comparison),
    ]
    return document(
        f"{name}: {comparison.lamp.name} against {comparison.other.name}", "\n".join(body), page_data(comparison)
    )


def document(title: str, body: str, data: str, style: str = "") -> str:
    """Return a whole page with everything in it that it needs.

    Args:
        title: Of the page.
        body: What it says, as HTML.
        data: What report.js draws, as JSON; empty: nothing is drawn.
        style: Style rules of this page, after those of all.
    """
    shelf = files("robolamp.compare.report").joinpath("web")
    parts = {name: shelf.joinpath(name).read_text(encoding="utf-8") for name in _PARTS}
    scripts = (
        f'<script id="data" type="application/json">{data}</script>\n<script>{parts["uPlot.iife.min.js"]}</script>\n'
        f"<script>\n{parts['report.js']}</script>\n"
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{text(title)}</title>\n<style>\n{css()}{parts['uPlot.min.css']}\n{parts['report.css']}{style}\n</style>\n"
        f"</head>\n<body>\n<main>\n{body}\n</main>\n{scripts if data else ''}</body>\n</html>\n"
    )


_PARTS = ("uPlot.iife.min.js", "uPlot.min.css", "report.js", "report.css")


def three(comparison: Comparison) -> tuple[tuple[str, str, str], ...]:
    """Return the three questions, each with its answer in a word or two and the reasons."""
    task, judged, alone = comparison.task, comparison.judged, comparison.alone
    against = "Does the twin explain it?"
    same = "Driven with the goal angles that the lamp was sent, the twin does the same"
    if comparison.reference is not None:
        against, same = "Do both runs agree?", f"The {comparison.lamp.name} and the {comparison.other.name} do the same"
    why = judged.why or (f"{same}, within the tolerances",)
    return (
        ("Did it do the task?", _capital(task.word), _sentences(task.why)),
        (against, _capital(judged.word) + " tolerances" * (judged.word != CANNOT_SAY), _sentences(why)),
        ("And its controller alone on the twin?", *_alone(comparison, alone)),
    )


def _alone(comparison: Comparison, alone: Alone) -> tuple[str, str]:
    if alone.why:
        return "Not known", f"It could not be run: {alone.why}."
    goal = comparison.run.goal_m
    did = f"Lands at {_cm(alone.travel)} for a goal of {_cm(goal)} ({(alone.travel - goal) * 100:+.1f} cm)"
    if _cm(alone.least) != _cm(alone.most):
        did += f", at {_cm(alone.least)} to {_cm(alone.most)} if it starts a hair apart,"
    same = (comparison.task.word, alone.hit) == (NOT_DONE, False)
    return (
        "Fell" if alone.fell else "Done" if alone.hit else "Not done",
        f"{did} after {alone.hops} hop{'s' * (alone.hops != 1)}, in its own closed loop, without the goal angles "
        f"that the lamp was sent.{' It misses there, too: look at the controller before the lamp.' * same}",
    )


def _sentences(said: Sequence[str]) -> str:
    return f"{_capital('; '.join(said))}." if said else ""


def sentence(comparison: Comparison) -> str:
    """Return how far the two are apart in a sentence or two."""
    joints = [joint for joint in comparison.joints if joint.known]
    if not joints:
        return "No joint has enough readings to compare."
    mean = float(np.mean([joint.after.mae for joint in joints])) * 1e3
    worst = max(joints, key=lambda joint: joint.after.mae)
    lags = [joint.lag for joint in joints if math.isfinite(joint.lag)]
    lag = float(np.median(lags)) * 1e3 if lags else math.nan
    late = f", with a lag of {lag:+.1f} ms removed" if math.isfinite(lag) else ""
    whose = f"{comparison.other.name}'s"
    said = (
        f"On average the joints are {mean:.1f} mrad from the {whose}{late}; the {worst.name} is off most, by "
        f"{worst.after.mae * 1e3:.1f} mrad (allowed: {comparison.tolerances.joint_mae * 1e3:.0f})."
    )
    if math.isfinite(comparison.lamp.travel) and math.isfinite(comparison.other.travel):
        who = "twin, replaying its goal angles," if comparison.reference is None else comparison.other.name
        said += (
            f" The {comparison.lamp.name} came {_cm(comparison.lamp.travel)}, the {who} {_cm(comparison.other.travel)}"
            f" (allowed: {_cm(comparison.tolerances.travel)} apart)."
        )
    if math.isfinite(comparison.spread.horizon):
        said += (
            f" From {comparison.spread.horizon:.1f} s on the twin cannot predict the joints: replays that start a hair "
            "apart are further from each other than that."
        )
    return said


def _head(comparison: Comparison, name: str) -> str:
    backend = _ARTICLE.get(comparison.run.context.get("backend", ""), "a lamp")
    against = "its twin"
    if comparison.reference is not None:
        against = f"{comparison.other.name} ({comparison.reference.path.name})"
        backend += f", {comparison.lamp.name}"
    cut = "<p class='note'>The log ends early: the process that wrote it was killed. What it holds is compared.</p>"
    parts = "".join(
        f"<div class='part {colour}'><h2>{text(asked)}</h2><p class='badge'>{text(word)}</p><p>{text(why)}</p></div>"
        for (asked, word, why), colour in zip(three(comparison), _colours(comparison), strict=True)
    )
    return (
        f"<header><p class='kicker'>{text(name)} on {backend}, against {text(against)}</p>"
        f"<h1>{text(_title(comparison))}</h1><div class='parts'>{parts}</div>"
        f"<p class='verdict'>{text(sentence(comparison))} {text(_parted(comparison))}</p>"
        + (cut if comparison.run.truncated else "")
        + "</header>"
    )


def _title(comparison: Comparison) -> str:
    """Return task and verdict in one line, as "Not done, inside tolerances"."""
    verdict = comparison.verdict + (
        " whether the twin explains it" if comparison.verdict == CANNOT_SAY else " tolerances"
    )
    task = comparison.task.word + (" whether it did its task" if comparison.task.word == CANNOT_SAY else "")
    return f"{_capital(task)}, {verdict}"


def _colours(comparison: Comparison) -> tuple[str, str, str]:
    """Return the CSS class of each of the three answers."""
    of = {DONE: "good", INSIDE: "good", CANNOT_SAY: "open"}
    alone = comparison.alone
    return (
        of.get(comparison.task.word, "bad"),
        of.get(comparison.verdict, "bad"),
        "open" if alone.why else "good" if alone.hit else "bad",
    )


def _parted(comparison: Comparison) -> str:
    parting = comparison.parting
    just_then = f"; just then: {', '.join(parting.just_then)}." if parting.just_then else "."
    if math.isfinite(parting.time):
        return f"They part for good {parting.time:.2f} s into the run, the {parting.joint} first{just_then}"
    if not parting.joint:
        return "They stay together: at no time are joints or base further apart than is allowed."
    return (
        f"They part {parting.first:.2f} s into the run, the {parting.joint} first, and are together again "
        f"from {parting.last:.2f} s on{just_then}"
    )


def _diagnosis(comparison: Comparison) -> str:
    if not comparison.diagnosis:
        left = text(comparison.account.left)
        return f"<section><h2>What is different</h2><p>Nothing stands out.</p><p class='note'>{left}</p></section>"
    items = ""
    for finding in comparison.diagnosis:
        share = ""
        if math.isfinite(finding.share):
            width = max(finding.share, 0.01)
            share = f"<div class='bar' title='{finding.share:.0%}'><i style='width:{width:.1%}'></i></div>"
        items += (
            f"<li><strong>{text(_capital(finding.cause))}</strong> ({finding.explains}).{share}"
            f"<p>{text(_capital(finding.evidence))}.</p><p class='remedy'>{text(_capital(finding.remedy))}.</p></li>"
        )
    how = (
        "What must have changed between the two runs; the change that explains most comes first. Twins with one number "
        "changed replayed both runs; the bar is the share of the difference that a change accounts for"
        if comparison.reference
        else "Likeliest first. Twins with one number changed replayed the run; the bar is how much of the difference "
        "the best size explains beyond the lines above it"
    )
    return (
        f"<section><h2>What is different</h2><p class='note'>{how}.</p><ol class='diagnosis'>{items}</ol>"
        f"<p>{text(comparison.account.left)}</p></section>"
    )


def _motion(comparison: Comparison) -> str:
    shown, pictures = _shown(comparison), ""
    for who, side in (("twin", comparison.other), ("lamp", comparison.lamp)):
        if side.base is not None and shown:
            title = f"The {side.name}" + (", as it truly moved" if who == "lamp" or comparison.reference else "")
            pictures += _figure(_strip(comparison, side.base, shown), who, title)
    borrowed = (
        ""
        if comparison.lamp.base
        else f" Nothing measures where the {comparison.lamp.name}'s base is: {_drawn(comparison)}."
    )
    return (
        "<section><h2>The motion</h2><p class='note'>At half speed; or move over any plot below."
        f"{text(borrowed)}</p><figure><canvas id='stage' role='img' aria-label='Both lamps from the side'></canvas>"
        "<div class='controls'><button id='play' type='button' aria-pressed='false'>Play</button>"
        "<input id='moment' type='range' min='0' value='0' aria-label='Moment'><output id='clock'></output>"
        f"{_legend(comparison, goal=False)}</div></figure>{pictures}</section>"
    )


def _drawn(comparison: Comparison) -> str:
    return f"it is drawn where the twin's is{'' if comparison.reference is None else ' in its replay'}"


def _shown(comparison: Comparison) -> dict[float, str]:
    """Return when the strips show the lamps [s], and what moments those are: the lamp's, or who knows its base."""
    begin, end = moving(comparison.run)
    time = np.arange(begin, end, _SAMPLE) - origin(comparison.run)
    base = comparison.lamp.base or comparison.other.base
    if base is None or time.size < 2:
        return {}
    poses = _poses(comparison, base, time)
    return {float(time[at]): name for at, name in moments(comparison.twin, time, lambda at: poses[at], _FRAMES)}


def _strip(comparison: Comparison, base: Base, shown: Mapping[float, str]) -> Picture:
    poses = _poses(comparison, base, np.array(list(shown)))
    labels = [caption(when, name, pose[0]) for (when, name), pose in zip(shown.items(), poses, strict=True)]
    return strip(comparison.twin, poses, labels)


def _poses(comparison: Comparison, base: Base, time: np.ndarray) -> np.ndarray:
    tracks = [base.x, base.z, base.pitch, *base.angle.T]
    poses = np.array([np.interp(time, base.time, track) for track in tracks]).T
    return np.array([qpos_of(comparison.twin, pose[:3].tolist(), pose[3:]) for pose in poses])


def _figure(picture: Picture, who: str, caption: str) -> str:
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, format="JPEG", quality=88)
    data = base64.b64encode(stream.getvalue()).decode()
    return (
        f"<figure class='strip'><figcaption>{_swatch(who)}{text(caption)}</figcaption><div class='scroll'>"
        f"<img alt='{text(caption)}' src='data:image/jpeg;base64,{data}'></div></figure>"
    )


def _plot(comparison: Comparison, title: str, *panels: str, legend: bool = True, goal: bool = False) -> str:
    drawn = "".join(
        f"<div class='panel'><p class='unit'>{text(label)}<span class='readout'></span></p>"
        f"<div data-panel='{key}'></div></div>"
        for key, _, label in (panel.partition("|") for panel in panels)
    )
    known = _legend(comparison, goal) if legend else ""
    return f"<figure><figcaption><b>{text(title)}</b>{known}</figcaption>{drawn}</figure>"


def _joints(comparison: Comparison) -> str:
    allowed = comparison.tolerances
    head = (
        "<tr><th rowspan=2>joint</th><th rowspan=2>lag<br><small>ms</small></th>"
        "<th rowspan=2>drift<br><small>ppm</small></th>"
        "<th colspan=2>MAE <small>mrad</small></th><th colspan=2>RMSE <small>mrad</small></th>"
        "<th rowspan=2>bias<br><small>mrad</small></th><th rowspan=2>worst<br><small>mrad</small></th>"
        "<th rowspan=2>speed<br><small>mrad/s</small></th><th rowspan=2>current<br><small>mA</small></th>"
        "<th rowspan=2>readings</th></tr><tr><th>as is</th><th>no lag</th><th>as is</th><th>no lag</th></tr>"
    )
    body = "".join(_row(comparison, index, joint) for index, joint in enumerate(comparison.joints))
    figures = "".join(
        _plot(
            comparison,
            joint.name,
            f"{joint.name}|angle, rad",
            f"off {joint.name}|difference without the lag, mrad (allowed on average: the band)",
            f"current {joint.name}|current, mA",
            goal=True,
        )
        for joint in comparison.joints
    )
    return (
        "<section><h2>The joints</h2><p class='note'>Over the controller's part of the run (unshaded in the plots). "
        f"A positive lag means that the {text(comparison.lamp.name)} is later; errors are {text(comparison.lamp.name)} "
        f"minus {text(comparison.other.name)}. “No lag” "
        f"is with each joint's own lag removed, and what the tolerance is for: {allowed.joint_mae * 1e3:g} mrad, "
        f"{allowed.lag * 1e3:g} ms. Drag over a plot to look closer; a double click shows everything again.</p>"
        f"<div class='scroll'><table class='numbers'><thead>{head}</thead><tbody>{body}</tbody></table></div>"
        f"{figures}{_spectra(comparison)}</section>"
    )


def _row(comparison: Comparison, index: int, joint: JointError) -> str:
    allowed, plain = comparison.tolerances, comparison.plain
    late = " class='bad'" if abs(joint.lag) > allowed.lag else ""
    off = " class='bad'" if joint.after.mae > allowed.joint_mae else ""
    return (
        f"<tr><th>{text(joint.name)}</th><td{late}>{_number(joint.lag * 1e3, '+.1f')}</td>"
        f"<td>{_number(joint.drift * 1e6, '+.0f')}</td>"
        f"<td>{_number(joint.before.mae * 1e3, '.1f')}</td><td{off}>{_number(joint.after.mae * 1e3, '.1f')}</td>"
        f"<td>{_number(joint.before.rmse * 1e3, '.1f')}</td><td>{_number(joint.after.rmse * 1e3, '.1f')}</td>"
        f"<td>{_number(joint.after.bias * 1e3, '+.1f')}</td>"
        f"<td>{_number(joint.after.worst * 1e3, '+.0f')} "
        f"<small>at {_number(joint.after.worst_at, '.2f')} s</small></td>"
        f"<td>{_number(plain.velocity[index] * 1e3, '.0f')}</td><td>{_number(plain.current[index] * 1e3, '.0f')}</td>"
        f"<td>{joint.samples}/{joint.of}</td></tr>"
    )


def _spectra(comparison: Comparison) -> str:
    ends = [f"{low:g}–{high:g}" for low, high in itertools.pairwise(BANDS)]
    head = "<th>joint</th>" + "".join(f"<th>{band} <small>Hz</small></th>" for band in (*ends, f"above {BANDS[-1]:g}"))
    body = "".join(
        f"<tr><th>{text(each.name)}</th>" + "".join(f"<td>{_number(v * 1e3, '.1f')}</td>" for v in each.bands) + "</tr>"
        for each in comparison.spectra
    )
    return (
        "<h3>Where in frequency the error lies</h3><p class='note'>RMS in each band, mrad. Slow: zeros and sag. In the "
        "middle, where the lamp hops: strength, friction, delay. Fast: noise and impacts.</p>"
        f"<div class='scroll'><table class='numbers'><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _hops(comparison: Comparison) -> str:
    way = (
        ""
        if comparison.way is None
        else f"<p>By its odometer the {text(comparison.lamp.name)} {text(comparison.way.text)}</p>"
    )
    if not comparison.flights:
        foot = _plot(comparison, "Foot", "force|force, N")
        return f"<section><h2>The hops</h2>{way}<p>Neither left the floor.</p>{foot}</section>"
    allowed = comparison.tolerances.hop * 1e3
    rows = ""
    for number, hop in enumerate(comparison.flights, start=1):
        late = "".join(
            f"<td{' class=bad' if abs(value * 1e3) > allowed else ''}>{_number(value * 1e3, '+.0f')}</td>"
            for value in (hop.off_late, hop.on_late)
        )
        rows += (
            f"<tr><th>{number}</th><td>{_flight(hop.lamp, 'off')}</td><td>{_flight(hop.lamp, 'on')}</td>{late}"
            f"<td>{_flight(hop.lamp, 'time')}</td><td>{_flight(hop.twin, 'time')}</td>"
            f"<td>{_flight(hop.lamp, 'apex')}</td><td>{_flight(hop.twin, 'apex')}</td></tr>"
        )
    ours, called = text(comparison.lamp.name), text(comparison.other.name)
    head = (
        f"<tr><th rowspan=2>hop</th><th colspan=2>the {ours} <small>s</small></th>"
        "<th colspan=2>how late <small>ms</small></th><th colspan=2>flight <small>ms</small></th>"
        "<th colspan=2>apex <small>mm</small></th></tr>"
        f"<tr><th>takes off</th><th>lands</th><th>takes off</th><th>lands</th><th>{ours}</th><th>{called}</th>"
        f"<th>{ours}</th><th>{called}</th></tr>"
    )
    return (
        f"<section><h2>The hops</h2>{way}<p class='note'>By the foot sensor: off the floor for "
        f"{comparison.twin.lamp.flight_time * 1e3:g} ms or longer. The apex is "
        f"what the flight time implies, g t²/8. Allowed: {allowed:g} ms early or late.</p>"
        f"<div class='scroll'><table class='numbers'><thead>{head}</thead><tbody>{rows}</tbody></table></div>"
        f"{_plot(comparison, 'Foot', 'force|force, N')}</section>"
    )


def _flight(flight: Flight | None, name: str) -> str:
    scale, form = {"off": (1.0, ".3f"), "on": (1.0, ".3f"), "time": (1e3, ".0f"), "apex": (1e3, ".1f")}[name]
    return "–" if flight is None else _number(getattr(flight, name) * scale, form)


def _rest(comparison: Comparison) -> str:
    return (
        "<section><h2>Base, supply and schedule</h2>"
        + (_plot(comparison, "Base", "travel|travel, cm (the line: the goal)") if _knows_travel(comparison) else "")
        + _plot(comparison, "Supply", "volts|lowest of the servos' voltages, V", legend=False)
        + _plot(comparison, "Tick period", "period|from tick to tick, ms", legend=False)
        + "</section>"
    )


def _knows_travel(comparison: Comparison) -> bool:
    return comparison.lamp.base is not None or comparison.other.base is not None


def _facts(comparison: Comparison, name: str) -> str:
    run = comparison.run
    faults = Counter(fault for tick in run.faults for fault in tick)
    told = ", ".join(f"{fault} ({count}×)" for fault, count in faults.most_common(4)) or "none"
    if len(faults) > 4:
        told += f", and {len(faults) - 4} more kinds"
    changed = run.interventions[-1]
    called = comparison.other.name
    periods = np.diff(run.began) * 1e3
    rows = [
        ("Controller", name),
        ("Goal", _cm(run.goal_m)),
        ("Landed", _landed(comparison)),
        ("Upright", f"{comparison.lamp.name} {_stood(comparison.lamp.fell)}, {called} {_stood(comparison.other.fell)}"),
        (
            "Hops",
            f"{comparison.lamp.hops} of the {comparison.lamp.name}, {comparison.other.hops} of the {called} "
            "(by the foot sensor)",
        ),
        ("Controller again", comparison.control.text),
        ("Ticks", f"{run.index.size} of {run.control_period * 1e3:g} ms; {run.missed_ticks} missed"),
        ("Faults", told),
        ("Envelope", f"{changed[0]} not finite, {changed[1]} limited, {changed[2]} slewed"),
        (
            "Twin" if comparison.reference is None else "Replayed in the twin",
            f"calibration {comparison.calibration.name}, {comparison.calibration.hash[:12]}{_same(comparison)}",
        ),
        ("Versions", run.context.get("versions", "not in the log")),
        ("Command", run.context.get("command", "not in the log")),
        ("Log", str(run.path)),
    ]
    if comparison.reference is not None:
        rows.append(("Against", str(comparison.reference.path)))
    if periods.size:
        middle, late = np.percentile(periods, [50, 99])
        rows.insert(7, ("Tick period", f"{middle:.2f} ms p50, {late:.2f} ms p99, {periods.max():.2f} ms longest"))
    body = "".join(f"<tr><th>{text(key)}</th><td>{text(value)}</td></tr>" for key, value in rows)
    return f"<section><h2>The run</h2><table class='facts'>{body}</table></section>"


def _landed(comparison: Comparison) -> str:
    replays = " (replaying the lamp's goal angles)" if comparison.reference is None else ""
    other = f"{comparison.other.name}{replays} {_cm(comparison.other.travel)}"
    if not math.isfinite(comparison.lamp.travel):
        said = f"{other}; the {comparison.lamp.name}'s own travel is not measured"
    else:
        said = f"{comparison.lamp.name} {_cm(comparison.lamp.travel)}, {other}"
    return said if comparison.alone.why else f"{said}; the controller alone on the twin {_cm(comparison.alone.travel)}"


def _stood(fell: bool | None) -> str:
    return {None: "not known", False: "stayed up", True: "fell"}[fell]


def _same(comparison: Comparison) -> str:
    logged = comparison.run.context.get("calibration_hash", "")
    if not logged or logged == comparison.calibration.hash:
        return ""
    return f" (the run was made with {comparison.run.context.get('calibration_name', 'another')}, {logged[:12]})"


def _sources(comparison: Comparison) -> str:
    context = comparison.run.context
    texts = [
        ("Controller file", context.get("controller", "")),
        *((f"{kind.capitalize()} file", context.get(kind, "")) for kind in PLAYED),
        ("Lamp description", context.get("lamp", "")),
        ("Calibration of the twin", comparison.calibration.source),
    ]
    if context.get("calibration", comparison.calibration.source) != comparison.calibration.source:
        texts.append(("Calibration in the log", context["calibration"]))
    events = "\n".join(f"{level}: {line}" for _, level, line in comparison.run.events)
    body = "".join(
        f"<details><summary>{text(title)}</summary><pre>{text(content)}</pre></details>"
        for title, content in [*texts, ("Events", events)]
        if content
    )
    return f"<section><h2>Sources</h2>{body}</section>"


def _legend(comparison: Comparison, goal: bool = True) -> str:
    sent = "<span><i class='swatch goal'></i>goal</span>" if goal else ""
    ours, called = text(comparison.lamp.name), text(comparison.other.name)
    return (
        f"<span class='legend'><span>{_swatch('twin')}{called}</span><span>{_swatch('lamp')}{ours}</span>{sent}</span>"
    )


def _swatch(who: str) -> str:
    return f"<i class='swatch {who}'></i>"


def _number(value: float, form: str) -> str:
    return format(value, form).replace("-", "−") if math.isfinite(value) else "–"


def _capital(said: str) -> str:
    return said[:1].upper() + said[1:]


def text(value: str) -> str:
    """Return text as HTML; what stands between backticks as code."""
    return _CODE.sub(r"<code>\1</code>", _UNIT.sub("\\1\u00a0\\2", html.escape(value)))
