"""The odometer at work: steps cut, features in their places, ways added up; one lane or many."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robolamp.assets import Assets
from robolamp.controller.foot_window import FootWindow
from robolamp.controller.hop_counter import SignalLimits
from robolamp.controller.odometry import Odometry, Steps
from robolamp.controller.terminals import FOOT_WINDOW, WAY, Signals
from robolamp.errors import ExpressionError
from robolamp.lamp import load_lamp
from robolamp.odometer import LANDING, LEAST_ERROR, TAKEOFF, Network, Odometer, feature_names

PERIOD = 0.02
NAMES = feature_names(1)
ERROR = math.hypot(0.025, LEAST_ERROR)


def odometer(length: float = 0.5, error: float = 0.25, correlation: float = 0.0) -> Odometer:
    """One that takes every step of a lamp with one joint for equally long, in units of 10 cm."""
    count = len(NAMES)
    network = Network(np.zeros((count, 1)), np.zeros(1), np.zeros((1, 2)), np.array([length, 2 * math.log(error)]))
    return Odometer(
        1, PERIOD, np.zeros(count), np.ones(count), np.full(count, -9.0), np.full(count, 9.0), network, 0.1, correlation
    )


def steps_of(grounded: list[bool]) -> list[tuple[int, dict[str, float]]]:
    """When steps ended, and their features; the angle is the tick's number, and the force ten times that."""
    steps, found = Steps(1, 1, PERIOD), []
    for tick, contact in enumerate(grounded):
        number = np.array([float(tick)])
        share = np.array([float(contact)])
        lanes, features = steps.update(number[:, None], -number[:, None], 10 * number, share, share > 0)
        if len(lanes):
            found.append((tick, dict(zip(NAMES, features[0], strict=True))))
    return found


FLIGHT = [True] * 12 + [False] * 6 + [True] * 20


def test_a_step_ends_some_ticks_after_its_landing() -> None:
    ((ended, seen),) = steps_of(FLIGHT)
    takeoff, landing = 11, 18
    assert ended == landing + LANDING[-1]
    for offset in TAKEOFF:
        assert seen[f"a0 takeoff{offset:+d}"] == takeoff + offset
        assert seen[f"force takeoff{offset:+d}"] == 10 * (takeoff + offset)
    for offset in LANDING:
        assert seen[f"w0 landing{offset:+d}"] == -(landing + offset)
    assert seen["contact takeoff+0"] == seen["contact landing+0"] == 1
    assert seen["contact takeoff+1"] == seen["contact landing-1"] == 0
    assert seen["air"] == pytest.approx(6 * PERIOD)
    assert seen["unloaded before"] == seen["unloaded after"] == pytest.approx(0)
    assert seen["length"] == pytest.approx(ended * PERIOD)
    assert seen["push"] == pytest.approx(sum(10 * tick for tick in range(6, 12)) * PERIOD)
    assert seen["impact"] == pytest.approx(sum(10 * tick for tick in range(19, 25)) * PERIOD)
    assert seen["a0 start"] == 0


def test_what_is_unloaded_but_for_a_tick_is_no_flight_and_is_told() -> None:
    one = [True] * 5 + [False] + [True] * 6
    ((_, seen),) = steps_of(one + FLIGHT[12:])
    assert seen["unloaded before"] == pytest.approx(PERIOD)
    ((_, seen),) = steps_of(FLIGHT[:20] + [False] + [True] * 10)
    assert seen["unloaded after"] == pytest.approx(PERIOD)


def test_a_rebound_ends_the_step_before_it() -> None:
    (first, _), (second, seen) = steps_of([*FLIGHT[:20], False, False, *[True] * 20])
    assert (first, second) == (22, 28)
    assert seen["a0 takeoff+0"] == 19
    assert seen["length"] == pytest.approx(6 * PERIOD)


def test_a_lamp_that_stays_on_the_ground_takes_a_step_now_and_then() -> None:
    ends = [ended for ended, _ in steps_of([True] * 100)]
    assert ends == [30, 60, 90]


def test_no_step_ends_in_the_air() -> None:
    assert [ended for ended, _ in steps_of([True] * 4 + [False] * 60 + [True] * 7)] == [70]


@settings(max_examples=15)
@given(st.lists(st.lists(st.booleans(), min_size=120, max_size=120), min_size=1, max_size=4), st.integers(0, 9))
def test_lanes_do_not_touch_each_other(contacts: list[list[bool]], seed: int) -> None:
    lanes, shipped = len(contacts), load_lamp(Assets.of(None)).odometer
    assert shipped is not None
    seen = 0.1 * np.random.default_rng(seed).standard_normal((120, lanes, 7))

    def ways(chosen: list[int]) -> np.ndarray:
        made = Odometry(len(chosen), shipped)
        for tick in range(120):
            angle, velocity, force = seen[tick, chosen, :3], seen[tick, chosen, 3:6], seen[tick, chosen, 6]
            grounded = np.array([contacts[lane][tick] for lane in chosen])
            made.update(angle, velocity, force, grounded.astype(float), grounded)
        return np.stack([made.way, made.stderr])

    together = ways(list(range(lanes)))
    for lane in range(lanes):
        assert np.array_equal(ways([lane])[:, 0], together[:, lane])


