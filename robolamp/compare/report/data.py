"""The report's data for its plots and its moving figure: one time axis, and 16 bits a value."""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.compare.comparison import Comparison
from robolamp.compare.pauses import origin
from robolamp.compare.replays.trajectory import Base
from robolamp.log.reader import Run
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.lanes.lamp_body import Body

Array = NDArray[np.float64]

MOST_TICKS = 36_000
"""Ticks that are drawn at most (12 minutes at 50 Hz): a longer log is thinned, so that the page stays below 5 MB."""
_STILL = 0.005  # goals that change less than this from tick to tick stand still [rad]
# Height of a plot at least: noise is not motion.
_LEAST = {"rad": 0.1, "mrad": 10.0, "mA": 100.0, "N": 4.0, "cm": 5.0, "V": 1.0, "ms": 4.0}
_AFTER = 0.5  # how much of the rest after the motion is shown at first [s]


def page_data(comparison: Comparison) -> str:
    """Return what report.js reads, as JSON that may stand inside a script element."""
    run = comparison.run
    zero = origin(run)
    keep = np.arange(0, run.index.size, max(1, math.ceil(run.index.size / MOST_TICKS)))
    time = (run.measured_at - zero)[keep]
    begin, end = _running(run)
    data = {
        "time": _encoded(time.astype(np.float32)),
        "series": {name: _packed(values) for name, values in _series(comparison, keep, time).items()},
        "panels": _panels(comparison),
        "joints": list(run.joints),
        "begin": begin,
        "end": end,
        "shown": moving(run)[1] - zero,
        "look": _look(comparison),
        "parted": None if math.isnan(comparison.parting.time) else comparison.parting.time,
        "reach": _reach(comparison),
        "skeleton": _skeleton(comparison.twin),
    }
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def moving(run: Run) -> tuple[float, float]:
    """Return from when to when the controller's goals moved, and half a second more, on the run's own clock [s]."""
    running = np.flatnonzero(run.phase == "run")
    if not running.size:
        return float(run.began[0]), float(run.write_done[-1])
    changed = np.flatnonzero((np.abs(np.diff(run.goal[running], axis=0)) > _STILL).any(axis=1))
    last = run.began[running[changed[-1] + 1]] if changed.size else run.began[running[-1]]
    return float(run.began[running[0]]), float(min(last + _AFTER, run.write_done[-1]))


def _series(comparison: Comparison, keep: NDArray[np.int64], time: Array) -> dict[str, Array]:
    run, lamp, other = comparison.run, comparison.lamp, comparison.other
    found: dict[str, Array] = {}
    for index, joint in enumerate(comparison.joints):
        seen = lamp.time[keep, index]
        lag = joint.lag if math.isfinite(joint.lag) else 0.0
        reference = other.trace(index)
        found[f"goal.{joint.name}"] = run.goal[keep, index]
        found[f"lamp.{joint.name}"] = run.angle[keep, index]
        found[f"twin.{joint.name}"] = reference.at(seen)
        found[f"off.{joint.name}"] = (run.angle[keep, index] - reference.at(seen - lag)) * 1e3
        found[f"lamp.current.{joint.name}"] = run.current[keep, index] * 1e3
        found[f"twin.current.{joint.name}"] = _at(other.tick, other.current[:, index], time) * 1e3
    found["lamp.force"] = run.foot_force[keep]
    found["twin.force"] = _at(other.tick, other.force, time)
    found["volts"] = _least(run.voltage[keep])
    found["period"] = np.concatenate([[np.nan], np.diff(run.began)])[keep] * 1e3
    for who, side in (("lamp", lamp), ("twin", other)):
        base = side.base or _borrowed(comparison)
        for name, values, scale in (("x", base.x, 100.0), ("z", base.z, 100.0), ("pitch", base.pitch, 1.0)):
            found[f"{who}.{name}"] = _at(base.time, values, time) * scale
    if lamp.base is None:
        found["lamp.travel"] = np.full(time.size, np.nan)
    else:
        found["lamp.travel"] = found["lamp.x"]
    found["twin.travel"] = found["twin.x"] if other.base else np.full(time.size, np.nan)
    return found


def _borrowed(comparison: Comparison) -> Base:
    """Return the base's motion of a side that does not know its own: that of the twin's replay."""
    if comparison.other.base is not None and comparison.reference is None:
        return comparison.other.base
    replay, run = comparison.replay, comparison.run
    start = float(np.interp(run.began[0], replay.time, replay.base_x))
    return Base(replay.time - origin(run), replay.base_x - start, replay.base_z, replay.pitch, replay.angle)


