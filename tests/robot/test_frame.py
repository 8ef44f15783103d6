from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.assets import Assets
from robolamp.lamp import load_lamp
from robolamp.robot.joint_frame import JointFrame, wrapped

LAMP = load_lamp(Assets())


@given(st.floats(-50, 50))
def test_wrapped_is_the_same_direction_in_one_turn(angle: float) -> None:
    value = float(wrapped(np.array([angle]))[0])
    assert -math.pi < value <= math.pi
    assert math.cos(value) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(value) == pytest.approx(math.sin(angle), abs=1e-9)


def test_the_seam_belongs_to_plus_pi() -> None:
    assert wrapped(np.array([math.pi, -math.pi, 0.0])).tolist() == [math.pi, math.pi, 0.0]
    assert np.isnan(wrapped(np.array([np.nan]))[0])


def test_signs_and_zeros() -> None:
    frame = JointFrame(LAMP)
    joint = np.array([0.1, 0.1, -0.2])
    assert frame.servo_angle(joint) == pytest.approx([3.241593, 3.041593, 2.941593])  # the knee is mirrored
    assert frame.joint_angle(frame.servo_angle(joint)) == pytest.approx(joint)


@given(turns=st.integers(-3, 3), joint=st.floats(-3.1, 3.1))
def test_whole_turns_do_not_matter(turns: int, joint: float) -> None:
    frame = JointFrame(LAMP)
    servo = frame.servo_angle(np.full(3, joint)) + turns * 2 * math.pi
    assert frame.joint_angle(servo) == pytest.approx(np.full(3, joint), abs=1e-9)
