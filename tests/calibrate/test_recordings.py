"""Recordings of every kind are read, and what is wrong with one is named."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robolamp.calibrate.servo.recordings import Recording, read_recording, read_recordings
from robolamp.calibrate.servo.soundness import faults, require_sound
from robolamp.errors import FileError, RobolampError
from tests.calibrate.bench_parts import MODEL, TRUTH, drop, record, steps, write_bam, write_csv

MADE = record(steps, seconds=1.5)


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    (found,) = read_recording(write_csv(tmp_path, MADE, "a.csv"))
    for name in ("time", "goal_time", "goal", "angle", "voltage", "temperature", "torque", "p_gain"):
        np.testing.assert_array_equal(getattr(found, name), getattr(MADE, name))
    assert (found.servo, found.mass, found.length, found.trajectory) == (MODEL, 0.49, 0.1, "steps")
    assert np.isnan(found.current).all()
    assert faults(found) == []


def test_a_recording_of_bam_is_read(tmp_path: Path) -> None:
    (found,) = read_recording(write_bam(tmp_path, MADE, "a.json"))
    assert (found.servo, found.source, found.mass) == (MODEL, "bam", 0.49)
    assert set(found.p_gain) == {400.0}
    np.testing.assert_allclose(found.pwm, -1 / 885)  # 65535 is -1
    assert (found.goal_time < found.time).all()  # the goal is sent before the sample is taken
    assert faults(found) == []


def test_a_folder_is_read_file_by_file(tmp_path: Path) -> None:
    write_csv(tmp_path, MADE, "b.csv")
    write_bam(tmp_path, MADE, "a.json")
    (tmp_path / "notes.txt").write_text("bench of Tuesday")
    assert [found.name for found in read_recordings([tmp_path])] == ["a.json", "b.csv"]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "", "no column time_s"),
        ("a.csv", "time_s,goal_rad\n", "no column angle_rad"),
        ("a.csv", "time_s,goal_rad,angle_rad,speed\n", "unknown column 'speed'"),
        ("a.csv", "time_s,goal_rad,angle_rad\n0,1\n", "line 2: 2 values, expected 3"),
        ("a.csv", "time_s,goal_rad,angle_rad\n0,one,1\n", "line 2: goal_rad: 'one' is not a number"),
        ("a.csv", "# mass = heavy\ntime_s,goal_rad,angle_rad\n", "mass: 'heavy' is not a number above 0"),
        ("a.csv", "# weight = 1\ntime_s,goal_rad,angle_rad\n", "unknown key 'weight'"),
        ("a.json", "{", "not valid JSON"),
        ("a.json", "[]", "no list of `entries`"),
        ("a.json", '{"entries": [{"timestamp": "now"}]}', "entries[0].timestamp: 'now' is not a number"),
        ("a.txt", "", "not a recording; expected one of .mcap, .json, .csv"),
    ],
)
def test_a_malformed_file_is_refused_in_one_line(tmp_path: Path, name: str, text: str, words: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(FileError) as caught:
        read_recording(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


@settings(max_examples=40)
@given(st.text(max_size=200))
def test_no_text_breaks_the_readers(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    folder = tmp_path_factory.mktemp("any")
    for name in ("a.csv", "a.json"):
        (folder / name).write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            read_recording(folder / name)
        except FileError as error:
            message = error.message
        else:
            message = ""
        assert "\n" not in message


def bent(**changed: np.ndarray) -> Recording:
    return dataclasses.replace(MADE, **changed)


def _with(values: np.ndarray, row: int, value: float) -> np.ndarray:
    values = values.copy()
    values[row] = value
    return values


def cut(rows: slice) -> Recording:
    fields = {name: value[rows] for name, value in vars(MADE).items() if isinstance(value, np.ndarray)}
    return dataclasses.replace(MADE, **fields)


@pytest.mark.parametrize(
    ("recording", "words"),
    [
        (cut(slice(0, 30)), "too short: 30 samples, expected 50 or more"),
        (cut(slice(0, 60)), "too short: 0.3"),
        (bent(angle=np.zeros_like(MADE.angle)), "constant: the angle moves 0.0 mrad"),
        (bent(angle=np.clip(MADE.angle, -9.0, 0.4)), "clipped: at "),
        (bent(time=MADE.time + (np.arange(len(MADE.time)) > 100) * 0.4), "a gap: no sample for 0.4"),
        (bent(time=_with(MADE.time, 100, 0.0)), "time goes backwards"),
        (bent(angle=_with(MADE.angle, 7, math.nan)), "not finite: angle of sample 7 is nan"),
        (bent(p_gain=np.full_like(MADE.p_gain, math.nan)), "the Position P Gain is not known"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_recording_is_named(recording: Recording, words: str) -> None:
    assert any(fault.startswith(words) for fault in faults(recording)), faults(recording)
    with pytest.raises(FileError, match=r"made\.csv"):
        require_sound([MADE, recording])


def test_an_arm_that_friction_holds_at_full_duty_is_sound() -> None:
    held = record(drop, {**TRUTH, "coulomb": 0.25}, seconds=2.5, p_gain=400.0)
    stands = held.angle == held.angle.max()
    assert stands.mean() > 0.3
    assert faults(held) == []


def test_recordings_that_do_not_belong_together_are_refused() -> None:
    require_sound([MADE])
    with pytest.raises(FileError, match="is of another servo: XL430-W250-T, expected XL330-M288-T"):
        require_sound([MADE, dataclasses.replace(MADE, servo="XL430-W250-T")])
    with pytest.raises(RobolampError, match="torque is off in every recording"):
        require_sound([bent(torque=np.zeros_like(MADE.torque))])
    with pytest.raises(RobolampError, match="no recording"):
        require_sound([])


def test_a_bam_file_without_numbers_names_the_entry(tmp_path: Path) -> None:
    path = write_bam(tmp_path, MADE, "a.json", kp="high")
    with pytest.raises(FileError, match="kp: 'high' is not a number above 0"):
        read_recording(path)
    data = json.loads(path.read_text())
    data["entries"][3]["position"] = "up"
    path.write_text(json.dumps(data))
    with pytest.raises(FileError, match=r"entries\[3\].position: 'up' is not a number"):
        read_recording(path)


HEADER = "time_s,goal_rad,angle_rad"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,goal_rad,angle_rad,angle_rad\n0,1,2,3\n", "line 1: the column angle_rad stands twice"),
        ("time_s;goal_rad;angle_rad\n0,1;1,0;1,0\n", "line 1: parted by semicolons or tabs; expected commas"),
        ("time_s\tgoal_rad\tangle_rad\n", "line 1: parted by semicolons or tabs"),
        (f"{HEADER}\n0,1,1,0,1,0\n", "line 2: 6 values, expected 3 (a comma inside a number?)"),
        (f'{HEADER}\n0,"1,5",1\n', "line 2: goal_rad: '1,5' is not a number"),
        (f"{HEADER}\n0,1_0,1\n", "line 2: goal_rad: '1_0' is not a number"),
        (f"{HEADER},torque\n0,1,1,\n", "line 2: torque: '' is not 0 or 1"),
        (f"{HEADER},torque\n0,1,1,64\n", "line 2: torque: '64' is not 0 or 1"),
        (f'{HEADER}\n"{"x" * 200_000}",1,1\n', "line 2: field larger than field limit"),
        (f"# mass = 1\n# mass = 2\n{HEADER}\n", "line 2: the key mass a second time"),
        (f"# mass = 0\n{HEADER}\n", "mass: '0' is not a number above 0"),
        (f"# mass = 0\n# arm_mass = -1\n{HEADER}\n", "arm_mass: '-1' is not 0 or a number above 0"),
    ],
)
def test_a_table_that_would_be_misread_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(FileError) as caught:
        read_recording(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def test_marks_and_capitals_are_read(tmp_path: Path) -> None:
    (tmp_path / "A.CSV").write_bytes(b"\xef\xbb\xbf" + write_csv(tmp_path, MADE, "x.txt").read_bytes())
    (tmp_path / "B.Json").write_bytes(b"\xef\xbb\xbf" + write_bam(tmp_path, MADE, "x.txt").read_bytes())
    found = read_recordings([tmp_path])
    assert [one.name for one in found] == ["A.CSV", "B.Json"]
    assert all(faults(one) == [] for one in found)


def test_what_a_folder_has_beside_recordings_is_told(tmp_path: Path) -> None:
    write_csv(tmp_path, MADE, "b.csv")
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "c.CSV.bak").write_text("")
    (tmp_path / "manifest.toml").write_text("")
    os.mkfifo(tmp_path / "pipe.csv")
    said: list[str] = []
    assert len(read_recordings([tmp_path], said.append)) == 1
    assert said == [f"{tmp_path}: left out, as no recordings (.mcap, .json, .csv): deep/c.CSV.bak, pipe.csv"]


def _units(**changed: Any) -> list[str]:
    return faults(dataclasses.replace(MADE, **changed))


TURN = 2 * math.pi
SPEED = np.gradient(MADE.angle, MADE.time)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"time": MADE.time * 1e3, "goal_time": MADE.goal_time * 1e3}, "milliseconds?"),
        ({"time": MADE.time * 1e6, "goal_time": MADE.goal_time * 1e6}, "milliseconds?"),
        ({"goal_time": MADE.goal_time * 1e3}, "the times of goals go backwards, or away"),
        ({"goal_time": MADE.goal_time[::-1].copy()}, "the times of goals go backwards, or away"),
        ({"angle": MADE.angle % TURN}, "the angle jumps by"),
        ({"angle": MADE.angle % TURN, "goal": MADE.goal % TURN}, "the angle jumps by"),
        ({"goal": MADE.goal % TURN}, "the goal jumps by"),
        ({"angle": (6 * MADE.angle + math.pi) % TURN - math.pi}, "the angle jumps by"),
        ({"angle": np.degrees(MADE.angle), "goal": np.degrees(MADE.goal)}, "degrees, or counts?"),
        ({"angle": np.degrees(MADE.angle) % 360}, "degrees, or counts?"),
        ({"goal": MADE.goal * 4096 / TURN}, "degrees, or counts?"),
        ({"angle": MADE.angle + 1.2 * math.pi}, "from its goal on the whole"),
        ({"angle": MADE.angle + math.pi}, "from its goal on the whole"),
        ({"angle": MADE.angle - math.pi}, "from its goal on the whole"),
        ({"mass": 200.0}, "mass is 200 kg, expected 5 kg or less: are these grams?"),
        ({"arm_mass": 100.0}, "arm_mass is 100 kg"),
        ({"length": 100.0}, "length is 100 m, expected 1 m or less: are these millimetres?"),
        ({"p_gain": MADE.p_gain / 128}, "the Position P Gain is"),
        ({"p_gain": MADE.p_gain * 1000}, "expected a whole number up to 16383"),
        ({"voltage": np.full_like(MADE.time, 73.0)}, "the supply reads 73 V"),
        ({"voltage": _with(MADE.voltage, 9, 0.0)}, "the supply reads 0 V"),
        ({"velocity": np.degrees(SPEED)}, "the velocity is 57.3 times"),
        ({"velocity": SPEED / TURN}, "the velocity is 0.159 times"),
        ({"velocity": -SPEED}, "the velocity is -1 times"),
    ],
)  # fmt: skip
def test_other_units_and_angles_that_begin_anew_are_named(changed: dict[str, Any], words: str) -> None:
    found = _units(**changed)
    assert any(words in fault for fault in found), found
    assert not any("\n" in fault for fault in found)


def test_a_velocity_as_read_is_sound() -> None:
    assert _units(velocity=SPEED) == []
    assert _units(velocity=np.zeros_like(SPEED)) == []  # not measured
    assert _units(velocity=np.full_like(SPEED, math.nan)) == []


@pytest.mark.parametrize("arm", [0.1, 0.0])
@pytest.mark.parametrize("kind", ["bam", "csv"])
def test_the_mass_of_the_arm_is_read(tmp_path: Path, kind: str, arm: float) -> None:
    made = dataclasses.replace(MADE, mass=0.49, arm_mass=arm)
    path = (
        write_bam(tmp_path, made, "a.json", arm_mass=arm)
        if kind == "bam"
        else write_csv(tmp_path, made, "a.csv", arm_mass=arm)
    )
    (found,) = read_recording(path)
    assert (found.mass, found.arm_mass, faults(found)) == (0.49, arm, [])


def test_an_arm_may_be_all_there_is(tmp_path: Path) -> None:
    (found,) = read_recording(write_bam(tmp_path, MADE, "a.json", mass=0.0, arm_mass=0.016))
    assert (found.mass, found.arm_mass, found.pendulum) == (0.0, 0.016, True)
    for arm in ({}, {"arm_mass": 0.0}):
        with pytest.raises(FileError, match=r"mass: 0\.0 is not a number above 0"):
            read_recording(write_bam(tmp_path, MADE, "a.json", mass=0.0, **arm))
    for arm in (-0.1, "much", math.nan, True):
        with pytest.raises(FileError, match=r"arm_mass: .* is not 0 or a number above 0"):
            read_recording(write_bam(tmp_path, MADE, "a.json", arm_mass=arm))


def _entries(path: Path, **changed: object) -> Path:
    data = json.loads(path.read_text())
    for name, value in changed.items():
        for entry in data["entries"]:
            if value is None:
                del entry[name]
            else:
                entry[name] = value
    path.write_text(json.dumps(data))
    return path


@pytest.mark.filterwarnings("error")
def test_bam_without_load_or_voltage(tmp_path: Path) -> None:
    (found,) = read_recording(_entries(write_bam(tmp_path, MADE, "a.json"), load=None))
    assert np.isnan(found.pwm).all()
    (found,) = read_recording(_entries(write_bam(tmp_path, MADE, "a.json"), input_volts=None))
    assert set(found.voltage) == {7.4}  # vin
    (found,) = read_recording(_entries(write_bam(tmp_path, MADE, "a.json"), load=30_000))
    assert np.isnan(found.pwm).all()


def test_keys_of_bam_that_are_not_known_are_noted(tmp_path: Path) -> None:
    (found,) = read_recording(write_bam(tmp_path, MADE, "a.json", arm_inertia=1.0, dt=0.005))
    assert found.notes == ("keys that robolamp does not know, left out: 'arm_inertia'",)


def test_what_is_missing_is_noted_or_refused_and_never_a_zero(tmp_path: Path) -> None:
    path = write_bam(tmp_path, MADE, "a.json")
    data = json.loads(path.read_text())
    for entry in data["entries"][10:15]:
        entry["input_volts"] = math.nan
    path.write_text(json.dumps(data))
    said: list[str] = []
    read_recordings([path], said.append)
    count = len(MADE.time)
    assert said == [f"a.json: 5 of {count} samples without a voltage: the median of the others is taken for it"]
    for name, value in (("torque_enable", None), ("torque_enable", math.nan), ("position", None), ("timestamp", True)):
        bad = json.loads(path.read_text())
        if value is None:
            del bad["entries"][7][name]
        else:
            bad["entries"][7][name] = value
        (tmp_path / "b.json").write_text(json.dumps(bad))
        with pytest.raises(FileError, match=rf"entries\[7\]\.{name}: "):
            read_recording(tmp_path / "b.json")
    for value in (10**400, 1e999):
        (tmp_path / "b.json").write_text(json.dumps({**data, "mass": value}))
        with pytest.raises(FileError, match=r"mass: .* is not a number above 0"):
            read_recording(tmp_path / "b.json")


@settings(max_examples=60)
@given(st.data())
def test_no_change_of_a_sound_file_breaks_the_readers(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("bent")
    short = cut(slice(0, 60))
    for path in (write_csv(folder, short, "a.csv"), write_bam(folder, short, "a.json")):
        raw = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            at = data.draw(st.integers(0, len(raw) - 1))
            raw[at : at + data.draw(st.integers(0, 9))] = data.draw(st.binary(max_size=9))
        path.write_bytes(raw)
        message = ""
        try:
            for recording in read_recording(path):
                message = " ".join(faults(recording))
        except FileError as error:
            message = error.message
        assert "\n" not in message
