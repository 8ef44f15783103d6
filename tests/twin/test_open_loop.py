"""The bank: one score on many twins, goals within a physics step among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.open_loop import GoalSchedule, Member, Record, play_bank

from .parts import ASSETS, CALIBRATION, LAMP

TWIN = build(LAMP, CALIBRATION, ASSETS)
SCORE = GoalSchedule(
    begin=0.0, end=0.2, powered=0.0, pose=np.zeros(3), hold=np.zeros(3), sent=np.array([0.05]),
    goal=np.array([[0.05, 0.1, -0.05]]),
)  # fmt: skip


def play(late: float, *, member: float = 0.0) -> Record:
    """Play a step of the goals, sent that many physics steps later, on a member that takes goals that much later."""
    score = replace(SCORE, sent=SCORE.sent + late * TWIN.timestep)
    return play_bank([Member(TWIN, late=member * TWIN.timestep)], score, workers=1)


def test_a_goal_that_arrives_within_a_step_lies_between_the_steps():
    whole, half, next_whole = play(0.0).angle[:, 0], play(0.5).angle[:, 0], play(1.0).angle[:, 0]
    assert np.abs(whole - next_whole).max() > 1e-3
    # Friction is not linear: not quite in the middle. Rounded to a step it would be half of the way off.
    assert np.abs(half - (whole + next_whole) / 2).max() < 0.15 * np.abs(whole - next_whole).max()


@pytest.mark.parametrize("steps", [-3, 0, 4])
def test_a_member_that_is_late_is_one_whose_goals_are_sent_later(steps):
    assert np.array_equal(play(0.0, member=steps).angle, play(float(steps)).angle)


def test_a_goal_sent_before_the_beginning_holds_from_there():
    early = play_bank([Member(TWIN)], replace(SCORE, sent=np.array([-0.01])), workers=1)
    assert np.array_equal(early.angle, play_bank([Member(TWIN)], replace(SCORE, sent=np.zeros(1)), workers=1).angle)
