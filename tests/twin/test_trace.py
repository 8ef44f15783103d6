from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robolamp.controller.envelope import Envelope
from robolamp.controller.program import Program
from robolamp.twin.actuators.gears import read_beyond
from robolamp.twin.bend import Bend
from robolamp.twin.judges.lamp_judge import Outcome
from robolamp.twin.lanes.fleet import Fleet, Job
from robolamp.twin.trace import Trace, follows

from .parts import FALL, HEAVY, LAMP, PERIOD, STAND, SWAY, TERMINALS, TWIN, N, bent, program, rows

TICKS = 20
DURATION = TICKS * PERIOD
FLEET = Fleet([TWIN, HEAVY], PERIOD, 1)
JOBS = [(0, 0.1), (1, 0.3)]  # lamp and goal


def recorded(programs: list[Program], fleet: Fleet = FLEET, duration: float = DURATION) -> Outcome:
    """Every program on every job, recorded."""
    jobs = [Job(index, *job) for index in range(len(programs)) for job in JOBS]
    return fleet.run(programs, jobs, duration, record=True)


def trace_of(outcome: Outcome) -> Trace:
    assert outcome.trace is not None
    return outcome.trace


def test_a_recording_changes_nothing_and_holds_what_was_seen_and_sent() -> None:
    programs = [program(*SWAY), program(*FALL)]
    outcome = recorded(programs, duration=1.0)
    jobs = [Job(index, *job) for index in range(2) for job in JOBS]
    bare = FLEET.run(programs, jobs, 1.0)
    assert bare.trace is None
    assert (rows(bare) == rows(outcome)).all()
    trace = trace_of(outcome)
    assert trace.inputs.shape == (4, 50, len(TERMINALS))
    assert trace.goals.shape == (4, 50, N)
    assert trace.ticks.tolist()[:2] == [50, 50]
    for lane in (2, 3):  # they fell, and were recorded for as long as they were simulated
        assert trace.ticks[lane] == np.ceil(outcome.fall_time[lane] / PERIOD - 1e-9)
        assert not trace.inputs[lane, trace.ticks[lane] :].any()
    column = {name: trace.inputs[:, :, index] for index, name in enumerate(TERMINALS)}
    assert column["t"][0] == pytest.approx(np.arange(50) * PERIOD)
    assert (column["goal_dist"][:2] == np.array([[0.1], [0.3]])).all()
    for lane, compiled in ((0, programs[0]), (2, programs[1])):
        envelope = Envelope(LAMP.lower, LAMP.upper, LAMP.slew, PERIOD, np.zeros(N))
        for tick in range(trace.ticks[lane]):
            wanted = np.array(compiled.run(trace.inputs[lane, tick].tolist()))
            assert (envelope.apply(wanted) == trace.goals[lane, tick]).all()


@pytest.mark.parametrize("workers", [2, 3])
def test_any_number_of_workers_records_the_same(workers: int) -> None:
    programs = [program(*SWAY), program(*FALL)]
    one = trace_of(recorded(programs))
    many = trace_of(recorded(programs, Fleet([TWIN, HEAVY], PERIOD, workers)))
    for name in ("inputs", "goals", "ticks"):
        assert (getattr(one, name) == getattr(many, name)).all()


def test_outcomes_are_joined_with_their_traces() -> None:
    whole, parts = recorded([program(*SWAY), program(*STAND)]), [recorded([program(*t)]) for t in (SWAY, STAND)]
    joined = Outcome.join(parts)
    assert (rows(joined) == rows(whole)).all()
    assert (trace_of(joined).inputs == trace_of(whole).inputs).all()
    assert (trace_of(whole).take(np.array([3])).goals == trace_of(parts[1]).goals[1:]).all()
    bare = FLEET.run([program(*SWAY)], [Job(0, 0, 0.1)], DURATION)
    assert Outcome.join([*parts, bare]).trace is None


# Programs that often, and not always, send the same: dead branches, limits that clip, signals that do not differ.
_value = st.sampled_from(
    ["0", "0.1", "-5", "-9", "0.6", "(* 0.05 a1)", "(% 0 0)", "(* 1e300 1e300)", "goal_dist", "pz"]
)
_test = st.sampled_from(["(- t 0.2)", "(- t 9)", "(- 0.5 contact)", "(- hops 1)", "(- s0 2)", "-1", "px"])
_joint = st.one_of(_value, st.tuples(_test, _value, _value).map(lambda parts: f"(ifltz {' '.join(parts)})"))
_texts = st.tuples(_joint, _joint, _joint)
_change = st.one_of(_texts, st.tuples(st.integers(0, N - 1), _joint))


