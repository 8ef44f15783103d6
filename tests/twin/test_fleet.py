from __future__ import annotations

from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest

from robolamp.controller.controller_file import Controller, load_controller
from robolamp.controller.expression import parse
from robolamp.controller.pilot import Pilot
from robolamp.controller.program import compile_program
from robolamp.errors import RobolampError
from robolamp.signals import Command
from robolamp.twin.bend import Bend
from robolamp.twin.judges.lamp_judge import Outcome
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.lanes.fleet import Fleet, Job
from robolamp.twin.lanes.lamp_lanes import SETTLE_TIME
from robolamp.twin.twin_lamp import TwinLamp

from .parts import ASSETS, FALL, HEAVY, LAMP, PERIOD, STAND, SWAY, TERMINALS, TWIN, N, bent, program, rows

SEES_ALL = ("(* 0.3 (- px vx))", "(+ vz (* 0.4 goal_met))", "(- pz (* 0.1 py))")
HOP = load_controller(ASSETS.path("sim/lamp/controllers/hop-counting.toml"), LAMP).compile(TERMINALS)
PROGRAMS = [program(*SWAY), program(*SEES_ALL), HOP, program(*FALL)]
JOBS = [Job(index, lamp, goal) for index in range(4) for lamp in (0, 1) for goal in (0.01, 0.25, 0.4)]


@pytest.fixture(scope="module")
def whole() -> Outcome:
    return Fleet([TWIN, HEAVY], PERIOD, 1).run(PROGRAMS, JOBS, 1.0)


def test_the_lanes_do_different_things(whole: Outcome) -> None:
    assert len(np.unique(rows(whole), axis=0)) == len(JOBS)
    assert 0 < whole.fallen.sum() < len(JOBS)
    assert whole.hops.max() > 0
    assert whole.hit_1997.any()
    assert not whole.unstable.any()


@pytest.mark.parametrize("workers", [2, 3, 40])
def test_any_number_of_workers_gives_the_same_to_the_bit(whole: Outcome, workers: int) -> None:
    fleet = Fleet([TWIN, HEAVY], PERIOD, workers)
    assert (rows(fleet.run(PROGRAMS, JOBS, 1.0)) == rows(whole)).all()
    alive = ~whole.fallen
    assert fleet.steps <= len(JOBS) * 500
    assert fleet.steps >= alive.sum() * 500


def test_any_order_and_subset_of_jobs_gives_the_same_to_the_bit(whole: Outcome) -> None:
    order = np.random.default_rng(3).permutation(len(JOBS))[:9]
    fleet = Fleet([TWIN, HEAVY], PERIOD, 2)
    for _ in range(2):  # a fleet remembers nothing
        some = fleet.run(PROGRAMS, [JOBS[index] for index in order], 1.0)
        assert (rows(some) == rows(whole)[order]).all()


def driven(twin: TwinModel, texts: tuple[str, ...], goal: float, duration: float) -> Outcome:
    """One lamp, tick by tick, as the loop drives it."""
    pilot = Pilot(
        Controller("c", "", "position", PERIOD, tuple(parse(text, TERMINALS) for text in texts), LAMP.names), LAMP, goal
    )
    lamp = TwinLamp(twin, goal, duration)
    lamp.open()
    lamp.torque(True)
    lamp.clock.sleep_until(SETTLE_TIME)
    mujoco.mj_forward(lamp.body.model, lamp.body.data)  # a fleet begins with the forces of this state, too
    lamp.start_judging()
    pilot.reset(np.zeros(N))
    for tick in range(round(duration / PERIOD)):
        lamp.command(Command(pilot.step(lamp.observe(), tick * PERIOD).goal))
        lamp.clock.sleep_until(SETTLE_TIME + (tick + 1) * PERIOD)
    return lamp.outcome


@pytest.mark.parametrize("line_delay", [0.0, 0.004, 0.02, 0.05])
@pytest.mark.parametrize("texts", [SWAY, STAND])
def test_a_lane_is_a_lamp_driven_tick_by_tick(line_delay: float, texts: tuple[str, ...]) -> None:
    twins = [replace(twin, line_delay=line_delay) for twin in (TWIN, HEAVY)]
    lanes = Fleet(twins, PERIOD, 2).run([program(*texts)], [Job(0, 0, 0.3), Job(0, 1, 0.2)], 1.0)
    for lane, (twin, goal) in enumerate(zip(twins, (0.3, 0.2), strict=True)):
        alone = driven(twin, texts, goal, 1.0)
        for item in fields(Outcome):
            if item.name not in ("interventions", "trace"):
                found, expected = getattr(lanes, item.name)[lane], getattr(alone, item.name)[0]
                np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9, err_msg=item.name)


