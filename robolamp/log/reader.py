"""Reads a log into numpy arrays: a run (twin, emulated or physical lamp), or the truth of an emulated one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import FileError, RobolampError
from robolamp.log.cdr import Rows
from robolamp.log.schemas import (
    ANSWER_WIRE,
    EVENT,
    JOINT_STATE,
    LAMP_PREFIX,
    METADATA,
    TICK,
    TRUTH,
    TRUTH_BASE_TOPIC,
    TRUTH_JOINTS_TOPIC,
    TWIN_PREFIX,
)
from robolamp.log.stream import Contents, read_contents

if TYPE_CHECKING:
    import pandas

Array = NDArray[np.float64]


@dataclass(repr=False)
class Run:
    """A run of N ticks of a lamp with n joints. Times are on the run's own clock [s]; a missing value is NaN.

    Attributes:
        path: The log.
        context: The run's context (see `robolamp.log.context`).
        truncated: Whether the log ends early (the process was killed) or is damaged.
        joints: Joint names, from the foot up.
        log_time: When the goals were sent, shape (N,) [ns since the epoch].
        index: Tick numbers, shape (N,).
        phase: "start", "run" or "landing", shape (N,).
        scheduled: When each tick was due, shape (N,) [s].
        began: When it began, shape (N,) [s].
        read_done: When the sensors had been read, shape (N,) [s].
        write_done: When the goals had been sent, shape (N,) [s].
        measured_at: Time stamp of the measurements, shape (N,) [s].
        goal: Goals sent, shape (N, n) [rad].
        angle: Measured joint angles, shape (N, n) [rad].
        velocity: Measured joint velocities, shape (N, n) [rad/s].
        current: Measured currents, shape (N, n) [A].
        angle_age: Age of the angles, shape (N, n) [s].
        foot_force: Floor force on the foot, shape (N,) [N].
        foot_age: Age of the foot force, shape (N,) [s].
        contact: Whether the foot is on the ground, shape (N,).
        hops: Hops counted so far, shape (N,).
        voltage: Supply voltage at the servos, shape (N, n) [V].
        temperature: Shape (N, n) [degC].
        pwm: Duty, shape (N, n), -1 to 1.
        torque: Torque enable, shape (N, n); -1 unknown.
        hardware_error: Hardware error bits, shape (N, n); -1 unknown.
        inputs: The controller's terminals, shape (N, k); NaN outside phase "run".
        outputs: The controller's raw outputs, shape (N, n) [rad]; NaN outside phase "run".
        interventions: Running totals of the envelope (not finite, limited, slewed), shape (N, 3).
        faults: Faults of each tick.
        events: (ns since the epoch, level, text) of what happened between ticks.
    """

    path: Path
    context: dict[str, str]
    truncated: bool
    joints: tuple[str, ...]
    log_time: NDArray[np.int64]
    index: NDArray[np.int64]
    phase: NDArray[np.str_]
    scheduled: Array
    began: Array
    read_done: Array
    write_done: Array
    measured_at: Array
    goal: Array
    angle: Array
    velocity: Array
    current: Array
    angle_age: Array
    foot_force: Array
    foot_age: Array
    contact: NDArray[np.bool_]
    hops: NDArray[np.int64]
    voltage: Array
    temperature: Array
    pwm: Array
    torque: NDArray[np.int64]
    hardware_error: NDArray[np.int64]
    inputs: Array
    outputs: Array
    interventions: NDArray[np.int64]
    faults: list[tuple[str, ...]]
    events: list[tuple[int, str, str]]

    def __repr__(self) -> str:
        ticks = f"{self.index.size} tick{'' if self.index.size == 1 else 's'}"
        lasts = float(self.write_done[-1] - self.began[0]) if self.index.size else 0.0
        said = [f"{self.context.get('backend', 'unknown backend')}, {ticks} in {lasts:.1f} s", ", ".join(self.joints)]
        if name := self.context.get("controller_name"):
            said.insert(1, name if math.isnan(self.goal_m) else f"{name} to {self.goal_m:g} m")
        if self.truncated:
            said.append("ends early")
        return f"<Run {str(self.path)!r}: {'; '.join(said)}>"

    def to_pandas(self) -> pandas.DataFrame:
        """Return the run as a table, a row a tick (`robolamp.log.table.columns_of`), its context in `attrs`.

        Raises:
            RobolampError: pandas is not installed.
        """
        from robolamp.log.table import columns_of  # noqa: PLC0415 (which reads runs, too)

        try:
            import pandas  # noqa: PLC0415 (nothing else of robolamp needs it)
        except ImportError:
            raise RobolampError("needs pandas: pip install pandas", "to_pandas") from None
        table = pandas.DataFrame(columns_of(self))
        table.attrs = dict(self.context)
        return table

    @property
    def terminals(self) -> tuple[str, ...]:
        """Names of the controller's terminals, in the order of `inputs`; empty where the log does not say."""
        return tuple(self.context.get("terminals", "").split())

    @property
    def control_period(self) -> float:
        """Time from tick to tick [s]: as the context says, else the median of the schedule; NaN for one tick."""
        try:
            return float(self.context["control_period"])
        except (KeyError, ValueError):
            return float(np.median(np.diff(self.scheduled))) if self.scheduled.size > 1 else math.nan

    @property
    def goal_m(self) -> float:
        """Where the lamp was sent [m]; NaN where the log does not say."""
        try:
            return float(self.context["goal_m"])
        except (KeyError, ValueError):
            return math.nan

    @property
    def answer_wire(self) -> float:
        """How long a reading's packets are on the line [s]; NaN where the log does not say."""
        try:
            return float(self.context[ANSWER_WIRE])
        except (KeyError, ValueError):
            return math.nan

    @property
    def missed_ticks(self) -> int:
        """Slots of the schedule, from the first tick to the last, in which no tick ran."""
        if self.scheduled.size < 2:
            return 0
        slots = round((self.scheduled[-1] - self.scheduled[0]) / self.control_period) + 1
        return max(0, slots - self.scheduled.size)

    @property
    def sampled_at(self) -> Array:
        """When each angle was sampled, shape (N, n) [s]."""
        return self.measured_at[:, None] - self.angle_age

    def at(self, log_time: NDArray[np.int64]) -> Array:
        """Return wall-clock stamps as times on the run's clock [s].

        Args:
            log_time: Nanoseconds since the epoch.
        """
        return self.write_done[0] + (log_time - self.log_time[0]) * 1e-9


