"""The report: one self-contained HTML file that a person can judge a run by."""

from __future__ import annotations

import base64
import html
import io
import math
import re
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files

import numpy as np
from PIL import Image

from robolamp.compare import plots
from robolamp.compare.align import JointError
from robolamp.compare.comparison import Comparison
from robolamp.files import write_atomic
from robolamp.log.reader import Run
from robolamp.twin.render import Picture, qpos_of, strip

_FRAMES = 7
_STILL = 0.005  # goals that change less than this from tick to tick stand still [rad]
_AFTER = 0.5  # how much of the rest after the motion a strip shows [s]
_UNIT = re.compile(r"(\d) (cm|mrad|ms|s|N|V)\b")  # a number is not torn from its unit at a line's end
_ARTICLE = {"twin": "a twin in virtual time", "emulator": "an emulated lamp", "lamp": "a physical lamp"}


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
    run = comparison.run
    name = run.context.get("controller_name") or run.path.stem
    sections = [
        _head(comparison, name),
        _pictures(comparison),
        _facts(comparison, name),
        _diagnosis(comparison),
        _joints(comparison),
        _rest(comparison),
        _sources(comparison),
    ]
    style = files("robolamp.compare").joinpath("report.css").read_text(encoding="utf-8")
    colours = f":root {{ --twin: {plots.TWIN}; --lamp: {plots.LAMP}; }}"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_text(name)}: lamp against twin</title>\n<style>\n{style}{colours}\n</style>\n</head>\n"
        "<body>\n<main>\n" + "\n".join(sections) + "\n</main>\n</body>\n</html>\n"
    )


def sentence(comparison: Comparison) -> str:
    """Return the verdict in a sentence or two."""
    joints = [joint for joint in comparison.joints if joint.samples]
    mean = float(np.mean([joint.after.mae for joint in joints])) * 1e3
    worst = max(joints, key=lambda joint: joint.after.mae)
    lags = [joint.lag for joint in joints if math.isfinite(joint.lag)]
    lag = float(np.median(lags)) * 1e3 if lags else math.nan
    late = f", with a lag of {lag:+.1f} ms removed" if math.isfinite(lag) else ""
    text = (
        f"On average the joints are {mean:.1f} mrad from the twin's{late}; the {worst.name} is off most, by "
        f"{worst.after.mae * 1e3:.1f} mrad (allowed: {comparison.tolerances.joint_mae * 1e3:.0f})."
    )
    if math.isfinite(comparison.lamp_travel):
        text += f" The lamp came {_cm(comparison.lamp_travel)}, the twin {_cm(comparison.twin_travel)}."
    return text


def _head(comparison: Comparison, name: str) -> str:
    failures = "".join(f"<li>{_text(item)}</li>" for item in comparison.exceeded)
    backend = _ARTICLE.get(comparison.run.context.get("backend", ""), "a lamp")
    cut = "<p class='note'>The log ends early: the process that wrote it was killed. What it holds is compared.</p>"
    return (
        f"<header class='{comparison.verdict}'><p class='kicker'>{_text(name)} on {backend}, against its twin</p>"
        f"<h1><span class='badge'>{comparison.verdict.capitalize()}</span> tolerances</h1>"
        f"<p class='verdict'>{_text(sentence(comparison))}</p>"
        + (f"<ul class='failures'>{failures}</ul>" if failures else "")
        + (cut if comparison.run.truncated else "")
        + "</header>"
    )


def _pictures(comparison: Comparison) -> str:
    run, replay, truth = comparison.run, comparison.replay, comparison.truth
    moments = np.linspace(*_moving(run), _FRAMES)
    rows = np.searchsorted(replay.time, moments).clip(0, replay.time.size - 1)
    labels = [_label(moment - run.scheduled[0], x) for moment, x in zip(moments, replay.base_x[rows], strict=True)]
    figures = _figure(strip(replay.twin, replay.qpos[rows], labels), "twin", "The twin, with the goals of the log")
    if truth is not None:
        time = run.at(truth.log_time)
        start = float(np.interp(run.began[0], time, truth.base_x))
        tracks = [truth.base_x - start, truth.base_z, truth.pitch, *truth.angle.T]
        poses = np.array([np.interp(moments, time, track) for track in tracks]).T
        labels = [_label(moment - run.scheduled[0], pose[0]) for moment, pose in zip(moments, poses, strict=True)]
        qpos = np.array([qpos_of(replay.twin, pose[:3].tolist(), pose[3:]) for pose in poses])
        figures += _figure(strip(replay.twin, qpos, labels), "lamp", "The emulated lamp, as it truly moved")
    return f"<section><h2>The motion</h2>{figures}</section>"