@pytest.mark.parametrize("missed", [5, 100])
def test_missed_ticks_were_like_the_one_that_came(missed: int) -> None:
    whole, gap = Steps(1, 1, PERIOD), Steps(1, 1, PERIOD)
    one = np.ones(1)
    for _ in range(9):
        for steps in (whole, gap):
            steps.update(one[:, None], one[:, None], one, one, one > 0)
    for _ in range(missed):
        whole.update(2 * one[:, None], one[:, None], 0 * one, 0 * one, one < 0)
    gap.update(2 * one[:, None], one[:, None], 0 * one, 0 * one, one < 0, elapsed=missed)
    for tick in range(8):
        found = [steps.update(3 * one[:, None], one[:, None], one, one, one > 0) for steps in (whole, gap)]
        assert len(found[0][0]) == len(found[1][0]) == (tick == 6)
        assert np.array_equal(found[0][1], found[1][1])


def test_the_way_is_the_sum_and_its_error_grows_between_root_and_whole() -> None:
    for correlation, factor in ((0.0, math.sqrt(3)), (1.0, 3.0), (0.5, math.sqrt(0.5 * 3 + 0.5 * 9))):
        made = Odometry(1, odometer(correlation=correlation))
        for _ in range(100):
            made.update(np.zeros((1, 1)), np.zeros((1, 1)), np.ones(1), np.ones(1), np.ones(1, bool))
        assert made.way[0] == pytest.approx(3 * 0.05)
        assert made.stderr[0] == pytest.approx(factor * ERROR)
        assert made.unlike[0] == 0


def test_a_step_unlike_all_that_was_learnt_is_told_and_known_to_be_uncertain() -> None:
    made = Odometry(1, odometer())
    for tick in range(31):
        angle = np.full((1, 1), 20.0 if tick == 28 else 0.0)
        made.update(angle, np.zeros((1, 1)), np.ones(1), np.ones(1), np.ones(1, bool))
    assert made.unlike[0] == 1
    assert made.stderr[0] == pytest.approx(0.1)  # how much steps differ


def test_the_window_has_mean_and_share_of_a_ticks_samples() -> None:
    window = FootWindow(2, contact_on=0.4, contact_off=0.2)
    for one, two in ((2.0, 0.1), (0.3, 0.3), (0.1, 0.3), (0.3, 0.5)):
        window.add(np.array([one, two]))
    mean, contact = window.take()
    assert mean == pytest.approx([0.675, 0.3])
    assert contact == pytest.approx([0.5, 0.25])  # 0.3 N is contact after contact, and none after none
    assert all(np.isnan(each).all() for each in window.take())


def limits(of: Odometer | None) -> SignalLimits:
    return SignalLimits(PERIOD, 0.4, 0.2, 0.08, of)


def test_signals_give_the_way_and_what_is_left_of_it() -> None:
    signals = Signals(1, 1, limits(odometer()), (*WAY, *FOOT_WINDOW))
    for tick in range(61):
        foot = (np.array([2.0]), np.array([0.5])) if tick % 2 else None
        way, left, stderr, mean, contact = signals.update(
            np.zeros((1, 1)), np.array([3.0]), np.array([0.3]), foot=foot
        )[0]
        assert (mean, contact) == ((2.0, 0.5) if tick % 2 else (3.0, 1.0))
        assert way == pytest.approx(0.05 * (tick // 30))
        assert left == pytest.approx(0.3 - way)
        assert stderr == pytest.approx(ERROR * math.sqrt(tick // 30))


def test_what_came_of_no_sample_is_like_the_last_force() -> None:
    signals = Signals(1, 1, limits(None), FOOT_WINDOW)
    gap = np.array([math.nan])
    assert signals.update(np.zeros((1, 1)), np.array([1.5]), np.zeros(1), foot=(gap, gap))[0].tolist() == [1.5, 1.0]


@pytest.mark.parametrize(
    ("of", "period", "words"),
    [
        (None, PERIOD, "the lamp has none"),
        (odometer(), 0.04, "need a control period of 0.02 s.*the controller's is 0.04"),
    ],
)
def test_a_way_that_nobody_measures_is_refused(of: Odometer | None, period: float, words: str) -> None:
    with pytest.raises(ExpressionError, match=words):
        Signals(1, 1, SignalLimits(period, 0.4, 0.2, 0.08, of), ("way",))
    assert Signals(1, 1, SignalLimits(period, 0.4, 0.2, 0.08, of), ("way",), {"t"}).terminals == ("way",)
