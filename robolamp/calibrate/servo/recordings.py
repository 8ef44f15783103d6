"""Recordings of one servo each, whatever made them: robolamp's logs, BAM's recorder, or a table of numbers.

    *.mcap   a log of robolamp: one recording a joint; of a servo's bench, with its pendulum
    *.json   Rhoban/bam: `mass`, `arm_mass`, `length`, `kp`, `trajectory`, and `entries` with `timestamp`,
             `goal_position`, `position`, `speed`, `load`, `input_volts` (without them, `vin`), `temp`, `torque_enable`
    *.csv    columns time_s, goal_rad, angle_rad, and where known those of COLUMNS; lines `# key = value` before the
             header give `servo`, `joint`, `p_gain`, `mass` and `arm_mass` [kg] and `length` [m]

Endings are taken in capitals, too. What is left out of a recording is noted in it; of a folder it is told.
`robolamp.calibrate.servo.soundness` says what is wrong with one.
"""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.manifest import NAME as MANIFEST
from robolamp.calibrate.servo.recording_table import parse_table
from robolamp.dynamixel.registers import FULL_PWM
from robolamp.dynamixel.wire_time import wire_time
from robolamp.errors import FileError
from robolamp.files import all_below, is_file, kind_of, parse_json, parse_toml, read_text, sha256, shown, suffix_of
from robolamp.log.reader import Run, read_run

Array = NDArray[np.float64]

SUFFIXES = (".mcap", ".json", ".csv")
"""Of the files that hold recordings."""

_LISTED = 10  # names in a line

# Rhoban/bam's recorder writes the goal, sleeps 1 ms, reads everything and stamps the middle of the read [s]. A cycle of
# its recordings with torque off (no write, no sleep) takes 3.46 ms: half of that, and the sleep.
_BAM_GOAL_LEAD = 0.0028
_BAM_SERVOS = {
    "xl330": "XL330-M288-T",
    "xl330-m288": "XL330-M288-T",
    "xl330-m077": "XL330-M077-T",
    "xl430": "XL430-W250-T",
}
_BAM_KEYS = ("mass", "arm_mass", "length", "kp", "vin", "motor", "trajectory", "entries", "dt")


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
        arm_mass: Of the pendulum's arm, an even rod [kg].
        trajectory: What was played; empty where the file does not say.
        release: When torque went off for good, where that is known more exactly than `torque` tells [s]; else infinite.
        notes: What was left out or filled in, one line each.
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
    arm_mass: float = 0.0
    trajectory: str = ""
    release: float = math.inf
    notes: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0]) if len(self.time) else 0.0

    @property
    def pendulum(self) -> bool:
        """Whether the servo turned a pendulum of known weight."""
        return self.mass is not None and self.length is not None


def read_recordings(paths: Iterable[Path], told: Callable[[str], None] = lambda _text: None) -> list[Recording]:
    """Read every recording of files and folders (all files in them, and below, that may hold one).

    Args:
        paths: Files or folders.
        told: Called with a line for whatever is left out or filled in: of a folder, of a recording.

    Returns:
        In the order given, folders in the order of their files' names; a file given twice counts once.

    Raises:
        FileError: A file is missing or malformed, or a folder holds no recording.
    """
    found: dict[Path, None] = {}
    for path in paths:
        if kind_of(path) != "a folder":
            found[path] = None
            continue
        inside = [item for item in all_below(path) if not item.name.startswith(".")]
        kept = [item for item in inside if suffix_of(item) in SUFFIXES and kind_of(item) == "file"]
        if not kept:
            raise FileError(f"holds no recording ({', '.join(SUFFIXES)})", str(path))
        others = [str(item.relative_to(path)) for item in inside if item not in kept and item.name != MANIFEST]
        if others:
            told(f"{path}: left out, as no recordings ({', '.join(SUFFIXES)}): {_listed(others)}")
        found.update(dict.fromkeys(kept))
    recordings = [recording for path in found for recording in read_recording(path)]
    for recording in recordings:
        for note in recording.notes:
            told(f"{recording.name}: {note}")
    return recordings


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def read_recording(path: Path) -> list[Recording]:
    """Read one file: one recording, or of a log one for each joint.

    Raises:
        FileError: The file is missing or malformed.
    """
    if not is_file(path):
        raise FileError("no such file", str(path))
    if suffix_of(path) == ".mcap":
        found = _read_log(path)
    elif suffix_of(path) == ".json":
        found = [_read_bam(path)]
    elif suffix_of(path) == ".csv":
        found = [_read_csv(path)]
    else:
        raise FileError(f"not a recording; expected one of {', '.join(SUFFIXES)}", str(path))
    return [replace(recording, notes=(*recording.notes, *_filled(recording))) for recording in found]