def _moving(run: Run) -> tuple[float, float]:
    """Return from when to when the controller's goals moved, and half a second more [s]: what a strip is to show."""
    running = np.flatnonzero(run.phase == "run")
    if not running.size:
        return float(run.began[0]), float(run.write_done[-1])
    changed = np.flatnonzero((np.abs(np.diff(run.goal[running], axis=0)) > _STILL).any(axis=1))
    last = run.began[running[changed[-1] + 1]] if changed.size else run.began[running[-1]]
    return float(run.began[running[0]]), float(min(last + _AFTER, run.write_done[-1]))


def _figure(picture: Picture, who: str, caption: str) -> str:
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, format="JPEG", quality=88)
    data = base64.b64encode(stream.getvalue()).decode()
    return (
        f"<figure class='strip'><figcaption>{_swatch(who)}{_text(caption)}</figcaption>"
        f"<img alt='{_text(caption)}' src='data:image/jpeg;base64,{data}'></figure>"
    )


def _facts(comparison: Comparison, name: str) -> str:
    run = comparison.run
    faults = Counter(fault for tick in run.faults for fault in tick)
    told = ", ".join(f"{text} ({count}×)" for text, count in faults.most_common(4)) or "none"
    if len(faults) > 4:
        told += f", and {len(faults) - 4} more kinds"
    changed = run.interventions[-1]
    periods = np.diff(run.began) * 1e3
    rows = [
        ("Controller", name),
        ("Goal", _cm(run.goal_m)),
        ("Landed", _landed(comparison)),
        ("Upright", _upright(comparison)),
        ("Hops", f"{comparison.hops} on the lamp, {comparison.twin_hops} in the twin (by the foot sensor)"),
        ("Ticks", f"{run.index.size} of {run.control_period * 1e3:g} ms; {run.missed_ticks} missed"),
        ("Faults", told),
        ("Envelope", f"{changed[0]} not finite, {changed[1]} limited, {changed[2]} slewed"),
        ("Twin", f"calibration {comparison.calibration.name}, {comparison.calibration.hash[:12]}{_same(comparison)}"),
        ("Versions", run.context.get("versions", "not in the log")),
        ("Command", run.context.get("command", "not in the log")),
        ("Log", str(run.path)),
    ]
    if periods.size:
        middle, late = np.percentile(periods, [50, 99])
        rows.insert(6, ("Tick period", f"{middle:.2f} ms p50, {late:.2f} ms p99, {periods.max():.2f} ms longest"))
    body = "".join(f"<tr><th>{_text(key)}</th><td>{_text(value)}</td></tr>" for key, value in rows)
    return f"<section><h2>The run</h2><table class='facts'>{body}</table></section>"


def _landed(comparison: Comparison) -> str:
    twin = f"twin {_cm(comparison.twin_travel)}"
    if not math.isfinite(comparison.lamp_travel):
        return f"{twin}; the lamp's own travel is not measured"
    return f"lamp {_cm(comparison.lamp_travel)}, {twin}"


def _upright(comparison: Comparison) -> str:
    lamp = {None: "lamp not known", False: "lamp stayed up", True: "lamp fell"}[comparison.fell]
    return f"{lamp}, {'twin fell' if comparison.twin_fell else 'twin stayed up'}"


def _same(comparison: Comparison) -> str:
    logged = comparison.run.context.get("calibration_hash", "")
    if not logged or logged == comparison.calibration.hash:
        return ""
    return f" (the run was made with {comparison.run.context.get('calibration_name', 'another')}, {logged[:12]})"


def _diagnosis(comparison: Comparison) -> str:
    if not comparison.diagnosis:
        return "<section><h2>Diagnosis</h2><p>Nothing stands out.</p></section>"
    items = "".join(
        f"<li><strong>{_text(_capital(finding.cause))}.</strong> {_text(_capital(finding.evidence))}. "
        f"<em>{_text(_capital(finding.remedy))}.</em></li>"
        for finding in comparison.diagnosis
    )
    return (
        f"<section><h2>Diagnosis</h2><p class='note'>Likeliest first.</p><ol class='diagnosis'>{items}</ol></section>"
    )


