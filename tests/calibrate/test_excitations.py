"""Excitations: inside the limits, slow enough, and rich enough."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.calibrate.excitations import FADE, Excitation, chirp, ramp, sine_of_square, steps, still
from robolamp.calibrate.procedure import Step
from tests.calibrate.sessions import LAMP, procedure

PLAYED = [step for step in procedure(LAMP) if step.excitation]


@pytest.mark.parametrize("step", PLAYED, ids=lambda step: step.name)
def test_goals_begin_neutral_and_stay_inside_the_limits(step: Step) -> None:
    assert step.excitation
    goals = np.array([step.excitation.goal(time) for time in np.arange(0.0, step.duration, 0.01)])
    assert goals[0] == pytest.approx(np.zeros(3))
    assert (goals >= LAMP.lower).all()
    assert (goals <= LAMP.upper).all()
    # Whoever fades in must not jump where the excitation takes over.
    edge = round(FADE / 0.01)
    assert np.abs(goals[edge] - goals[edge - 1]).max() < 0.05 or "steps" in step.name


def test_the_procedure_shakes_each_joint_alone_and_all_together_at_several_gains() -> None:
    moved = {}
    for step in PLAYED:
        assert step.excitation
        goals = np.array([step.excitation.goal(time) for time in np.arange(FADE, step.duration, 0.01)])
        moved[step.name] = np.ptp(goals, axis=0) > 0.1
    for index, joint in enumerate(LAMP.names):
        assert np.flatnonzero(moved[f"chirp-{joint}"]).tolist() == [index]
    assert moved["squares"].all()
    assert moved["steps-soft"].all()
    assert len({step.p_gain for step in PLAYED}) >= 3
    assert sum(step.drop is not None for step in PLAYED) >= 2
    assert {step.clamped for step in procedure(LAMP)} == {True, False}


@given(st.floats(0.0, 60.0))
def test_signals_stay_within_their_swing(time: float) -> None:
    for signal in (still(), chirp(0.4, 3.5, 5.0, 6.0), ramp(4.0, 0.4), sine_of_square(1.3), steps(0.5, 3)):
        assert -1.0 <= signal(time) <= 1.0


def test_a_ramp_begins_in_the_middle_and_reaches_both_ends() -> None:
    signal = ramp(4.0, 1.0)
    assert [signal(time) for time in (0.0, 1.0, 2.0, 3.0, 4.0)] == pytest.approx([0.0, 0.0, 1.0, 0.0, -1.0])


def test_a_chirp_is_no_faster_than_told() -> None:
    signal = chirp(0.4, 5.0, 4.0, 3.0)
    values = np.array([signal(time) for time in np.arange(0.0, 4.0, 0.001)])
    assert np.abs(np.diff(values)).max() / 0.001 < 3.6  # its amplitude falls, too


def test_an_excitation_fades_to_its_middle() -> None:
    middle = np.array([0.1, -0.2, 0.3])
    excitation = Excitation((still(), still(), still()), middle, np.ones(3), 2.0)
    assert excitation.goal(0.0) == pytest.approx(np.zeros(3))
    assert excitation.goal(FADE) == pytest.approx(middle)