def _filled(recording: Recording) -> list[str]:
    """Return notes of readings that are missing here and there, and what stands for them."""
    count, notes = len(recording.time), []
    for name, stands in (("voltage", "the median of the others"), ("temperature", "the reference temperature")):
        missing = int(np.count_nonzero(~np.isfinite(getattr(recording, name))))
        if 0 < missing < count:
            notes.append(f"{missing} of {count} samples without a {name}: {stands} is taken for it")
    return notes


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
        missed = int(np.count_nonzero(~measured))
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
                arm_mass=bench.get("arm_mass", 0.0),
                release=release,
                notes=(f"{missed} of {measured.size} samples left out: the servo did not answer",) if missed else (),
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
    described = parse_toml(lamp, f"{path}, the lamp's description")
    try:
        joints = {
            joint["name"]: (str(joint["servo"]), float(joint["position_p_gain"]))
            for joint in described.get("joint", [])
        }
        bench = {}
        if "pendulum" in described:
            bench = {key: float(described["pendulum"][key]) for key in ("mass", "length")}
            bench["arm_mass"] = float(described["pendulum"].get("arm_mass", 0.0))
            bench["baud"] = float(described["bus"]["baud"])
            known = all(0 <= value < math.inf for value in bench.values())
            if len(joints) != 1 or not known or not (bench["mass"] or bench["arm_mass"]) or not bench["length"]:
                raise ValueError
    except (ValueError, OverflowError, KeyError, TypeError, AttributeError):
        raise FileError("the lamp's description in the log is malformed", str(path)) from None
    return joints, bench


def _read_bam(path: Path) -> Recording:
    text = read_text(path)
    data = parse_json(text, str(path))
    entries = data.get("entries") if isinstance(data, dict) else None
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise FileError("no list of `entries`; expected a recording of Rhoban/bam", str(path))
    count = len(entries)

    def column(name: str, default: float | None = None) -> Array:
        given = [name in entry for entry in entries]
        if default is not None and not any(given):
            return np.full(count, default)
        values = []
        for row, entry in enumerate(entries):
            value = entry.get(name, None if default is None else math.nan)
            legal = isinstance(value, int | float) and (name == "torque_enable" or not isinstance(value, bool))
            if not legal or abs(value) > sys.float_info.max:
                raise FileError(f"entries[{row}].{name}: {shown(value)} is not a number", str(path))
            values.append(float(value))
        return np.array(values)

    def number(name: str, *, zero: bool = False, default: float | None = None) -> float:
        value = data.get(name, default)
        legal = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= sys.float_info.max
        if not legal or (value == 0 and not zero):
            raise FileError(f"{name}: {shown(value)} is not {'0 or ' if zero else ''}a number above 0", str(path))
        return float(value)

    load = column("load", math.nan)
    # Unsigned as read. For an XL330 it is the Present PWM: 885 at most, and P Gain / 256 times the error.
    load = np.where(load > 0x7FFF, load - 0x10000, load)
    time, torque = column("timestamp"), column("torque_enable", 1.0)
    if not np.isin(torque, (0.0, 1.0)).all():
        row = int(np.flatnonzero(~np.isin(torque, (0.0, 1.0)))[0])
        raise FileError(f"entries[{row}].torque_enable: {torque[row]:g} is not true or false", str(path))
    motor, arm_mass = str(data.get("motor", "")), number("arm_mass", zero=True, default=0.0)
    unknown = [shown(key) for key in data if key not in _BAM_KEYS]
    return Recording(
        name=path.name,
        path=path,
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        source="bam",
        servo=_BAM_SERVOS.get(motor.lower(), motor),
        joint="",
        time=time,
        goal_time=time - _BAM_GOAL_LEAD,
        goal=column("goal_position"),
        angle=column("position"),
        velocity=column("speed", math.nan),
        current=np.full(count, math.nan),
        pwm=np.where((np.abs(load) > FULL_PWM).any(), math.nan, load / FULL_PWM),
        voltage=column("input_volts", number("vin", default=math.nan) if "vin" in data else math.nan),
        temperature=column("temp", math.nan),
        torque=torque == 1.0,
        p_gain=np.full(count, number("kp")),
        mass=number("mass", zero=arm_mass > 0.0),
        length=number("length"),
        arm_mass=arm_mass,
        trajectory=str(data.get("trajectory", "")),
        notes=(f"keys that robolamp does not know, left out: {', '.join(unknown)}",) if unknown else (),
    )


def _read_csv(path: Path) -> Recording:
    text = read_text(path)
    table = parse_table(text, path)
    columns, gain, arm_mass = table.columns, table.positive("p_gain"), table.positive("arm_mass", zero=True) or 0.0
    return Recording(
        name=path.name,
        path=path,
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        source="csv",
        servo=table.keys.get("servo", ""),
        joint=table.keys.get("joint", ""),
        time=columns["time_s"],
        goal_time=columns.get("goal_time_s", columns["time_s"]),
        goal=columns["goal_rad"],
        angle=columns["angle_rad"],
        velocity=table.column("velocity_rad_s", math.nan),
        current=table.column("current_a", math.nan),
        pwm=table.column("duty", math.nan),
        voltage=table.column("voltage_v", math.nan),
        temperature=table.column("temperature_c", math.nan),
        torque=table.column("torque", 1.0) == 1.0,
        p_gain=table.column("p_gain", math.nan if gain is None else gain),
        mass=table.positive("mass", zero=arm_mass > 0.0),
        length=table.positive("length"),
        arm_mass=arm_mass,
        trajectory=table.keys.get("trajectory", ""),
    )
