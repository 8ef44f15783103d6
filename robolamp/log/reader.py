"""Reads a log into numpy arrays: a run (twin, emulated or physical lamp), or the truth of an emulated one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import FileError, RobolampError
from robolamp.files import parse_toml
from robolamp.log.cdr import Rows
from robolamp.log.mcap_stream import Contents, read_contents
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

if TYPE_CHECKING:
    import pandas

Array = NDArray[np.float64]

STEP = 0.1
"""Change of a log's time stamps against the run's own clock from which on somebody set the computer's clock [s]: NTP
slews what is less than 0.128 s (ntpd(8), "step threshold") at 500 ppm at most, 0.01 ms a tick."""

_TIMES = ("scheduled", "read_done", "write_done", "measured_at")  # of a tick, beside when it began
_NEAR = 60.0  # of a tick's times to its beginning [s]: chosen; a loop that is so late has long ended its run
_LONGEST = 86_400.0  # chosen: a day; the longest run has 600 s and its pauses [s]

_LARGEST = 1e6  # chosen: no number of a run's context is as large, whatever its unit
_GRID = 0.001  # control periods by which a tick may be off its schedule's grid by rounding


@dataclass(repr=False)
class Run:
    """A run of N ticks of a lamp with n joints. Times are on the run's own clock [s]; a missing value is NaN.

    Attributes:
        path: The log.
        context: The run's context (see `robolamp.log.run_context`).
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
        """Return the run as a table, a row a tick (`robolamp.log.run_table.columns_of`), its context in `attrs`.

        Raises:
            RobolampError: pandas is not installed.
        """
        from robolamp.log.run_table import columns_of  # noqa: PLC0415 (which reads runs, too)

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

    def number(self, key: str, above: float = -math.inf) -> float:
        """Return a number of the context; NaN where it has none, or one that no run has: logs get edited.

        Args:
            key: Its name.
            above: What it is more than in any run.
        """
        try:
            value = float(self.context[key])
        except (KeyError, ValueError):
            return math.nan
        return value if abs(value) < _LARGEST and value > above else math.nan

    @property
    def control_period(self) -> float:
        """Time from tick to tick [s]: as the context says, else the median of the schedule; NaN for one tick."""
        told = self.number("control_period", above=0.0)
        if math.isfinite(told):
            return told
        return float(np.median(np.diff(self.scheduled))) if self.scheduled.size > 1 else math.nan

    @property
    def goal_m(self) -> float:
        """Where the lamp was sent [m]; NaN where the log does not say."""
        return self.number("goal_m")

    @property
    def answer_wire(self) -> float:
        """How long a reading's packets are on the line [s]; NaN where the log does not say."""
        return self.number(ANSWER_WIRE, above=0.0)

    @property
    def missed_ticks(self) -> int:
        """Slots of the schedule in which no tick ran; while the servos were gone there was no schedule."""
        missed = 0
        for part in np.split(self.scheduled, self.restarts):
            slots = round((part[-1] - part[0]) / self.control_period) + 1 if part.size > 1 else part.size
            missed += max(0, slots - part.size)
        return missed

    @property
    def restarts(self) -> NDArray[np.int64]:
        """Ticks at which the schedule began anew, because the servos had been gone and came back."""
        slots = np.diff(self.scheduled) / self.control_period
        off_grid = (slots > 1.5) & (np.abs(slots - np.rint(slots)) > _GRID)
        return np.flatnonzero((self.phase[1:] == "start") & ((self.phase[:-1] != "start") | off_grid)) + 1

    @property
    def clock_steps(self) -> list[tuple[int, float]]:
        """Where the clock that stamped the messages was set: tick, and by how much against the run's own clock [s]."""
        off = np.diff(self.log_time) * 1e-9 - np.diff(self.write_done)
        return [(int(row) + 1, float(off[row])) for row in np.flatnonzero(np.abs(off) > STEP)]

    @property
    def sampled_at(self) -> Array:
        """When each angle was sampled, shape (N, n) [s]."""
        return self.measured_at[:, None] - self.angle_age

    def at(self, log_time: NDArray[np.int64]) -> Array:
        """Return wall-clock stamps as times on the run's clock [s], each by the tick stamped nearest to it.

        Where that clock was set back stamps come twice: stamps that step back are of the ticks after such a step.

        Args:
            log_time: Nanoseconds since the epoch, as they followed each other.
        """
        ticks = np.arange(self.log_time.size)
        parts = np.split(ticks, [row for row, by in self.clock_steps if by < 0.0])
        back = np.diff(log_time, prepend=log_time[:1]) < -STEP * 1e9
        turns = np.minimum(np.cumsum(back), len(parts) - 1)
        found = np.empty(log_time.size)
        for turn in np.unique(turns).tolist():
            which = turns == turn
            stamps = log_time[which]
            own = parts[turn][_nearest(self.log_time[parts[turn]], stamps)]
            rest = ticks[parts[turn][0] :]
            any_of = rest[_nearest(self.log_time[rest], stamps)]
            tick = np.where(np.abs(stamps - self.log_time[own]) <= STEP * 1e9, own, any_of)
            found[which] = self.write_done[tick] + (stamps - self.log_time[tick]) * 1e-9
        return found


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
        force: Largest floor force on the foot since the sample before, shape (M,) [N]; 0.1.0 wrote that of the moment.
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
    goal_times, goals = contents.topic(f"{prefix}/goals", JOINT_STATE, "name", "position")
    seen_times, seen = contents.topic(f"{prefix}/measured", JOINT_STATE, "name", "position", "velocity", "effort")
    context = contents.metadata.get(METADATA, {})
    joints = _joints(context, goals["name"][0])
    if len(set(joints)) != len(joints):
        raise FileError(f"names the same joint twice: {', '.join(joints)}", str(contents.path))
    _check_times(contents.path, ticks)
    log_time = np.array(tick_times, dtype=np.int64)
    stamps = log_time - _nanoseconds(ticks["write_done"]) + _nanoseconds(ticks["measured_at"])
    rows, of_goals, of_seen = _matched(
        ticks["index"], (log_time, stamps), np.array(goal_times, np.int64), np.array(seen_times, np.int64)
    )
    if not rows.size:
        raise FileError(
            "holds no whole tick: goals, measurements and the rest are of different times", str(contents.path)
        )
    table = _Table(contents.path, ticks, rows, len(joints))
    sent = _States(contents.path, f"{prefix}/goals", goals, of_goals, joints)
    measured = _States(contents.path, f"{prefix}/measured", seen, of_seen, joints)
    began = table.numbers("began")
    back = np.flatnonzero(~(np.diff(began) >= 0.0))
    if back.size:
        row = int(back[0])
        raise FileError(
            f"its own clock does not go on: tick {int(table.integers('index')[row + 1])} began at "
            f"{began[row + 1]:.3f} s, the one before at {began[row]:.3f} s",
            str(contents.path),
        )
    return Run(
        path=contents.path,
        context=context,
        truncated=contents.truncated,
        joints=tuple(joints),
        log_time=log_time[rows],
        index=table.integers("index"),
        phase=np.array(table.texts("phase"), dtype=np.str_),
        scheduled=table.numbers("scheduled"),
        began=began,
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
    joint_times, joints = contents.topic(TRUTH_JOINTS_TOPIC, JOINT_STATE, "name", "position", "velocity", "effort")
    names = joints["name"][0]
    log_time = np.array(base_times, dtype=np.int64)
    rows, of_joints = _matched(np.arange(log_time.size), (log_time,), np.array(joint_times, np.int64))
    table = _Table(contents.path, base, rows, len(names))
    states = _States(contents.path, TRUTH_JOINTS_TOPIC, joints, of_joints, names)
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


def _nearest(known: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return which of some times is nearest to each wanted one."""
    order = np.argsort(known, kind="stable")
    ordered = known[order]
    after = np.minimum(np.searchsorted(ordered, wanted), known.size - 1)
    before = np.maximum(after - 1, 0)
    return order[np.where(wanted - ordered[before] < ordered[after] - wanted, before, after)]


def _nanoseconds(seconds: Array) -> NDArray[np.int64]:
    return np.rint(seconds * 1e9).astype(np.int64)


def _joints(context: dict[str, str], named: Sequence[str]) -> tuple[str, ...]:
    """Return the joints in the order of the lamp's description, in which a tick's arrays are; else as they are named.

    Args:
        context: The run's.
        named: Names of the joints, as the goals have them.
    """
    try:
        described = tuple(str(joint["name"]) for joint in parse_toml(context.get("lamp", ""), "").get("joint", ()))
    except (FileError, TypeError, KeyError, AttributeError):
        described = ()
    return described if sorted(described) == sorted(named) else tuple(named)


def _check_times(path: Path, ticks: dict[str, Any]) -> None:
    """Refuse ticks without a valid time, and two with one number: leaving some out would not make them right."""
    index, began = ticks["index"].astype(np.int64), ticks["began"].astype(np.float64)
    if began.size < 2:  # there is nothing that they could contradict
        return
    wrong = np.flatnonzero(~np.isfinite(began))
    if wrong.size:
        raise FileError(f"tick {index[wrong[0]]} began at {began[wrong[0]]} s; expected a time", str(path))
    for name in _TIMES:
        times = ticks[name].astype(np.float64)
        far = np.flatnonzero(~(np.abs(times - began) <= _NEAR))
        if far.size:
            row = int(far[0])
            raise FileError(
                f"tick {index[row]} began at {began[row]:g} s, and its {name} is {times[row]:g} s; expected no more "
                f"than {_NEAR:g} s between them",
                str(path),
            )
    if began.size and np.ptp(began) > _LONGEST:
        raise FileError(f"lasts {np.ptp(began):g} s; expected the log of one run, {_LONGEST:g} s at most", str(path))
    order = np.lexsort((began, index))
    twice = np.flatnonzero((np.diff(index[order]) == 0) & (np.diff(began[order]) != 0.0))
    if twice.size:
        one, other = order[twice[0]], order[twice[0] + 1]
        raise FileError(
            f"two ticks are number {index[one]}: one began at {began[one]:.3f} s, one at {began[other]:.3f} s",
            str(path),
        )


def _matched(
    index: NDArray[Any], keys: tuple[NDArray[np.int64], ...], *others: NDArray[np.int64]
) -> tuple[NDArray[np.int64], ...]:
    """Return which messages of several topics belong together: their rows, as many of each, in the order of `index`.

    A chunk of the file may begin or end between the messages of one tick; where one is lost, so is the tick. Times may
    step where somebody set the clock, so that they give no order.

    Args:
        index: What counts the first topic's messages; of two alike the first is taken.
        keys: Times by which the first topic knows its messages in each of the others; one for all, or one for each.
        others: The other topics' log times.
    """
    if len(keys) == 1:
        keys = keys * len(others)
    rows = np.arange(keys[0].size)
    alike = all(key.size == times.size and (key == times).all() for key, times in zip(keys, others, strict=True))
    if alike and (np.diff(index.astype(np.int64)) > 0).all():
        return (rows,) * (1 + len(others))
    for key, times in zip(keys, others, strict=True):
        rows = rows[np.isin(key[rows], times)]
    rows = rows[np.unique(index[rows], return_index=True)[1]]
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


class _States:
    """Rows of a JointState topic's columns, one value for each joint, by name, in any order of the message."""

    def __init__(
        self, path: Path, topic: str, columns: dict[str, Any], rows: NDArray[np.int64], joints: Sequence[str]
    ) -> None:
        self._table = _Table(path, columns, rows, len(joints))
        names: list[tuple[str, ...]] = columns["name"]
        self._order: dict[tuple[str, ...], list[int]] = {}
        for named in set(names):
            if sorted(named) != sorted(joints):
                raise FileError(f"{topic} is of joints {', '.join(named)}; expected {', '.join(joints)}", str(path))
            self._order[named] = [named.index(joint) for joint in joints]
        self._names = [names[row] for row in rows.tolist()]

    def rows(self, name: str) -> Array:
        values = self._table.rows(name)
        if len(self._order) == 1:
            return values[:, next(iter(self._order.values()))]
        return np.take_along_axis(values, np.array([self._order[named] for named in self._names]), axis=1)


def _events(contents: Contents, prefix: str) -> list[tuple[int, str, str]]:
    topic = f"{prefix}/events"
    if not contents.has(topic, EVENT):
        return []
    times, events = contents.topic(topic, EVENT, "level", "text")
    return list(zip(times, events["level"], events["text"], strict=True))
