"""What is logged is read back, by robolamp and by an independent reader."""

from __future__ import annotations

import math
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from robolamp.errors import FileError
from robolamp.log.reader import read_run, read_truth
from robolamp.log.schemas import JOINT_STATE, TRUTH, TRUTH_BASE_TOPIC, TRUTH_JOINTS_TOPIC, joint_state
from robolamp.log.writer import LogWriter
from robolamp.signals import Health, Observation, Tick

from .ticks import JOINTS, make_tick

CONTEXT = {"goal_m": "0.3", "control_period": "0.02", "terminals": "t a0 a1 s0", "controller": "(list 0 0 0) ; ü"}


def write(path: Path, count: int = 25) -> Path:
    with LogWriter(path, context=CONTEXT, joints=JOINTS, now=100.0) as log:
        for index in range(count):
            log.tick(make_tick(index))
        log.event("warning", "knee: hot", at=100.3)
    assert log.error == ""
    assert log.dropped == 0
    return path


def test_every_field_comes_back(tmp_path):
    run = read_run(write(tmp_path / "deep" / "run.mcap"))
    ticks = [make_tick(index) for index in range(25)]
    assert run.joints == JOINTS
    assert not run.truncated
    assert run.goal_m == 0.3
    assert run.control_period == 0.02
    assert run.terminals == ("t", "a0", "a1", "s0")
    assert run.context["controller"] == CONTEXT["controller"]
    for name in ("index", "scheduled", "began", "read_done", "write_done", "hops", "contact"):
        assert getattr(run, name).tolist() == [getattr(tick, name) for tick in ticks], name
    assert run.phase.tolist() == [tick.phase for tick in ticks]
    np.testing.assert_array_equal(run.goal, [tick.goal for tick in ticks])
    for name in ("angle", "velocity", "current", "angle_age"):
        np.testing.assert_array_equal(getattr(run, name), [getattr(tick.observation, name) for tick in ticks])
    for name in ("foot_force", "foot_age"):
        assert getattr(run, name).tolist() == [getattr(tick.observation, name) for tick in ticks]
    assert run.measured_at.tolist() == [tick.observation.time for tick in ticks]
    for name in ("voltage", "temperature", "pwm", "torque", "hardware_error"):
        np.testing.assert_array_equal(getattr(run, name), [getattr(tick.observation.health, name) for tick in ticks])
    assert run.interventions.tolist() == [[1, 2, index] for index in range(25)]
    assert np.isnan(run.inputs[:2]).all()
    assert run.inputs[2:].tolist() == [tick.inputs.tolist() for tick in ticks[2:]]
    assert run.outputs[2:].tolist() == [tick.outputs.tolist() for tick in ticks[2:]]
    assert run.faults == [tick.observation.faults for tick in ticks]
    [(when, level, text)] = run.events
    assert (level, text) == ("warning", "knee: hot")
    assert run.at(np.array([when]))[0] == pytest.approx(100.3, abs=1e-6)


def test_log_times_are_of_the_epoch(tmp_path):
    before = time.time()
    run = read_run(write(tmp_path / "run.mcap", 3))
    assert before - 1.0 < run.log_time[0] * 1e-9 < time.time() + 1.0
    np.testing.assert_allclose(run.at(run.log_time), run.write_done, atol=1e-6)


def test_an_independent_ros2_reader_understands_it(tmp_path):
    path = write(tmp_path / "run.mcap", 8)
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = list(reader.iter_decoded_messages())
        [(_, name)] = [(record.metadata, record.name) for record in reader.iter_metadata()]
    assert name == "robolamp"
    goals = [decoded for _, channel, _, decoded in messages if channel.topic == "/lamp/goals"]
    assert len(goals) == 8
    assert goals[3].name == list(JOINTS)
    np.testing.assert_array_equal(goals[3].position, make_tick(3).goal)
    measured = [entry for entry in messages if entry[1].topic == "/lamp/measured"]
    schema, _, raw, decoded = measured[4]
    assert schema is not None
    assert schema.name == "sensor_msgs/msg/JointState"
    assert math.isnan(decoded.position[1])
    assert decoded.header.stamp.sec * 1_000_000_000 + decoded.header.stamp.nanosec == raw.log_time
    [event] = [decoded for _, channel, _, decoded in messages if channel.topic == "/lamp/events"]
    assert (event.level, event.text) == ("warning", "knee: hot")


def test_a_tick_is_copied_when_it_is_handed_over(tmp_path):
    tick = make_tick(0)
    with LogWriter(tmp_path / "run.mcap", context={}, joints=JOINTS, now=100.0) as log:
        log.tick(tick)
        tick.goal[:] = 9.0
        tick.observation.angle[:] = 9.0
        tick.interventions.slewed = 99
    run = read_run(tmp_path / "run.mcap")
    np.testing.assert_array_equal(run.goal[0], make_tick(0).goal)
    np.testing.assert_array_equal(run.angle[0], make_tick(0).observation.angle)
    assert run.interventions[0, 2] == 0


