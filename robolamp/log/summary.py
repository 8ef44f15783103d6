"""What a log holds, in a few numbers: for `robolamp log info`, and to see at a glance whether a run went well."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import FileError
from robolamp.log.mcap_stream import read_contents
from robolamp.log.reader import Run, prefix_in, run_of
from robolamp.log.schemas import METADATA

_GAP = 1.5  # control periods between two ticks that make a gap


@dataclass
class Summary:
    """A log in a few numbers. For a log without ticks (a truth log), values about ticks are 0, NaN or empty.

    Attributes:
        path: The log.
        size: Of the file [bytes].
        truncated: Whether it ends early or is damaged.
        damage: What is wrong with it, one line a place.
        context: The run's context.
        topics: How many messages there are, by topic.
        duration: From the first message to the last [s]; where the clock of their times was set, from tick to tick.
        begin: Time of the first message [ns since the epoch].
        ticks: How many ticks.
        phases: How many of them in each phase.
        control_period: From tick to tick, as planned [s].
        missed_ticks: Slots of the schedule without a tick.
        clock_steps: Where the clock of the messages' times was set: tick, and by how much [s].
        gaps: Of the times from tick to tick those longer than 1.5 periods: when [s from the first tick], how long [s].
        hops: Hops counted.
        faults: How many ticks had each fault.
        interventions: How often the envelope changed what the controller asked for.
        events: (s from the first tick, level, text).
        voltage: Lowest and highest supply voltage [V].
        temperature: Highest temperature [degC].
        current: Largest current, either way [A].
    """

    path: Path
    size: int
    truncated: bool
    damage: list[str]
    context: dict[str, str]
    topics: dict[str, int]
    duration: float
    begin: int
    ticks: int = 0
    phases: dict[str, int] = field(default_factory=dict)
    control_period: float = math.nan
    missed_ticks: int = 0
    clock_steps: list[tuple[int, float]] = field(default_factory=list)
    gaps: list[tuple[float, float]] = field(default_factory=list)
    hops: int = 0
    faults: dict[str, int] = field(default_factory=dict)
    interventions: int = 0
    events: list[tuple[float, str, str]] = field(default_factory=list)
    voltage: tuple[float, float] = (math.nan, math.nan)
    temperature: float = math.nan
    current: float = math.nan


def summarise(path: Path | str) -> Summary:
    """Read a log of any kind: of a lamp, of a twin's replay, or a truth log.

    Raises:
        FileError: The file cannot be read, is not MCAP, or holds no message.
    """
    contents = read_contents(Path(path))
    times = [time for number in contents.channels for time in contents.times.get(number, ())]
    if not times:
        why = f": {contents.damage[0]}" if contents.damage else ""
        raise FileError(f"holds no messages{why}", str(path))
    summary = Summary(
        path=Path(path),
        size=contents.size,
        truncated=contents.truncated,
        damage=contents.damage,
        context=contents.metadata.get(METADATA, {}),
        topics=contents.topics,
        duration=(max(times) - min(times)) * 1e-9,
        begin=min(times),
    )
    prefix = prefix_in(contents)
    if f"{prefix}/tick" in summary.topics:
        _add_run(summary, run_of(contents, prefix))
    return summary


def _add_run(summary: Summary, run: Run) -> None:
    zero = run.began[0]
    steps = np.diff(run.began)
    summary.ticks = run.index.size
    summary.phases = dict(Counter(run.phase.tolist()))
    summary.control_period = run.control_period
    summary.missed_ticks = run.missed_ticks
    summary.clock_steps = [(int(run.index[row]), by) for row, by in run.clock_steps]
    if summary.clock_steps:
        summary.begin, summary.duration = int(run.log_time[0]), float(run.write_done[-1] - zero)
    long = np.flatnonzero(steps > _GAP * run.control_period)
    summary.gaps = [(float(run.began[tick] - zero), float(steps[tick])) for tick in long]
    summary.hops = int(run.hops[-1])
    summary.faults = dict(Counter(fault for faults in run.faults for fault in faults).most_common())
    summary.interventions = int(run.interventions[-1].sum())
    times = run.at(np.array([time for time, _, _ in run.events], np.int64)) - zero
    summary.events = [
        (max(0.0, time), level, text) for time, (_, level, text) in zip(times.tolist(), run.events, strict=True)
    ]
    summary.voltage = (_extreme(run.voltage, np.min), _extreme(run.voltage, np.max))
    summary.temperature = _extreme(run.temperature, np.max)
    summary.current = _extreme(np.abs(run.current), np.max)


def _extreme(values: NDArray[np.float64], pick: Callable[[NDArray[np.float64]], np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(pick(known)) if known.size else math.nan