@dataclass
class Truth:
    """What the emulated lamp truly did, M samples.

    Attributes:
        path: The log.
        truncated: Whether it ends early.
        joints: Joint names.
        log_time: Shape (M,) [ns since the epoch].
        angle: True joint angles, shape (M, n) [rad].
        velocity: Shape (M, n) [rad/s].
        torque: Motor torques, shape (M, n) [Nm].
        base_x: The base centre along the floor, shape (M,) [m].
        base_z: Its height, shape (M,) [m].
        pitch: Lean from upright, shape (M,) [rad].
        clearance: Lowest point of the foot above the floor, shape (M,) [m].
        force: Floor force on the foot, shape (M,) [N].
        fallen: Shape (M,).
    """

    path: Path
    truncated: bool
    joints: tuple[str, ...]
    log_time: NDArray[np.int64]
    angle: Array
    velocity: Array
    torque: Array
    base_x: Array
    base_z: Array
    pitch: Array
    clearance: Array
    force: Array
    fallen: NDArray[np.bool_]


def read_run(path: Path | str, prefix: str = LAMP_PREFIX) -> Run:
    """Read a run; a log whose writer was killed gives every tick that was flushed.

    Args:
        path: The log.
        prefix: First part of the topics: "/lamp", or "/twin" for a replay.

    Raises:
        FileError: The file cannot be read, is not MCAP, is not a log of robolamp's, or holds no ticks.
    """
    return run_of(read_contents(Path(path)), prefix)