def _panels(comparison: Comparison) -> dict[str, Any]:
    ours, called = comparison.lamp.name, comparison.other.name
    pair = [("twin", called, "twin"), ("lamp", ours, "lamp")]
    panels: dict[str, Any] = {}
    for joint in comparison.joints:
        lines = [{"name": f"goal.{joint.name}", "label": "goal", "colour": "goal", "width": 1, "dash": [4, 3]}]
        lines += [{"name": f"{who}.{joint.name}", "label": label, "colour": colour} for who, label, colour in pair]
        panels[joint.name] = {"lines": lines, "unit": "rad", "digits": 3, "height": 210}
        allowed = comparison.tolerances.joint_mae * 1e3
        panels[f"off {joint.name}"] = {
            "lines": [{"name": f"off.{joint.name}", "label": f"{ours} less {called}", "colour": "lamp"}],
            "unit": "mrad", "digits": 1, "height": 110, "band": allowed, "symmetric": 1.2 * allowed,
        }  # fmt: skip
        lines = [{"name": f"{who}.current.{joint.name}", "label": label, "colour": c} for who, label, c in pair]
        panels[f"current {joint.name}"] = {"lines": lines, "unit": "mA", "digits": 0, "height": 120}
    lines = [{"name": f"{who}.force", "label": label, "colour": colour} for who, label, colour in pair]
    panels["force"] = {"lines": lines, "unit": "N", "digits": 2, "height": 170}
    lines = [{"name": f"{who}.travel", "label": label, "colour": colour} for who, label, colour in pair]
    goal = comparison.run.goal_m * 100
    panels["travel"] = {
        "lines": lines, "unit": "cm", "digits": 1, "height": 170, "level": goal if math.isfinite(goal) else None,
        "levelled": "goal", "says": f"goal {goal:.1f} cm",
    }  # fmt: skip
    panels["volts"] = {
        "lines": [{"name": "volts", "label": "supply", "colour": "lamp"}], "unit": "V", "digits": 1, "height": 110,
    }  # fmt: skip
    panels["period"] = {
        "lines": [{"name": "period", "label": "tick", "colour": "lamp"}], "unit": "ms", "digits": 2, "height": 110,
        "level": comparison.run.control_period * 1e3, "levelled": "faint", "says": "control period",
    }  # fmt: skip
    for panel in panels.values():
        panel["least"] = _LEAST[panel["unit"]]
    return panels


def _look(comparison: Comparison) -> float:
    """Return the moment that the figure shows at first [s]: the middle of the first flight."""
    for hop in comparison.flights:
        if hop.lamp is not None:
            return (hop.lamp.off + hop.lamp.on) / 2
    return 0.0


def _reach(comparison: Comparison) -> list[float]:
    ways = [side.base.x for side in (comparison.lamp, comparison.other) if side.base is not None]
    ways = ways or [_borrowed(comparison).x]
    return [min(float(way.min()) for way in ways), max(float(way.max()) for way in ways)]


def _running(run: Run) -> tuple[float, float]:
    zero = origin(run)
    rows = np.flatnonzero(run.phase == "run")
    ends = (rows[0], rows[-1]) if rows.size else (0, -1)
    return float(run.scheduled[ends[0]] - zero), float(run.scheduled[ends[1]] - zero)


def _skeleton(twin: TwinModel) -> dict[str, Any]:
    """Return the lamp's links from the side, base to each joint, and the shade, all in the neutral pose [m]."""
    body = Body(twin)
    data, model = body.data, body.model
    joints = [data.xanchor[model.joint(name).id] for name in twin.lamp.names]
    base = data.qpos[:3]
    links = [(after - before)[[0, 2]].round(5).tolist() for before, after in zip([base, *joints], joints, strict=False)]
    head, foot = model.geom("head"), model.geom("foot")
    axes, centre = data.geom_xmat[head.id].reshape(3, 3), data.geom_xpos[head.id] - joints[-1]
    along, across = head.size[1] * axes[:, 2], head.size[0] * axes[:, 0]
    shade = (
        np.zeros(3), centre - along - 0.36 * across, centre + along - across, centre + along + across,
        centre - along + 0.36 * across,
    )  # fmt: skip
    return {
        "links": links,
        "head": [point[[0, 2]].round(5).tolist() for point in shade],
        "foot": {"radius": float(foot.size[0]), "height": float(4 * foot.size[1])},
    }


def _at(time: Array, value: Array, moments: Array) -> Array:
    there = np.isfinite(time) & np.isfinite(value)
    if np.count_nonzero(there) < 2:
        return np.full(moments.size, np.nan)
    return np.interp(moments, time[there], value[there], math.nan, math.nan)


def _least(volts: Array) -> Array:
    known = np.isfinite(volts).any(axis=1)
    least = np.full(len(volts), np.nan)
    least[known] = np.nanmin(volts[known], axis=1)
    return least


def _packed(values: Array) -> dict[str, Any]:
    """Return values as 16-bit whole numbers: low + (n + 32767) step; -32768 is a gap."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    step = (high - low) / 65_534 or 1.0
    whole = np.full(values.size, -32_768, np.int16)
    there = np.isfinite(values)
    whole[there] = np.round((values[there] - low) / step - 32_767).astype(np.int16)
    return {"low": low, "step": step, "values": _encoded(whole)}


def _encoded(values: NDArray[Any]) -> str:
    return base64.b64encode(values.astype(values.dtype.newbyteorder("<")).tobytes()).decode()