@settings(max_examples=40, deadline=None)
@given(first=_texts, changes=st.lists(_change, min_size=1, max_size=4))
def test_a_program_that_follows_a_trace_has_that_run(first: tuple[str, ...], changes: list) -> None:
    others = [
        change if len(change) == N else tuple(change[1] if j == change[0] else first[j] for j in range(N))
        for change in changes
    ]
    programs = [program(*first), *(program(*texts) for texts in others)]
    real = recorded(programs)
    lanes = np.tile(np.arange(len(JOBS)), len(programs))  # each asked about the first program's lanes
    asked = np.repeat(np.arange(len(programs)), len(JOBS))
    same, interventions = follows(programs, asked, trace_of(real).take(lanes), LAMP, PERIOD)
    assert same[: len(JOBS)].all()
    sent = trace_of(real).goals.view(np.int64)
    for lane, (other, follow) in enumerate(zip(lanes, same, strict=True)):
        assert follow == (sent[lane] == sent[other]).all()
        if follow:
            assert interventions[lane] == real.interventions[lane]
            own, recalled = rows(real)[lane], rows(real)[other]
            # All but the interventions, which are the program's own.
            assert (own != recalled).sum() == (real.interventions[lane] != real.interventions[other])
        else:
            assert interventions[lane] == 0


def test_lanes_that_fell_are_followed_to_their_end_only() -> None:
    fell = recorded([program(*FALL)], duration=2.0)
    assert fell.fallen.all()
    after = float(fell.fall_time.max()) + PERIOD
    before = float(fell.fall_time.min()) - 2 * PERIOD
    programs = [program(f"(ifltz (- t {time!r}) {FALL[0]} 0)", *FALL[1:]) for time in (after, before)]
    trace = trace_of(fell)
    same, _ = follows(programs, np.array([0, 0, 1, 1]), trace.take(np.array([0, 1, 0, 1])), LAMP, PERIOD)
    assert same.tolist() == [True, True, False, False]
    real = recorded(programs, duration=2.0)
    assert (rows(real)[:2] == rows(fell)).all()
    assert (rows(real)[2:] != rows(fell)).any(axis=1).all()


def test_a_lane_that_diverged_is_followed_to_its_end_only() -> None:
    fleet = Fleet([TWIN, bent(Bend(strength=1e9))], PERIOD, 1)
    texts = ("(- 0.2 a0)", "0", "0")
    wild = fleet.run([program(*texts)], [Job(0, 1, 0.1)], 1.0, record=True)
    assert wild.unstable.all()
    late = program("(ifltz (- t 0.9) (- 0.2 a0) 0)", "0", "0")
    same, _ = follows([late], np.array([0]), trace_of(wild), LAMP, PERIOD)
    assert same.all()
    assert (rows(fleet.run([late], [Job(0, 1, 0.1)], 1.0)) == rows(wild)).all()


def test_programs_of_other_goals_and_lamps_are_told_by_what_they_saw() -> None:
    outcome = recorded([program("(ifltz (- goal_dist 0.2) 0.1 0)", "0", "0")])
    same, _ = follows([program("0.1", "0", "0")], np.zeros(2, np.int64), trace_of(outcome), LAMP, PERIOD)
    assert same.tolist() == [True, False]


def test_playback_is_the_lane_to_the_bit() -> None:
    for twin, goal in ((TWIN, 0.1), (HEAVY, 0.3)):
        fleet = Fleet([twin], PERIOD, 1)
        outcome = fleet.run([program(*SWAY)], [Job(0, 0, goal)], 1.0, record=True)
        qpos = fleet.play(Job(0, 0, goal), trace_of(outcome).goals[0], 50)
        assert qpos.shape == (51, TWIN.model.nq)
        assert qpos[-1, 0] == outcome.x[0]
        read = [read_beyond(gear, at) for gear, at in zip(twin.gears.table, qpos[-1, twin.gears.qpos], strict=True)]
        assert (qpos[-1, twin.qpos] + read == outcome.angles[0]).all()