def prefix_in(contents: Contents) -> str:
    """Return the first part of the topics of the run in a log: "/twin" where only a twin's replay is in it.

    Args:
        contents: What the file holds.
    """
    topics = contents.topics
    return TWIN_PREFIX if f"{TWIN_PREFIX}/tick" in topics and f"{LAMP_PREFIX}/tick" not in topics else LAMP_PREFIX


def run_of(contents: Contents, prefix: str = LAMP_PREFIX) -> Run:
    """Return the run in a log that has been read.

    Args:
        contents: What the file holds.
        prefix: First part of the topics: "/lamp", or "/twin" for a replay.

    Raises:
        FileError: It is not a log of robolamp's, or holds no ticks.
    """
    tick_times, ticks = contents.topic(f"{prefix}/tick", TICK, *_TICK_FIELDS)
    goal_times, goals = contents.topic(f"{prefix}/goals", JOINT_STATE, "position", first=("name",))
    seen_times, seen = contents.topic(f"{prefix}/measured", JOINT_STATE, "position", "velocity", "effort")
    joints = goals["name"][0]
    log_time = np.array(tick_times, dtype=np.int64)
    stamps = log_time - _nanoseconds(ticks["write_done"]) + _nanoseconds(ticks["measured_at"])
    rows, of_goals, of_seen = _matched(
        (log_time, stamps), np.array(goal_times, np.int64), np.array(seen_times, np.int64)
    )
    if not rows.size:
        raise FileError(
            "holds no whole tick: goals, measurements and the rest are of different times", str(contents.path)
        )
    table = _Table(contents.path, ticks, rows, len(joints))
    sent = _Table(contents.path, goals, of_goals, len(joints))
    measured = _Table(contents.path, seen, of_seen, len(joints))
    return Run(
        path=contents.path,
        context=contents.metadata.get(METADATA, {}),
        truncated=contents.truncated,
        joints=tuple(joints),
        log_time=log_time[rows],
        index=table.integers("index"),
        phase=np.array(table.texts("phase"), dtype=np.str_),
        scheduled=table.numbers("scheduled"),
        began=table.numbers("began"),
        read_done=table.numbers("read_done"),
        write_done=table.numbers("write_done"),
        measured_at=table.numbers("measured_at"),
        goal=sent.rows("position"),
        angle=measured.rows("position"),
        velocity=measured.rows("velocity"),
        current=measured.rows("effort"),
        angle_age=table.rows("angle_age"),
        foot_force=table.numbers("foot_force"),
        foot_age=table.numbers("foot_age"),
        contact=table.numbers("contact").astype(np.bool_),
        hops=table.integers("hops"),
        voltage=table.rows("voltage"),
        temperature=table.rows("temperature"),
        pwm=table.rows("pwm"),
        torque=table.flags("torque"),
        hardware_error=table.flags("hardware_error"),
        inputs=table.ragged("inputs"),
        outputs=table.ragged("outputs"),
        interventions=np.stack([table.integers(name) for name in ("not_finite", "limited", "slewed")], axis=1),
        faults=table.texts("faults"),
        events=_events(contents, prefix),
    )


def read_truth(path: Path | str) -> Truth:
    """Read the truth that an emulated lamp wrote (`robolamp emulate --truth LOG`).

    Args:
        path: The log.

    Raises:
        FileError: The file cannot be read, is not MCAP, or holds no truth.
    """
    contents = read_contents(Path(path))
    base_times, base = contents.topic(
        TRUTH_BASE_TOPIC, TRUTH, "base_x", "base_z", "pitch", "clearance", "force", "fallen"
    )
    joint_times, joints = contents.topic(
        TRUTH_JOINTS_TOPIC, JOINT_STATE, "position", "velocity", "effort", first=("name",)
    )
    names = joints["name"][0]
    log_time = np.array(base_times, dtype=np.int64)
    rows, of_joints = _matched((log_time,), np.array(joint_times, np.int64))
    table = _Table(contents.path, base, rows, len(names))
    states = _Table(contents.path, joints, of_joints, len(names))
    return Truth(
        path=Path(path),
        truncated=contents.truncated,
        joints=tuple(names),
        log_time=log_time[rows],
        angle=states.rows("position"),
        velocity=states.rows("velocity"),
        torque=states.rows("effort"),
        base_x=table.numbers("base_x"),
        base_z=table.numbers("base_z"),
        pitch=table.numbers("pitch"),
        clearance=table.numbers("clearance"),
        force=table.numbers("force"),
        fallen=table.numbers("fallen").astype(np.bool_),
    )


