from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.twin.judges.lamp_judge import Judge, Outcome

from .parts import TWIN, N

STEP = TWIN.timestep
HIGH = 0.15  # of the head, out of harm's way [m]


class Story:
    """A lamp moved by hand, one lane."""

    def __init__(self, goal: float = 0.3, duration: float = 1.0) -> None:
        self.judge = Judge(TWIN, np.array([goal]), duration)
        self.judge.begin(np.zeros(1))
        self.x = 0.0

    def go(
        self, seconds: float, to: float | None = None, *, z: float = 0.0, tilt: float = 0.0, force: float = 2.0,
        head: float = HIGH, axis: float = 1.0,
    ) -> Story:  # fmt: skip
        steps = round(seconds / STEP)
        for x in np.linspace(self.x, self.x if to is None else to, steps + 1)[1:]:
            self.x = x
            qpos = np.zeros((1, TWIN.model.nq))
            qpos[0, :7] = [x, 0, z, math.cos(tilt / 2), 0, math.sin(tilt / 2), 0]
            one = np.zeros(1, np.int64)
            self.judge.step(one, qpos, np.array([force]), np.array([head]), np.array([axis]))
        return self

    @property
    def outcome(self) -> Outcome:
        return self.judge.outcome(np.zeros((1, N)), np.zeros(1, bool), np.zeros(1, np.int64))


def test_a_hop_counts_with_its_share_of_the_travel() -> None:
    end = Story().go(0.1, 0.02).go(0.1, 0.05, z=0.005, force=0.0).go(0.1).outcome
    assert end.hops == [1]
    assert end.travel == pytest.approx([0.05])
    assert end.flight == pytest.approx([0.03])
    assert end.flight_share == pytest.approx([0.6])
    assert end.bad_landings == [0]
    assert not end.fallen


def test_going_back_is_travel_too() -> None:
    end = Story().go(0.1, 0.02).go(0.1, -0.02, z=0.005, force=0.0).go(0.1, 0.0).outcome
    assert end.travel == pytest.approx([0.08])
    assert end.flight_share == pytest.approx([0.5])


@pytest.mark.parametrize(
    ("flight", "hops", "bad"),
    [
        ({"seconds": 0.078, "z": 0.005}, 0, 0),  # too short: a rebound
        ({"seconds": 0.080, "z": 0.005}, 1, 0),
        ({"seconds": 0.1, "z": 0.0019}, 0, 0),  # too low
        ({"seconds": 0.1, "z": 0.0021}, 1, 0),
        ({"seconds": 0.1, "z": 0.010, "tilt": math.radians(10)}, 0, 0),  # its lowest point is in the floor
        ({"seconds": 0.1, "z": 0.012, "tilt": math.radians(10)}, 1, 0),
    ],
)
def test_what_is_a_hop(flight: dict, hops: int, bad: int) -> None:
    end = Story().go(0.1).go(to=0.03, force=0.0, **flight).go(0.1).outcome
    assert (end.hops, end.bad_landings) == (hops, bad)
    assert end.flight == pytest.approx([0.03 * hops])


@pytest.mark.parametrize(("degrees", "hops"), [(14, 1), (16, 0), (-14, 1), (-16, 0)])
def test_a_hop_lands_within_15_degrees_of_flat(degrees: float, hops: int) -> None:
    end = Story().go(0.1).go(0.1, 0.03, z=0.03, force=0.0).go(0.1, tilt=math.radians(degrees)).outcome
    assert (end.hops, end.bad_landings) == (hops, 1 - hops)


def test_flight_share_is_unknown_below_a_centimetre() -> None:
    assert np.isnan(Story().go(0.1, 0.0099).outcome.flight_share)
    assert Story().go(0.1, 0.0101).outcome.flight_share == [0]


