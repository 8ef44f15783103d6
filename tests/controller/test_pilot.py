from __future__ import annotations

import numpy as np
import pytest

from robolamp.controller.controller_file import Controller
from robolamp.controller.expression import parse
from robolamp.controller.pilot import Pilot
from robolamp.errors import ExpressionError
from robolamp.signals import Health, Observation

from .parts import LAMP, TERMINALS


def controller(*texts: str) -> Controller:
    return Controller("c", "", "position", 0.02, tuple(parse(text, TERMINALS) for text in texts), LAMP.names)


def seen(angle: tuple[float, float, float] = (0.0, 0.0, 0.0), force: float = 2.0) -> Observation:
    gap = np.zeros(3)
    return Observation(0.0, np.array(angle), gap, gap, gap, force, 0.0, Health.unknown(3))


def test_a_step_reads_signals_runs_the_program_and_keeps_the_envelope() -> None:
    pilot = Pilot(controller("(* t 0.5)", "(% a0 0)", "(- a2 goal_dist)"), LAMP, 0.25)
    pilot.reset(np.zeros(3))
    step = pilot.step(seen((0.1, 0.2, 0.3)), 0.0)
    assert dict(zip(pilot.terminals, step.inputs, strict=True))["goal_dist"] == 0.25
    assert step.outputs == pytest.approx([0.0, 1.0, 0.05])
    assert step.goal == pytest.approx([0.0, 14.0 * 0.02, 0.05])
    assert (step.interventions.limited, step.interventions.slewed) == (1, 1)
    assert step.contact
    step = pilot.step(seen((0.1, 0.2, 0.3)), 0.02)
    assert step.outputs[0] == pytest.approx(0.01)
    assert step.goal[1] == pytest.approx(0.56)


def test_ticks_that_were_missed_are_counted_by_the_schedule() -> None:
    pilot = Pilot(controller("t", "w0", "0"), LAMP, 0.3)
    pilot.step(seen(), 0.0)
    step = pilot.step(seen((0.12, 0.0, 0.0)), 0.06)
    assert step.outputs == pytest.approx([0.06, 2.0, 0.0])


def test_a_reset_begins_anew_from_what_the_joints_hold() -> None:
    pilot = Pilot(controller("0.5", "(% 0 0)", "hops"), LAMP, 0.3)
    for tick, force in enumerate([2.0, 0.0, 0.0, 0.0, 0.0, 2.0]):
        step = pilot.step(seen(force=force), 0.02 * tick)
    assert step.hops == 1
    pilot.reset(np.array([0.5, 0.3, 0.0]))
    step = pilot.step(seen(), 0.0)
    assert step.hops == 0
    assert step.interventions.total == 2  # knee asks for 1 rad: past its limit, and too fast
    assert step.goal[0] == 0.5


def test_a_signal_that_the_lamp_has_not_is_refused_by_name() -> None:
    with pytest.raises(ExpressionError, match=r"joints\.knee: needs px vz, which this lamp cannot supply"):
        Pilot(controller("t", "(+ px (* vz a0))", "0"), LAMP, 0.3)


def test_the_time_to_take_is_a_signal_where_it_is_commanded() -> None:
    reads = controller("(* 0.1 goal_time)", "0", "0")
    pilot = Pilot(reads, LAMP, 0.3, goal_time=2.5)
    step = pilot.step(seen(), 0.0)
    assert dict(zip(pilot.terminals, step.inputs, strict=True))["goal_time"] == 2.5
    assert step.outputs[0] == pytest.approx(0.25)
    assert "goal_time" not in Pilot(controller("t", "0", "0"), LAMP, 0.3).terminals
    with pytest.raises(ExpressionError, match=r"joints\.ankle: reads goal_time, .*--goal-time SECONDS"):
        Pilot(reads, LAMP, 0.3)
