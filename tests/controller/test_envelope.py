from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.envelope import Envelope
from robolamp.controller.kernels import bound_lanes
from robolamp.signals import Interventions

from .parts import signal

LOWER, UPPER, SLEW, PERIOD = np.array([-0.6, -1.0, -1.0]), np.array([0.6, 0.8, 0.4]), np.array([14.0, 5.0, 0.5]), 0.02

wishes = st.lists(st.lists(signal, min_size=3, max_size=3), min_size=1, max_size=30)


@given(wishes, st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_goals_are_finite_inside_limits_and_slow_whatever_is_asked(asked: list, start: list) -> None:
    last = LOWER + np.array(start) * (UPPER - LOWER)
    envelope = Envelope(LOWER, UPPER, SLEW, PERIOD, last)
    for wanted in asked:
        goal = envelope.apply(np.array(wanted))
        assert np.isfinite(goal).all()
        assert ((goal >= LOWER) & (goal <= UPPER)).all()
        assert (np.abs(goal - last) <= SLEW * PERIOD * (1 + 1e-12) + 1e-15).all()
        last = goal


def test_what_is_harmless_passes_unchanged_and_uncounted() -> None:
    envelope = Envelope(LOWER, UPPER, SLEW, PERIOD, np.zeros(3))
    for step in range(1, 11):
        wanted = np.array([0.05, -0.08, 0.009]) * step
        assert (envelope.apply(wanted) == wanted).all()
    assert envelope.interventions == Interventions()


def test_every_change_is_counted_by_its_kind() -> None:
    envelope = Envelope(LOWER, UPPER, SLEW, PERIOD, np.array([0.0, 0.1, 0.39]))
    goal = envelope.apply(np.array([np.nan, np.inf, 0.45]))
    assert goal.tolist() == [0.0, 0.1, 0.4]
    assert envelope.interventions == Interventions(not_finite=2, limited=1, slewed=0)
    goal = envelope.apply(np.array([1e300, 0.15, -1.0]))
    np.testing.assert_allclose(goal, [0.28, 0.15, 0.39], atol=1e-15)
    assert envelope.interventions == Interventions(not_finite=2, limited=2, slewed=2)


def test_an_account_of_interventions_stays_as_it_was() -> None:
    envelope = Envelope(LOWER, UPPER, SLEW, PERIOD, np.zeros(3))
    before = envelope.interventions
    envelope.apply(np.full(3, np.nan))
    assert (before.total, envelope.interventions.total) == (0, 3)


NUMBERS = st.floats(allow_nan=True, allow_infinity=True, width=64)


@given(
    st.lists(st.lists(NUMBERS, min_size=6, max_size=6), min_size=1, max_size=6), st.sampled_from([0.02, 2.0, np.inf])
)
def test_the_twins_lanes_keep_to_the_lamps_envelope_to_the_bit(ticks: list[list[float]], slew: float) -> None:
    lower, upper, slews = np.array([-1.0, 0.0, -0.5]), np.array([1.0, 0.6, 0.0]), np.full(3, slew)
    lamps = [Envelope(lower, upper, slews, 0.02, np.zeros(3)) for _ in range(2)]
    goal, interventions = np.zeros((2, 3)), np.zeros(2, np.int64)
    for numbers in ticks:
        wanted = np.array(numbers).reshape(2, 3)
        bound_lanes(np.arange(2), wanted, goal, lower, upper, slews * 0.02, interventions)
        assert goal.tobytes() == np.array([lamp.apply(own) for lamp, own in zip(lamps, wanted, strict=True)]).tobytes()
    assert interventions.tolist() == [lamp.interventions.total for lamp in lamps]
