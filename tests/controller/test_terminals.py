from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.hop_counter import SignalLimits
from robolamp.controller.terminals import TWIN_ONLY, Signals, all_terminals, on_board_terminals

PERIOD = 0.02
LIMITS = SignalLimits(PERIOD, contact_on=0.4, contact_off=0.2, flight_time=0.08)
NAMES = on_board_terminals(3, odometer=False)
GOAL = np.array([0.3])


def played(forces: list[float], elapsed: list[int] | None = None) -> dict[str, list[float]]:
    """What each terminal was, tick by tick, over a history of foot forces."""
    signals = Signals(1, 3, LIMITS, NAMES)
    rows = [
        signals.update(np.zeros((1, 3)), np.array([force]), GOAL, elapsed=passed)[0].copy()
        for force, passed in zip(forces, elapsed or [1] * len(forces), strict=True)
    ]
    return {name: [row[index] for row in rows] for index, name in enumerate(NAMES)}


def test_the_names() -> None:
    assert NAMES == (
        "t", "a0", "a1", "a2", "w0", "w1", "w2", "s0", "contact", "air_time", "ground_time", "hops", "goal_dist",
    )  # fmt: skip
    assert on_board_terminals(3) == (*NAMES, "way", "way_left", "way_stderr")
    assert all_terminals(3) == (*on_board_terminals(3), "goal_time", "px", "py", "pz", "vx", "vy", "vz", "goal_met")


def test_contact_has_hysteresis() -> None:
    seen = played([2.0, 0.3, 0.21, 0.2, 0.3, 0.4, 0.41, 0.21])
    assert seen["contact"] == [1, 1, 1, 0, 0, 0, 1, 1]


def test_a_hop_is_a_flight_and_then_contact() -> None:
    flight = [2, 0, 0, 0, 0, 2]  # 80 ms
    assert played(flight)["hops"] == [0, 0, 0, 0, 0, 1]
    assert played([2, 0, 0, 0, 2])["hops"][-1] == 0
    assert played([*flight, 0, 0, 0, 0.3, 0.5, 0, 3])["hops"][-3:] == [2, 2, 2]


def test_rebounds_after_a_landing_are_no_hops() -> None:
    assert played([2, *[0] * 7, 2, 0, 0, 2, 0, 0, 2])["hops"][8:] == [1] * 7  # contact 1,0,0,1,0,0,1


def test_the_shortest_flight_is_the_lamps() -> None:
    limits = dataclasses.replace(LIMITS, flight_time=0.04)
    signals = Signals(1, 3, limits, ["hops"])
    for force, hops in ((2, 0), (0, 0), (2, 0), (0, 0), (0, 0), (2, 1)):
        assert signals.update(np.zeros((1, 3)), np.array([float(force)]), GOAL)[0, 0] == hops


def test_times_count_from_the_last_change_of_contact() -> None:
    seen = played([2, 2, 0, 0, 0, 2, 2])
    assert seen["air_time"] == pytest.approx([0, 0, 0.02, 0.04, 0.06, 0, 0])
    assert seen["ground_time"] == pytest.approx([0, 0.02, 0, 0, 0, 0.02, 0.04])
    assert seen["t"] == pytest.approx([0, 0.02, 0.04, 0.06, 0.08, 0.10, 0.12])


def test_missed_ticks_count_as_time() -> None:
    seen = played([2, 0, 0, 2, 2], [1, 1, 3, 1, 2])
    assert seen["t"] == pytest.approx([0, 0.02, 0.08, 0.10, 0.14])
    assert seen["air_time"] == pytest.approx([0, 0.02, 0.08, 0, 0])
    assert seen["ground_time"][-1] == pytest.approx(0.06)
    assert seen["hops"][-1] == 1
    signals = Signals(1, 3, LIMITS, ["w0"])
    signals.update(np.zeros((1, 3)), GOAL, GOAL)
    assert signals.update(np.full((1, 3), 0.06), GOAL, GOAL, elapsed=3)[0, 0] == pytest.approx(1.0)


def test_a_missing_measurement_keeps_its_last_value() -> None:
    signals = Signals(1, 2, LIMITS, ["a0", "a1", "w1", "s0", "contact"])
    signals.update(np.array([[0.1, 0.2]]), np.array([2.0]), GOAL)
    row = signals.update(np.array([[0.3, np.nan]]), np.array([np.nan]), GOAL)[0]
    assert row == pytest.approx([0.3, 0.2, 0.0, 2.0, 1.0])
    row = signals.update(np.array([[0.3, 0.24]]), np.array([0.0]), GOAL)[0]
    assert row == pytest.approx([0.3, 0.24, 2.0, 0.0, 0.0])


def test_the_time_to_take_is_as_commanded() -> None:
    signals = Signals(2, 3, LIMITS, ["goal_time", "goal_dist"])
    angle, force, goal = np.zeros((2, 3)), np.ones(2), np.array([0.1, 0.2])
    assert signals.update(angle, force, goal).tolist() == [[0, 0.1], [0, 0.2]]
    assert signals.update(angle, force, goal, goal_time=1.5)[:, 0].tolist() == [1.5, 1.5]
    assert signals.update(angle, force, goal, goal_time=np.array([2.0, 3.0]))[:, 0].tolist() == [2.0, 3.0]


def test_what_only_the_twin_knows_is_passed_through() -> None:
    signals = Signals(2, 3, LIMITS, TWIN_ONLY)
    base = np.arange(14.0).reshape(2, 7)
    assert (signals.update(np.zeros((2, 3)), np.ones(2), np.ones(2), base) == base).all()


history = st.lists(
    st.tuples(
        st.lists(st.one_of(st.floats(-1, 1), st.just(float("nan"))), min_size=3, max_size=3),
        st.one_of(st.sampled_from([0.0, 0.2, 0.3, 0.4, 2.0]), st.just(float("nan"))),
        st.integers(1, 3),
    ),
    min_size=1,
    max_size=25,
)


@given(st.lists(history, min_size=2, max_size=4))
def test_many_lanes_are_many_single_lanes(histories: list) -> None:
    length = min(len(history) for history in histories)
    lanes = len(histories)
    goal = np.linspace(0.1, 0.4, lanes)
    together = Signals(lanes, 3, LIMITS, NAMES)
    alone = [Signals(1, 3, LIMITS, NAMES) for _ in histories]
    for tick in range(length):
        angle = np.array([history[tick][0] for history in histories])
        force = np.array([history[tick][1] for history in histories])
        passed = histories[0][tick][2]
        rows = together.update(angle, force, goal, elapsed=passed)
        for lane, signals in enumerate(alone):
            part = slice(lane, lane + 1)
            row = signals.update(angle[part], force[part], goal[part], elapsed=passed)[0]
            assert row.tolist() == rows[lane].tolist()
