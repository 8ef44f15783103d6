from __future__ import annotations

import math

import numpy as np
import pytest

from robolamp.errors import SafetyError
from robolamp.signals import Command
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.sensor_model import measure_angle, measure_force
from robolamp.twin.twin_lamp import TwinLamp

from .parts import ASSETS, CALIBRATION, LAMP, TWIN, N


def standing() -> TwinLamp:
    lamp = TwinLamp(TWIN)
    lamp.open()
    lamp.torque(True)
    lamp.clock.sleep_until(0.5)
    return lamp


def test_virtual_time_goes_by_whole_steps_and_only_when_waited_for() -> None:
    lamp = standing()
    assert lamp.clock.now() == pytest.approx(0.5)
    lamp.clock.sleep_until(0.4)
    assert lamp.clock.now() == pytest.approx(0.5)
    lamp.clock.sleep_until(0.5051)
    assert lamp.observe().time == pytest.approx(0.506)


def test_a_goal_arrives_after_the_lines_delay() -> None:
    lamp = standing()
    lamp.command(Command(np.full(N, 0.2)))
    steps = round(TWIN.line_delay / TWIN.timestep)
    lamp.clock.sleep_until(0.5 + TWIN.line_delay)
    assert lamp.body.goal.tolist() == [0.0] * N
    lamp.clock.sleep_until(0.5 + (steps + 1) * TWIN.timestep)
    assert lamp.body.goal.tolist() == [0.2] * N


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, LAMP.upper[1] + 1e-6, LAMP.lower[1] - 1e-6])
def test_a_goal_outside_the_limits_is_refused_and_nothing_is_sent(bad: float) -> None:
    lamp = standing()
    with pytest.raises(SafetyError, match=r"goal .* rad of knee is not from .* to .* rad$"):
        lamp.command(Command(np.array([0.3, bad, 0.3])))
    lamp.clock.sleep_until(0.6)
    assert lamp.body.goal.tolist() == [0.0] * N
    lamp.command(Command(np.array([LAMP.lower[0], LAMP.upper[1], LAMP.upper[2]])))


def test_without_torque_it_slumps_and_with_torque_again_it_holds_what_it_has() -> None:
    lamp = standing()
    lamp.torque(False)
    lamp.clock.sleep_until(0.65)
    assert lamp.observe().health.torque.tolist() == [0] * N
    slumped = lamp.observe().angle
    assert np.abs(slumped).max() > 0.02
    lamp.torque(True)
    assert lamp.body.goal == pytest.approx(lamp.body.angle)
    lamp.clock.sleep_until(0.66)
    lamp.close()
    lamp.close()
    assert lamp.observe().health.torque.tolist() == [0] * N


def test_the_judge_begins_when_told_to() -> None:
    lamp = standing()
    lamp.body.data.qpos[0] = 0.25
    lamp.start_judging()
    lamp.clock.sleep_until(0.7)
    assert lamp.outcome.travel[0] < 0.005
    assert lamp.outcome.x[0] == pytest.approx(0.25, abs=0.005)


def test_sensors_read_in_the_steps_of_the_hardware() -> None:
    angle = np.linspace(-1, 1, 4001)
    read = measure_angle(angle)
    assert np.abs(read - angle).max() <= np.pi / 4096 * (1 + 1e-9)
    counts = read / (2 * np.pi / 4096)
    np.testing.assert_allclose(counts, counts.round(), atol=1e-9)
    assert measure_force(np.array([1.23456, 0.0004]), 2.0).tolist() == pytest.approx([2.469, 0.001])


def test_the_foot_reads_through_its_gain() -> None:
    calibration = CALIBRATION
    lamp = TwinLamp(build(LAMP, calibration, ASSETS))
    object.__setattr__(lamp.twin, "foot_gain", 0.5)
    lamp.open()
    lamp.torque(True)
    lamp.clock.sleep_until(0.5)
    assert lamp.observe().foot_force == pytest.approx(0.5 * lamp.body.force, abs=0.001)


def test_in_the_rest_pose_the_lamp_stays_when_torque_goes_off() -> None:
    body = Body(TWIN)
    for step in range(1000):
        body.set_goal(LAMP.rest * min(1.0, step / 500))
        body.step()
    before = body.angle.copy()
    joints = len(LAMP.joints)
    body.set_motors(np.full(joints, 800.0), np.full(joints, TWIN.voltage), np.zeros(joints, bool))
    body.step(1500)
    assert np.abs(body.angle - before).max() < 0.05
    x, _, pitch = body.base
    assert abs(x) < 0.002
    assert abs(pitch) < 0.01