@pytest.mark.parametrize(
    ("pose", "fell"),
    [
        ({"tilt": math.radians(69)}, False),
        ({"tilt": math.radians(71)}, True),
        ({"tilt": math.radians(-71)}, True),
        ({"head": 0.03 + TWIN.head_size[1] + 0.001}, False),  # upright: its half length above the floor
        ({"head": 0.03 + TWIN.head_size[1] - 0.001}, True),
        ({"head": 0.03 + TWIN.head_size[0] + 0.001, "axis": 0.0}, False),  # lying: its radius
        ({"head": 0.03 + TWIN.head_size[0] - 0.001, "axis": 0.0}, True),
        ({"z": math.nan}, True),
    ],
)
def test_what_is_a_fall(pose: dict, fell: bool) -> None:
    end = Story().go(0.1).go(0.05, **pose).go(0.1).outcome
    assert end.fallen == [fell]
    if fell:
        assert end.fall_time == pytest.approx([0.1 + STEP])


def test_a_hit_rests_upright_at_the_goal() -> None:
    there = Story().go(0.4, 0.29).go(0.6).outcome
    assert there.hit == [True]
    assert there.error == pytest.approx([-0.01])
    assert there.arrival == pytest.approx([0.4 * 0.285 / 0.29], abs=2 * STEP)
    assert there.travel_after == pytest.approx([0.005], abs=0.002)
    for spoiled in (
        Story().go(0.4, 0.28).go(0.6),  # short of it
        Story().go(0.4, 0.29).go(0.3).go(0.1, 0.30).go(0.2),  # still moving
        Story().go(0.4, 0.29).go(0.6, tilt=math.radians(20)),  # leaning
        Story().go(0.3, 0.29, tilt=math.radians(80)).go(0.7),  # it had fallen
        Story().go(0.4, 0.29),  # not at the end of its time: nobody knows whether it rests
    ):
        assert spoiled.outcome.hit == [False]


def test_a_hit_of_1997_came_near_at_some_time() -> None:
    past = Story().go(0.4, 0.5).go(0.6).outcome
    assert (past.hit_1997, past.hit) == (True, False)
    assert past.nearest == pytest.approx([0.0], abs=0.5 / 200)
    assert Story().go(0.4, 0.284).go(0.6).outcome.hit_1997 == [False]


def test_goal_met_is_latched() -> None:
    story = Story().go(0.1, 0.2)
    assert story.judge.goal_met == [0]
    story.go(0.1, 0.3)
    assert story.judge.goal_met == [1]
    story.go(0.1, 0.6)
    assert story.judge.goal_met == [1]


@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: sum(v * v for v in q) > 0.1), st.floats(0, 1)
)
def test_tilt_and_clearance_are_those_of_the_foots_rim(quaternion: list[float], z: float) -> None:
    unit = np.array(quaternion) / np.linalg.norm(quaternion)
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, unit)
    axes = axes.reshape(3, 3)
    turn = np.linspace(0, 2 * np.pi, 721)
    rim = TWIN.foot_radius * (np.cos(turn)[:, None] * axes[:, 0] + np.sin(turn)[:, None] * axes[:, 1])
    judge = Judge(TWIN, np.zeros(1), 1.0)
    qpos = np.zeros((1, TWIN.model.nq))
    qpos[0, :7] = [0, 0, z, *unit]
    judge.step(np.zeros(1, np.int64), qpos, np.ones(1), np.ones(1), np.ones(1))
    assert math.cos(judge.tilt[0]) == pytest.approx(axes[2, 2], abs=1e-9)
    assert judge.clearance[0] == pytest.approx(z + rim[:, 2].min(), abs=1e-5)


def test_lanes_that_are_not_stepped_stay_as_they_are() -> None:
    judge = Judge(TWIN, np.full(2, 0.3), 1.0)
    judge.begin(np.zeros(2))
    qpos = np.zeros((2, TWIN.model.nq))
    qpos[:, 3], qpos[:, 0] = 1.0, 0.1
    judge.step(np.array([1]), qpos, np.ones(2), np.ones(2), np.ones(2))
    end = judge.outcome(np.zeros((2, N)), np.zeros(2, bool), np.zeros(2, np.int64))
    assert end.x.tolist() == [0.0, 0.1]
    assert end.travel.tolist() == [0.0, 0.1]
