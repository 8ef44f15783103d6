"""A run and its replay as the player shows them: the lamp, the twin over it, and the traces of both."""

from __future__ import annotations

import math

import numpy as np

from robolamp.compare.logged_motion import lamp_motion, twin_motion
from robolamp.compare.replays.goal_replay import Replay
from robolamp.log.reader import Run, Truth
from robolamp.player.player_page import Chart, Motion, Playback, Series
from robolamp.player.scene import poses_of, scene_of

_FRAME = 0.02  # time between two frames; the player moves smoothly from one to the next [s]
_MOST_FRAMES = 15_000  # of a run that lasts longer there are fewer a second: 8 MB of poses are enough
_TRACE = 0.01  # time between two samples of the twin's and the truth's traces [s]


def playback_of(run: Run, replay: Replay, truth: Truth | None = None) -> Playback:
    """Return what the player shows of a run. Its times count from when the first tick began.

    Args:
        run: The lamp's log.
        replay: What the twin made of it.
        truth: The truth log of an emulated lamp, where there is one: it knows where the base was.
    """
    zero, end = float(run.began[0]), float(run.write_done[-1])
    length = max(end - zero, _FRAME)
    frames = np.linspace(zero, zero + length, min(round(length / _FRAME), _MOST_FRAMES) + 1)
    scene = scene_of(replay.twin)
    motions = (
        Motion("lamp", poses_of(replay.twin, scene, lamp_motion(run, replay, frames, truth))),
        Motion("twin", poses_of(replay.twin, scene, twin_motion(replay, frames)), ghost=True),
    )
    return Playback(
        title=_title(run),
        subtitle=_subtitle(run, truth),
        scene=scene,
        time=frames - zero,
        motions=motions,
        charts=_charts(run, replay, truth, zero),
        period=run.control_period,
        goal=run.goal_m,
        phases=_phases(run, zero),
        marks=_marks(run, zero),
    )


def _title(run: Run) -> str:
    name = run.context.get("controller_name", run.path.name)
    return name if math.isnan(run.goal_m) else f"{name}, sent {run.goal_m * 100:g} cm"


def _subtitle(run: Run, truth: Truth | None) -> str:
    backend = {"emulator": "emulated lamp", "lamp": "physical lamp"}.get(run.context.get("backend", ""), "twin")
    base = "the base's place is the emulator's truth" if truth else "the base's place is the twin's: no sensor knows it"
    ticks = f"{run.index.size} ticks at {1 / run.control_period:g} Hz, {run.missed_ticks} missed"
    return f"{run.path}: {backend}, {ticks}; {base}"


def _charts(run: Run, replay: Replay, truth: Truth | None, zero: float) -> list[Chart]:
    sent, read = run.write_done - zero, run.measured_at - zero
    every = max(1, round(_TRACE / float(replay.time[1] - replay.time[0])))
    during = slice(0, int(np.searchsorted(replay.time, run.write_done[-1])) + 1, every)
    twin = replay.time[during] - zero
    charts = [
        Chart(
            name,
            "rad",
            (
                Series("goal", sent, run.goal[:, joint]),
                Series("twin", twin, replay.angle[during, joint]),
                Series("lamp", run.sampled_at[:, joint] - zero, run.angle[:, joint]),
            ),
        )
        for joint, name in enumerate(run.joints)
    ]
    charts.append(
        Chart("floor force", "N", (Series("twin", twin, replay.force[during]), Series("lamp", read, run.foot_force)))
    )
    travel = [Series("twin", twin, replay.base_x[during] * 100)]
    if truth is not None:
        at = run.at(truth.log_time) - zero
        known = (at >= 0.0) & (at <= run.write_done[-1] - zero)
        travel.append(Series("lamp", at[known], truth.base_x[known] * 100))
    if math.isfinite(run.goal_m):
        whole, begun = np.array([0.0, run.write_done[-1] - zero]), travel[-1].values[:1]
        travel.insert(0, Series("goal", whole, np.full(2, run.goal_m * 100) + (begun if begun.size else 0.0)))
    charts.append(Chart("travel", "cm", travel))
    return charts


def _phases(run: Run, zero: float) -> list[tuple[str, float, float]]:
    starts = np.flatnonzero(np.concatenate([[True], run.phase[1:] != run.phase[:-1]]))
    ends = [*run.began[starts[1:]], run.write_done[-1]]
    return [
        (str(run.phase[start]), float(run.began[start] - zero), float(end - zero))
        for start, end in zip(starts, ends, strict=True)
    ]


def _marks(run: Run, zero: float) -> list[tuple[float, str, str]]:
    """Return events, and the first tick of every spell of a fault."""
    times = run.at(np.array([when for when, _, _ in run.events], np.int64)) - zero
    marks = [
        (max(0.0, time), level, text)
        for time, (_, level, text) in zip(times.tolist(), run.events, strict=True)
        if text not in run.phase  # the phase is shown anyway
    ]
    before: frozenset[str] = frozenset()
    for tick, faults in enumerate(run.faults):
        marks += [(float(run.began[tick] - zero), "warning", fault) for fault in faults if fault not in before]
        before = frozenset(faults)
    return sorted(marks)