def test_each_lane_has_its_own_time_to_take() -> None:
    texts = ("(* 0.1 goal_time)", "0", "0")
    jobs = [Job(0, 0, 0.3, 1.0), Job(0, 0, 0.3, 2.0), Job(0, 0, 0.3)]
    outcome = Fleet([TWIN], PERIOD, 2).run([program(*texts)], jobs, 0.5)
    assert outcome.goal_time.tolist() == [1.0, 2.0, 0.0]
    assert outcome.angles[:, 0] == pytest.approx([0.1, 0.2, 0.0], abs=0.1)  # it gives under its weight
    assert np.diff(outcome.angles[[2, 0, 1], 0]) == pytest.approx([0.1, 0.1], abs=0.04)


INFINITE = "(* 1e300 1e300)"


@pytest.mark.parametrize("bad", [f"(- {INFINITE} {INFINITE})", INFINITE, "1e300", "-1e300", "(% t 5e-324)"])
def test_a_controller_that_gives_nonsense_is_survived_and_scored(bad: str) -> None:
    jobs = [Job(0, 0, 0.3), Job(1, 0, 0.3)]
    fleet = Fleet([TWIN], PERIOD, 2)
    outcome = fleet.run([program("0", bad, "0"), program(*STAND)], jobs, 1.0)
    assert np.isfinite(outcome.x).all()
    assert np.isfinite(outcome.error).all()
    assert not outcome.unstable.any()
    assert outcome.interventions[0] >= 20
    assert outcome.interventions[1] == 0
    assert (rows(outcome)[1] == rows(fleet.run([program(*STAND)], jobs[:1], 1.0))[0]).all()


def test_the_time_of_a_divergence_is_known_to_controllers_without_a_clock() -> None:
    wild, terminals = bent(Bend(strength=1e9)), ("a0", "goal_dist")
    swing = compile_program([parse("(- 0.2 a0)", TERMINALS)] * N, terminals)
    late = compile_program([parse("(ifltz (- t 0.3) 0 (- 0.2 a0))", TERMINALS)] * N, TERMINALS)
    early = Fleet([wild], PERIOD, 1).run([swing], [Job(0, 0, 0.3)], 1.0)
    told = Fleet([wild], PERIOD, 1).run([late], [Job(0, 0, 0.3)], 1.0)
    assert (early.unstable, told.unstable) == (True, True)
    assert early.fall_time == pytest.approx(0.0, abs=0.1)
    with_clock = compile_program([parse("(- 0.2 a0)", TERMINALS)] * N, TERMINALS)
    assert (rows(early) == rows(Fleet([wild], PERIOD, 1).run([with_clock], [Job(0, 0, 0.3)], 1.0))).all()


def test_a_simulation_that_diverges_is_a_flagged_fall_and_harms_no_neighbour() -> None:
    wild = bent(Bend(strength=1e9))
    jobs = [Job(0, 0, 0.01), Job(0, 1, 0.01), Job(0, 0, 0.2)]
    outcome = Fleet([TWIN, wild], PERIOD, 1).run([program(*SWAY)], jobs, 1.0)
    assert outcome.unstable.tolist() == [False, True, False]
    assert outcome.fallen.tolist() == [False, True, False]
    assert outcome.fall_time[1] < 0.5
    assert outcome.hit_1997.tolist() == [True, False, False]
    calm = Fleet([TWIN], PERIOD, 1).run([program(*SWAY)], [Job(0, 0, 0.01), Job(0, 0, 0.2)], 1.0)
    assert (rows(outcome)[[0, 2]] == rows(calm)).all()


def test_a_period_that_is_not_whole_physics_steps_is_refused() -> None:
    for period in (0.003, 0.0201, 0.001):
        with pytest.raises(RobolampError, match=r"not a whole number of physics steps of 0\.002 s"):
            Fleet([TWIN], period, 1)
    with pytest.raises(ValueError, match="no jobs"):
        Fleet([TWIN], PERIOD, 1).run(PROGRAMS, [], 1.0)