def test_a_replay_has_topics_of_its_own(tmp_path):
    path = tmp_path / "run.mcap"
    with LogWriter(path, context={}, joints=JOINTS, now=100.0) as log:
        log.tick(make_tick(0))
        log.tick(make_tick(7), prefix="/twin")
    assert read_run(path).index.tolist() == [0]
    assert read_run(path, "/twin").index.tolist() == [7]


def test_truth(tmp_path):
    path = tmp_path / "truth.mcap"
    with LogWriter(path, context={}) as log:
        for index in range(20):
            at = time.monotonic()
            joints = joint_state(JOINTS, [0.1 * index] * 3, [1.0] * 3, [0.2] * 3, log.log_time(at))
            base = {"base_x": 0.01 * index, "base_z": 0.0, "pitch": 0.1, "clearance": 0.002, "force": 2.0}
            log.message(TRUTH_JOINTS_TOPIC, JOINT_STATE, joints, at)
            log.message(TRUTH_BASE_TOPIC, TRUTH, {**base, "fallen": index > 15}, at)
    truth = read_truth(path)
    assert truth.joints == JOINTS
    np.testing.assert_allclose(truth.base_x, 0.01 * np.arange(20))
    np.testing.assert_allclose(truth.angle[:, 2], 0.1 * np.arange(20))
    assert truth.torque.shape == (20, 3)
    assert truth.fallen.tolist() == [False] * 16 + [True] * 4
    assert abs(truth.log_time[-1] * 1e-9 - time.time()) < 1.0


def test_missed_ticks_are_slots_without_a_tick(tmp_path):
    with LogWriter(tmp_path / "run.mcap", context=CONTEXT, joints=JOINTS, now=100.0) as log:
        for index in (0, 1, 2, 5, 6):
            log.tick(make_tick(index))
    assert read_run(tmp_path / "run.mcap").missed_ticks == 2


numbers = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data(), st.integers(1, 12))
def test_any_number_survives(tmp_path, data, n):
    def array(width: int) -> np.ndarray:
        return np.array(data.draw(st.lists(numbers, min_size=width, max_size=width)))

    times = st.floats(0.0, 1e6)
    tick = Tick(
        index=data.draw(st.integers(0, 2**32 - 1)),
        phase=data.draw(st.sampled_from(["start", "run", "landing"])),
        scheduled=data.draw(times),
        began=data.draw(times),
        read_done=data.draw(times),
        write_done=data.draw(times),
        observation=Observation(
            data.draw(times),
            array(n),
            array(n),
            array(n),
            array(n),
            data.draw(numbers),
            data.draw(numbers),
            Health.unknown(n),
            tuple(data.draw(st.lists(st.text(st.characters(exclude_characters="\0", codec="utf-8")), max_size=3))),
        ),
        goal=array(n),
        inputs=array(data.draw(st.integers(0, 20))),
        hops=data.draw(st.integers(0, 1000)),
        contact=data.draw(st.booleans()),
    )
    names = [f"j{joint}" for joint in range(n)]
    with LogWriter(tmp_path / "any.mcap", context={}, joints=names, now=0.0) as log:
        log.tick(tick)
    assert log.error == ""
    run = read_run(tmp_path / "any.mcap")
    assert run.joints == tuple(names)
    np.testing.assert_array_equal(run.goal[0], tick.goal)
    np.testing.assert_array_equal(run.angle[0], tick.observation.angle)
    np.testing.assert_array_equal(run.current[0], tick.observation.current)
    np.testing.assert_array_equal(run.inputs[0], tick.inputs)
    np.testing.assert_array_equal(run.foot_force[0], tick.observation.foot_force)
    assert run.faults[0] == tick.observation.faults
    assert (run.index[0], run.hops[0], run.contact[0]) == (tick.index, tick.hops, tick.contact)


def test_a_message_without_values_reads_as_missing(tmp_path):
    tick = make_tick(0)
    tick.observation.velocity = np.empty(0)
    tick.observation.health.torque = np.empty(0, np.int64)
    with LogWriter(tmp_path / "run.mcap", context={}, joints=JOINTS, now=0.0) as log:
        log.tick(tick)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = read_run(tmp_path / "run.mcap")
    assert np.isnan(run.velocity).all()
    assert run.torque.tolist() == [[-1, -1, -1]]


def test_values_that_do_not_match_the_joints_are_refused(tmp_path):
    tick = make_tick(0)
    tick.observation.angle = np.zeros(2)
    with LogWriter(tmp_path / "run.mcap", context={}, joints=JOINTS, now=0.0) as log:
        log.tick(tick)
    with pytest.raises(FileError, match="position has 2 values, expected 3"):
        read_run(tmp_path / "run.mcap")
