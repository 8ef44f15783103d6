from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.envelope import Envelope
from robolamp.controller.kernels import bound_lanes

from .parts import signal

LOWER, UPPER, SLEW, PERIOD = np.array([-0.6, -1.0, -1.0]), np.array([0.6, 0.8, 0.4]), np.array([14.0, 5.0, 0.5]), 0.02

wishes = st.lists(st.lists(signal, min_size=3, max_size=3), min_size=1, max_size=30)


@given(wishes, st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_goals_are_finite_inside_limits_and_slow_whatever_is_asked(asked: list, start: list) -> None:
    last = LOWER + np.array(start) * (UPPER - LOWER)
    envelope = Envelope(LOWER, UPPER, SLEW, PERIOD, last[None])
    for wanted in asked:
        goal = envelope.apply(np.array([wanted]))[0]
        assert np.isfinite(goal).all()
        assert ((goal >= LOWER) & (goal <= UPPER)).all()
        assert (np.abs(goal - last) <= SLEW * PERIOD * (1 + 1e-12) + 1e-15).all()
        last = goal


@given(wishes, wishes)
def test_many_lanes_are_many_single_lanes(first: list, second: list) -> None:
    together = Envelope(LOWER, UPPER, SLEW, PERIOD, np.zeros((2, 3)))
    alone = [Envelope(LOWER, UPPER, SLEW, PERIOD, np.zeros((1, 3))) for _ in range(2)]
    for pair in zip(first, second, strict=False):
        goals = together.apply(np.array(pair))
        for lane, envelope in enumerate(alone):
            assert envelope.apply(np.array([pair[lane]]))[0].tolist() == goals[lane].tolist()
    for count in ("not_finite", "limited", "slewed"):
        assert getattr(together, count).tolist() == [getattr(envelope, count)[0] for envelope in alone]


def test_what_is_harmless_passes_unchanged_and_uncounted() -> None:
    envelope = Envelope(LOWER, UPPER, SLEW, PERIOD, np.zeros((1, 3)))
    for step in range(1, 11):
        wanted = np.array([[0.05, -0.08, 0.009]]) * step
        assert (envelope.apply(wanted) == wanted).all()
    assert envelope.not_finite[0] == envelope.slewed[0] == envelope.limited[0] == 0


def test_every_change_is_counted_by_its_kind() -> None:
    envelope = Envelope(LOWER, UPPER, SLEW, PERIOD, np.array([[0.0, 0.1, 0.39]]))
    goal = envelope.apply(np.array([[np.nan, np.inf, 0.45]]))[0]
    assert goal.tolist() == [0.0, 0.1, 0.4]
    assert (envelope.not_finite[0], envelope.limited[0], envelope.slewed[0]) == (2, 1, 0)
    goal = envelope.apply(np.array([[1e300, 0.15, -1.0]]))[0]
    np.testing.assert_allclose(goal, [0.28, 0.15, 0.39], atol=1e-15)
    assert (envelope.not_finite[0], envelope.limited[0], envelope.slewed[0]) == (2, 2, 2)


NUMBERS = st.floats(allow_nan=True, allow_infinity=True, width=64)


@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=6), st.sampled_from([0.02, 2.0, np.inf]))
def test_compiled_envelope_is_the_same_to_the_bit(ticks: list[tuple[float, float, float]], slew: float) -> None:
    lower, upper, slews = np.array([-1.0, 0.0, -0.5]), np.array([1.0, 0.6, 0.0]), np.full(3, slew)
    envelope = Envelope(lower, upper, slews, 0.02, np.zeros((1, 3)))
    goal, interventions = np.zeros((1, 3)), np.zeros(1, np.int64)
    for wanted in ticks:
        bound_lanes(np.zeros(1, np.int64), np.array([wanted]), goal, lower, upper, slews * 0.02, interventions)
        assert goal.tobytes() == envelope.apply(np.array([wanted])).tobytes()
    assert interventions == envelope.not_finite + envelope.limited + envelope.slewed