def _joints(comparison: Comparison) -> str:
    allowed = comparison.tolerances
    head = (
        "<tr><th rowspan=2>joint</th><th rowspan=2>lag<br><small>ms</small></th>"
        "<th colspan=2>MAE <small>mrad</small></th><th colspan=2>RMSE <small>mrad</small></th>"
        "<th rowspan=2>bias<br><small>mrad</small></th>"
        "<th rowspan=2>worst<br><small>mrad</small></th><th rowspan=2>swing<br><small>lamp/twin</small></th>"
        "<th rowspan=2>readings</th></tr>"
        "<tr><th>as is</th><th>no lag</th><th>as is</th><th>no lag</th></tr>"
    )
    body = "".join(_row(joint, allowed.joint_mae, allowed.lag, comparison) for joint in comparison.joints)
    figures = "".join(
        f"<figure><figcaption><b>{_text(joint.name)}</b>{_legend()}</figcaption>{plots.joint_plot(comparison, index)}"
        "</figure>"
        for index, joint in enumerate(comparison.joints)
    )
    return (
        "<section><h2>The joints</h2><p class='note'>Over the controller's part of the run (unshaded in the plots). "
        "A positive lag means that the lamp is later than the twin; errors are lamp minus twin. “No lag” is with each "
        f"joint's own lag removed, and what the tolerance is for: {allowed.joint_mae * 1e3:g} mrad, "
        f"{allowed.lag * 1e3:g} ms.</p>"
        f"<div class='scroll'><table class='numbers'><thead>{head}</thead><tbody>{body}</tbody></table></div>"
        f"{figures}</section>"
    )


def _row(joint: JointError, mae: float, lag: float, comparison: Comparison) -> str:
    late = " class='bad'" if abs(joint.lag) > lag else ""
    off = " class='bad'" if joint.after.mae > mae else ""
    when = joint.after.worst_at - comparison.run.scheduled[0]
    return (
        f"<tr><th>{_text(joint.name)}</th><td{late}>{_number(joint.lag * 1e3, '+.1f')}</td>"
        f"<td>{_number(joint.before.mae * 1e3, '.1f')}</td><td{off}>{_number(joint.after.mae * 1e3, '.1f')}</td>"
        f"<td>{_number(joint.before.rmse * 1e3, '.1f')}</td><td>{_number(joint.after.rmse * 1e3, '.1f')}</td>"
        f"<td>{_number(joint.after.bias * 1e3, '+.1f')}</td>"
        f"<td>{_number(joint.after.worst * 1e3, '+.0f')} <small>at {_number(when, '.2f')} s</small></td>"
        f"<td>{_number(joint.swing, '.3f')}</td><td>{joint.samples}/{joint.of}</td></tr>"
    )


def _rest(comparison: Comparison) -> str:
    drawn: Sequence[tuple[str, str, str]] = [
        ("Foot", _legend(goal=False), plots.force_plot(comparison)),
        ("Base", _legend(goal=False), plots.travel_plot(comparison)),
        ("Tick period", "", plots.period_plot(comparison)),
    ]
    figures = "".join(
        f"<figure><figcaption><b>{title}</b>{legend}</figcaption>{plot}</figure>" for title, legend, plot in drawn
    )
    return f"<section><h2>Foot, base and schedule</h2>{figures}</section>"


def _sources(comparison: Comparison) -> str:
    context = comparison.run.context
    texts = [
        ("Controller file", context.get("controller", "")),
        ("Lamp description", context.get("lamp", "")),
        ("Calibration of the twin", comparison.calibration.source),
    ]
    if context.get("calibration", comparison.calibration.source) != comparison.calibration.source:
        texts.append(("Calibration in the log", context["calibration"]))
    events = "\n".join(f"{level}: {text}" for _, level, text in comparison.run.events)
    body = "".join(
        f"<details><summary>{_text(title)}</summary><pre>{_text(text)}</pre></details>"
        for title, text in [*texts, ("Events", events)]
        if text
    )
    return f"<section><h2>Sources</h2>{body}</section>"


def _legend(goal: bool = True) -> str:
    sent = "<span><i class='swatch goal'></i>goal</span>" if goal else ""
    return f"<span class='legend'><span>{_swatch('twin')}twin</span><span>{_swatch('lamp')}lamp</span>{sent}</span>"


def _swatch(who: str) -> str:
    return f"<i class='swatch {who}'></i>"


def _label(time: float, x: float) -> str:
    return f"{time:.2f} s   {_cm(x)}"


def _cm(metres: float) -> str:
    return f"{round(metres * 100, 1) + 0.0:.1f} cm" if math.isfinite(metres) else "unknown"


def _number(value: float, form: str) -> str:
    return format(value, form).replace("-", "−") if math.isfinite(value) else "–"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _text(value: str) -> str:
    return _UNIT.sub("\\1\u00a0\\2", html.escape(value))
