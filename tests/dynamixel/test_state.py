from __future__ import annotations

import math
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.dynamixel.health_block import places_in_block
from robolamp.dynamixel.registers import MODELS
from robolamp.dynamixel.servo_state import COLUMNS, UNKNOWN, Answer, Layout, Scales


def answer(error: int = 0, **counts: int) -> Answer:
    """Return an answer with some registers; what is not given is unknown."""
    given = {name.replace("_", " ").lower(): value for name, value in counts.items()}
    return Answer(error, tuple(given.get(name.lower(), gap) for name, gap in zip(COLUMNS, UNKNOWN, strict=True)))


@given(st.binary(min_size=20, max_size=20), st.randoms(use_true_random=False))
@pytest.mark.parametrize("model", MODELS)
def test_layout_reads_each_register_where_it_is(model: str, data: bytes, random: Random) -> None:
    registers, places = MODELS[model].registers, places_in_block()
    rows = [(registers[name], *places[name]) for name in COLUMNS if name in registers]
    random.shuffle(rows)
    expected = dict(zip(COLUMNS, UNKNOWN, strict=True))
    expected |= {row.name: int.from_bytes(data[at : at + size], "little", signed=row.signed) for row, at, size in rows}
    assert Layout(rows).values(data) == pytest.approx(tuple(expected.values()), abs=0, nan_ok=True)


def test_gaps_stay_gaps() -> None:
    models = [MODELS["XL330-M288-T"], MODELS["XL430-W250-T"], MODELS["XL330-M288-T"]]
    answers = [None, answer(0x80, present_position=2048, present_current=1), answer(torque_enable=1)]
    state = Scales(models).state(answers, [True, True, False], np.array([5, 5, np.nan]))
    assert np.isnan(state.position).tolist() == [True, False, True]
    assert state.position[1] == pytest.approx(math.pi)
    assert np.isnan([state.current, state.voltage]).all()
    assert state.torque.tolist() == [-1, -1, 1]
    assert state.error.tolist() == [-1, 0x80, 0]
    assert state.asked_again.tolist() == [False, True, False]
    assert not state.goal_lost.any()


def test_a_goal_is_lost_only_where_torque_is_on_and_both_are_known() -> None:
    model = MODELS["XL330-M288-T"]
    found = [
        answer(torque_enable=1, goal_position=7),
        answer(torque_enable=1, goal_position=8),
        answer(torque_enable=0, goal_position=8),
        answer(torque_enable=1),
        answer(torque_enable=1, goal_position=8),
    ]
    state = Scales([model] * 5).state(found, [False] * 5, np.array([7, 7, 7, 7, np.nan]))
    assert state.goal_lost.tolist() == [False, True, False, False, False]