_TICK_FIELDS = (
    "index", "phase", "scheduled", "began", "read_done", "write_done", "measured_at", "angle_age", "foot_force",
    "foot_age", "contact", "hops", "voltage", "temperature", "pwm", "torque", "hardware_error", "inputs", "outputs",
    "not_finite", "limited", "slewed", "faults",
)  # fmt: skip


def _nanoseconds(seconds: Array) -> NDArray[np.int64]:
    return np.rint(seconds * 1e9).astype(np.int64)


def _matched(keys: tuple[NDArray[np.int64], ...], *others: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    """Return which messages of several topics belong together: their rows, as many of each.

    A chunk of the file may begin or end between the messages of one tick; where one is lost, so is the tick.

    Args:
        keys: Times by which the first topic knows its messages in each of the others; one for all, or one for each.
        others: The other topics' log times.
    """
    if len(keys) == 1:
        keys = keys * len(others)
    if all(key.size == times.size and (key == times).all() for key, times in zip(keys, others, strict=True)):
        return (np.arange(keys[0].size),) * (1 + len(others))
    rows = np.arange(keys[0].size)
    for key, times in zip(keys, others, strict=True):
        rows = rows[np.isin(key[rows], times)]
    rows = rows[np.unique(keys[0][rows], return_index=True)[1]]
    places = [
        np.argsort(times, kind="stable")[np.searchsorted(np.sort(times, kind="stable"), key[rows])]
        for key, times in zip(keys, others, strict=True)
    ]
    return (rows, *places)


class _Table:
    """Rows of one topic's columns, as a run has them."""

    def __init__(self, path: Path, columns: dict[str, Any], rows: NDArray[np.int64], joints: int) -> None:
        self._path, self._columns, self._rows, self._joints = path, columns, rows, joints

    def numbers(self, name: str) -> Array:
        return self._columns[name][self._rows].astype(np.float64)

    def integers(self, name: str) -> NDArray[np.int64]:
        return self._columns[name][self._rows].astype(np.int64)

    def texts(self, name: str) -> list[Any]:
        column = self._columns[name]
        return [column[row] for row in self._rows.tolist()]

    def rows(self, name: str) -> Array:
        """One value a joint; a message without any is a row of NaN."""
        return self._fill(name, self._joints)

    def flags(self, name: str) -> NDArray[np.int64]:
        """One whole number a joint; a message without any is a row of -1, "unknown"."""
        return np.nan_to_num(self._fill(name, self._joints), nan=-1.0).astype(np.int64)

    def ragged(self, name: str) -> Array:
        """As many values as the longest message has; a message without any is a row of NaN."""
        return self._fill(name, self._columns[name].values.shape[1])

    def _fill(self, name: str, width: int) -> Array:
        column: Rows = self._columns[name]
        wrong = np.flatnonzero((column.lengths != 0) & (column.lengths != width))
        if wrong.size:
            raise FileError(
                f"message {wrong[0]}: {name} has {column.lengths[wrong[0]]} values, expected {width}", str(self._path)
            )
        values = column.values if width == column.values.shape[1] else np.empty((len(column.lengths), width))
        return np.where(column.lengths[:, None] == width, values, np.nan)[self._rows]


def _events(contents: Contents, prefix: str) -> list[tuple[int, str, str]]:
    topic = f"{prefix}/events"
    if not contents.has(topic, EVENT):
        return []
    times, events = contents.topic(topic, EVENT, "level", "text")
    return list(zip(times, events["level"], events["text"], strict=True))
