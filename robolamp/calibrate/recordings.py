"""Recordings of one servo each, whatever made them: robolamp's logs, BAM's recorder, or a table of numbers.

    *.mcap   a log of robolamp: one recording a joint; of a servo's bench, with its pendulum
    *.json   Rhoban/bam: `mass`, `length`, `kp`, `trajectory`, and `entries` with `timestamp`, `goal_position`,
             `position`, `speed`, `load`, `input_volts`, `temp`, `torque_enable`
    *.csv    columns time_s, goal_rad, angle_rad, and where known those of COLUMNS; lines `# key = value` before the
             header give `servo`, `joint`, `p_gain`, `mass` [kg] and `length` [m]

`robolamp.calibrate.soundness` says what is wrong with one.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.wire import wire_time
from robolamp.errors import FileError
from robolamp.files import read_text, sha256
from robolamp.log.reader import Run, read_run

Array = NDArray[np.float64]

SUFFIXES = (".mcap", ".json", ".csv")
"""Of the files that hold recordings."""

FULL_DUTY = 885.0
"""PWM counts of full duty (e-manual, "PWM Limit")."""

COUNTS_PER_RADIAN = 4096 / (2 * math.pi)
"""Of the encoder (e-manual, "Present Position")."""

# Rhoban/bam's recorder writes the goal, sleeps 1 ms, reads everything and stamps the middle of the read [s]. A cycle of
# its recordings with torque off (no write, no sleep) takes 3.46 ms: half of that, and the sleep.
_BAM_GOAL_LEAD = 0.0028
_BAM_SERVOS = {
    "xl330": "XL330-M288-T",
    "xl330-m288": "XL330-M288-T",
    "xl330-m077": "XL330-M077-T",
    "xl430": "XL430-W250-T",
}


@dataclass(frozen=True)
class Recording:
    """What one servo was told and did, k samples; a value that is not known is NaN.

    Attributes:
        name: Of the file, with "#joint" where the file holds several joints.
        path: The file.
        sha256: Of the file.
        source: "log", "bam" or "csv".
        servo: Servo model, as "XL330-M288-T"; empty where the file does not say.
        joint: Joint name; empty on a bench.
        time: When each angle was sampled, increasing, shape (k,) [s].
        goal_time: When each goal was sent to the servo, shape (k,) [s].
        goal: Goals, each in force from its `goal_time` to the next one's, shape (k,) [rad].
        angle: Measured, shape (k,) [rad].
        velocity: Measured, shape (k,) [rad/s].
        current: Present Current, shape (k,) [A].
        pwm: Duty, -1 to 1, shape (k,).
        voltage: Supply voltage as read, shape (k,) [V].
        temperature: Shape (k,) [degC].
        torque: Torque Enable, shape (k,).
        p_gain: Position P Gain register (84), shape (k,).
        mass: Of the pendulum's weight [kg]; None: not on a pendulum bench. Angle 0 is hanging straight down.
        length: From the shaft to the weight [m].
        trajectory: What was played; empty where the file does not say.
        release: When torque went off for good, where that is known more exactly than `torque` tells [s]; else infinite.
    """

    name: str
    path: Path
    sha256: str
    source: str
    servo: str
    joint: str
    time: Array = field(repr=False)
    goal_time: Array = field(repr=False)
    goal: Array = field(repr=False)
    angle: Array = field(repr=False)
    velocity: Array = field(repr=False)
    current: Array = field(repr=False)
    pwm: Array = field(repr=False)
    voltage: Array = field(repr=False)
    temperature: Array = field(repr=False)
    torque: NDArray[np.bool_] = field(repr=False)
    p_gain: Array = field(repr=False)
    mass: float | None = None
    length: float | None = None
    trajectory: str = ""
    release: float = math.inf

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0]) if len(self.time) else 0.0

    @property
    def pendulum(self) -> bool:
        """Whether the servo turned a pendulum of known weight."""
        return self.mass is not None and self.length is not None


COLUMNS: Mapping[str, str] = {
    "time_s": "when the angle was sampled",
    "goal_rad": "the goal",
    "angle_rad": "the angle",
    "goal_time_s": "when the goal was sent; without it, time_s",
    "velocity_rad_s": "measured velocity",
    "current_a": "Present Current",
    "duty": "Present PWM as a share of full duty, -1 to 1",
    "voltage_v": "supply voltage as read",
    "temperature_c": "temperature",
    "torque": "Torque Enable, 0 or 1; without it, 1",
    "p_gain": "Position P Gain register (84), where it is not one for the whole file",
}
"""Columns of a CSV recording; the first three are required."""


def read_recordings(paths: Iterable[Path]) -> list[Recording]:
    """Read every recording of files and folders (all files in them, and below, that may hold one).

    Args:
        paths: Files or folders.

    Returns:
        In the order given, folders in the order of their files' names; a file given twice counts once.

    Raises:
        FileError: A file is missing or malformed, or a folder holds no recording.
    """
    found: dict[Path, None] = {}
    for path in paths:
        if path.is_dir():
            inside = sorted(item for item in path.rglob("*") if item.suffix in SUFFIXES and item.is_file())
            if not inside:
                raise FileError(f"holds no recording ({', '.join(SUFFIXES)})", str(path))
            found.update(dict.fromkeys(inside))
        else:
            found[path] = None
    return [recording for path in found for recording in read_recording(path)]


def read_recording(path: Path) -> list[Recording]:
    """Read one file: one recording, or of a log one for each joint.

    Raises:
        FileError: The file is missing or malformed.
    """
    if not path.is_file():
        raise FileError("no such file", str(path))
    if path.suffix == ".mcap":
        return _read_log(path)
    if path.suffix == ".json":
        return [_read_bam(path)]
    if path.suffix == ".csv":
        return [_read_csv(path)]
    raise FileError(f"not a recording; expected one of {', '.join(SUFFIXES)}", str(path))


def _read_log(path: Path) -> list[Recording]:
    run = read_run(path)
    described, bench = _described(run.context.get("lamp", ""), path)
    # A recording session changes the gains that the lamp's description gives.
    gains = run.context.get("position_p_gain", "").split()
    if gains and (len(gains) != len(run.joints) or not all(gain.isdigit() for gain in gains)):
        raise FileError(f"position_p_gain: {' '.join(gains)!r} is not {len(run.joints)} whole numbers", str(path))
    digest, sampled, goal_time, release = sha256(path), run.sampled_at, run.write_done, math.inf
    if bench:
        # One servo: when its instructions arrive follows from the stamps and the time of their bytes.
        baud = int(bench["baud"])
        wire = wire_time("goals", 1, baud)
        goal_time, release = goal_time + wire, _release(run) + wire + wire_time("switch", 1, baud)
    recordings = []
    for column, joint in enumerate(run.joints):
        servo, p_gain = described.get(joint, ("", math.nan))
        measured = np.isfinite(run.angle[:, column])  # an answer that was missed is no sample
        rows = {
            "time": sampled[:, column],
            "goal_time": goal_time,
            "goal": run.goal[:, column],
            "angle": run.angle[:, column],
            "velocity": run.velocity[:, column],
            "current": run.current[:, column],
            "pwm": run.pwm[:, column],
            "voltage": run.voltage[:, column],
            "temperature": run.temperature[:, column],
            "torque": run.torque[:, column] == 1,
            "p_gain": np.full(len(run.index), float(gains[column]) if gains else p_gain),
        }
        recordings.append(
            Recording(
                name=path.name if bench else f"{path.name}#{joint}",
                path=path,
                sha256=digest,
                source="log",
                servo=servo,
                joint="" if bench else joint,
                trajectory=run.context.get("controller_name", ""),
                mass=bench.get("mass"),
                length=bench.get("length"),
                release=release,
                **{name: values[measured] for name, values in rows.items()},
            )
        )
    return recordings


def _release(run: Run) -> float:
    """Return when the last goal before torque went off had been sent [s]; infinite where torque stayed on."""
    limp = np.flatnonzero(run.phase == "limp")
    return float(run.write_done[limp[0] - 1]) if limp.size and limp[0] > 0 else math.inf


def _described(lamp: str, path: Path) -> tuple[dict[str, tuple[str, float]], dict[str, float]]:
    """Return servo model and P gain of each joint from a lamp's description as logs keep it, and a bench's numbers."""
    try:
        described = tomllib.loads(lamp)
        joints = {
            joint["name"]: (str(joint["servo"]), float(joint["position_p_gain"]))
            for joint in described.get("joint", [])
        }
        bench = {}
        if "pendulum" in described:
            bench = {key: float(described["pendulum"][key]) for key in ("mass", "length")}
            bench["baud"] = float(described["bus"]["baud"])
        if (len(joints) != 1 and bench) or any(not 0 < value < math.inf for value in bench.values()):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError):
        raise FileError("the lamp's description in the log is malformed", str(path)) from None
    return joints, bench


def _read_bam(path: Path) -> Recording:
    text = read_text(path)
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"not valid JSON: {error}", str(path)) from None
    entries = data.get("entries") if isinstance(data, dict) else None
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise FileError("no list of `entries`; expected a recording of Rhoban/bam", str(path))

    def column(name: str, default: float | None = None) -> Array:
        values = []
        for row, entry in enumerate(entries):
            value = entry.get(name, default)
            if not isinstance(value, int | float):
                raise FileError(f"entries[{row}].{name}: {value!r} is not a number", str(path))
            values.append(float(value))
        return np.array(values)

    def number(name: str) -> float:
        value = data.get(name)
        if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value) or value <= 0:
            raise FileError(f"{name}: {value!r} is not a number above 0", str(path))
        return float(value)

    load = column("load", math.nan)
    # Unsigned as read. For an XL330 it is the Present PWM: 885 at most, and P Gain / 256 times the error.
    load = np.where(load > 0x7FFF, load - 0x10000, load)
    time, count = column("timestamp"), len(entries)
    motor = str(data.get("motor", "")).lower()
    return Recording(
        name=path.name,
        path=path,
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        source="bam",
        servo=_BAM_SERVOS.get(motor, str(data.get("motor", ""))),
        joint="",
        time=time,
        goal_time=time - _BAM_GOAL_LEAD,
        goal=column("goal_position"),
        angle=column("position"),
        velocity=column("speed", math.nan),
        current=np.full(count, math.nan),
        pwm=load / FULL_DUTY if count and np.nanmax(np.abs(load)) <= FULL_DUTY else np.full(count, math.nan),
        voltage=column("input_volts", math.nan),
        temperature=column("temp", math.nan),
        torque=column("torque_enable", 1.0) > 0,
        p_gain=np.full(count, number("kp")),
        mass=number("mass"),
        length=number("length"),
        trajectory=str(data.get("trajectory", "")),
    )


_KEYS = ("servo", "joint", "p_gain", "mass", "length", "trajectory")


def _read_csv(path: Path) -> Recording:
    text = read_text(path)
    lines = text.splitlines()
    keys: dict[str, str] = {}
    start = 0
    for start, line in enumerate(lines):
        match = re.fullmatch(r"#\s*(\w+)\s*=\s*(.*?)\s*", line)
        if match and match[1] not in _KEYS:
            raise FileError(f"line {start + 1}: unknown key {match[1]!r}; expected {', '.join(_KEYS)}", str(path))
        if match:
            keys[match[1]] = match[2]
        elif line.strip() and not line.startswith("#"):
            break
    rows = list(csv.reader(io.StringIO("\n".join(lines[start:]))))
    header = [cell.strip() for cell in rows[0]] if rows else []
    for name in header:
        if name not in COLUMNS:
            raise FileError(f"line {start + 1}: unknown column {name!r}; expected {', '.join(COLUMNS)}", str(path))
    for name in list(COLUMNS)[:3]:
        if name not in header:
            raise FileError(f"line {start + 1}: no column {name}", str(path))
    numbers = _numbers(rows[1:], header, start + 2, path)
    columns = dict(zip(header, numbers.T, strict=True))
    count = len(numbers)

    def key(name: str) -> float | None:
        if name not in keys:
            return None
        try:
            value = float(keys[name])
        except ValueError:
            value = math.nan
        if not 0 < value < math.inf:
            raise FileError(f"{name}: {keys[name]!r} is not a number above 0", str(path))
        return value

    def known(name: str, default: float) -> Array:
        return columns.get(name, np.full(count, default))

    gain = key("p_gain")
    return Recording(
        name=path.name,
        path=path,
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        source="csv",
        servo=keys.get("servo", ""),
        joint=keys.get("joint", ""),
        time=columns["time_s"],
        goal_time=columns.get("goal_time_s", columns["time_s"]),
        goal=columns["goal_rad"],
        angle=columns["angle_rad"],
        velocity=known("velocity_rad_s", math.nan),
        current=known("current_a", math.nan),
        pwm=known("duty", math.nan),
        voltage=known("voltage_v", math.nan),
        temperature=known("temperature_c", math.nan),
        torque=known("torque", 1.0) > 0,
        p_gain=known("p_gain", math.nan if gain is None else gain),
        mass=key("mass"),
        length=key("length"),
        trajectory=keys.get("trajectory", ""),
    )


def _numbers(rows: Sequence[list[str]], header: list[str], first: int, path: Path) -> Array:
    numbers = []
    for line, row in enumerate(rows, first):
        if not row:
            continue
        if len(row) != len(header):
            raise FileError(f"line {line}: {len(row)} values, expected {len(header)}", str(path))
        try:
            numbers.append([float(cell) if cell.strip() else math.nan for cell in row])
        except ValueError as error:
            raise FileError(f"line {line}: {error}", str(path)) from None
    return np.array(numbers, dtype=np.float64).reshape(-1, len(header))
