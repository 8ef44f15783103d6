"""Recordings of every kind are read, and what is wrong with one is named."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robolamp.calibrate.recordings import Recording, read_recording, read_recordings
from robolamp.calibrate.soundness import faults, require_sound
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
