from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.emulator.servo.profile import Profile, Shape

DT = 0.001
GOALS = st.floats(-6.0, 6.0)
SPEEDS = st.floats(0.5, 20.0)
ACCELERATIONS = st.floats(2.0, 200.0)


def play(profile: Profile, most: float = 1000.0) -> float:
    """Return how long it takes [s], at most so long."""
    steps = 0
    while profile.ongoing and steps * DT < most:
        profile.step(DT)
        steps += 1
    return steps * DT


@given(GOALS, SPEEDS, ACCELERATIONS)
def test_it_arrives_within_its_limits_and_without_overshoot(goal: float, speed: float, acceleration: float) -> None:
    profile = Profile()
    profile.aim(goal, speed, acceleration)
    last = 0.0
    for _ in range(math.ceil((abs(goal) / speed + speed / acceleration + 0.1) / DT)):
        profile.step(DT)
        assert abs(profile.velocity) <= speed * (1 + 1e-9)
        assert abs(profile.velocity - last) <= 2.01 * acceleration * DT
        assert abs(profile.position) <= abs(goal) + 1e-6 + acceleration * DT * DT
        last = profile.velocity
    assert (profile.position, profile.velocity) == (goal, 0.0)


@given(st.floats(0.5, 6.0), SPEEDS, ACCELERATIONS)
def test_its_duration_is_that_of_a_trapezoid(distance: float, speed: float, acceleration: float) -> None:
    profile = Profile()
    profile.aim(distance, speed, acceleration)
    reached = distance * acceleration / speed**2  # from 1 on it has the time to reach its speed
    expected = distance / speed + speed / acceleration if reached >= 1 else 2 * math.sqrt(distance / acceleration)
    if not math.isclose(reached, 1.0):  # there a trapezoid is a triangle, and rounding decides
        assert profile.shape is (Shape.TRAPEZOIDAL if reached > 1 else Shape.TRIANGULAR)
    assert play(profile) == pytest.approx(expected, rel=0.01, abs=0.005)


@given(st.lists(GOALS, min_size=2, max_size=5), SPEEDS, ACCELERATIONS)
def test_a_goal_that_changes_on_the_way_makes_no_jump(goals: list[float], speed: float, acceleration: float) -> None:
    profile = Profile()
    for goal in goals:
        profile.aim(goal, speed, acceleration)
        for _ in range(100):
            position, velocity = profile.position, profile.velocity
            profile.step(DT)
            assert abs(profile.position - position) <= speed * DT * (1 + 1e-9)
            assert abs(profile.velocity - velocity) <= 2.01 * acceleration * DT
    play(profile)
    assert profile.position == goals[-1]


@pytest.mark.parametrize(
    ("ramp", "shape"), [(0.0, Shape.RECTANGULAR), (0.3, Shape.TRAPEZOIDAL), (0.9, Shape.TRIANGULAR)]
)
def test_a_time_based_one_takes_its_time(ramp: float, shape: Shape) -> None:
    profile = Profile()
    profile.aim_in(2.0, 1.5, ramp)
    assert profile.shape is shape
    assert play(profile) == pytest.approx(1.5, abs=0.01)


def test_no_speed_is_a_step() -> None:
    profile = Profile()
    profile.aim(3.0, math.inf, 5.0)
    assert (profile.position, profile.ongoing, profile.shape) == (3.0, False, Shape.STEP)
    profile.aim_in(4.0, 0.0, 0.2)
    assert (profile.position, profile.shape) == (4.0, Shape.STEP)
