"""One hop counter: the terminal, the judge, a comparison, a calibration and the truth count the same flights."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.calibrate.lamp.floor_fit import flights as flights_by_contact
from robolamp.compare.replays.trajectory import Side
from robolamp.compare.travel.sensed_flights import UNSEEN, flights
from robolamp.controller.hop_counter import SignalLimits, shortest_flight
from robolamp.controller.terminals import Signals
from robolamp.log.reader import Run, Truth
from robolamp.twin.judges.lamp_judge import Judge
from robolamp.twin.judges.true_flights import Flown, flown
from robolamp.twin.lamp_model import build

from .lamps import ASSETS, CALIBRATION, LAMP

STEP = 0.002  # of the physics [s]
LEAST = 80  # ms: hardware/lamp.toml's
TWIN = build(LAMP, CALIBRATION, ASSETS)
SPEED = 0.5  # m/s, of the base in the air

# Times off the floor and on it, in ms; a tick is 10 or 20 ms, and no stance slips between two of them.
gaps = st.lists(st.tuples(st.integers(1, 100), st.integers(21, 100)), max_size=12).map(
    lambda pairs: [(2 * air, 2 * ground) for air, ground in pairs]
)
starts = st.integers(100, 130).map(lambda steps: 2 * steps)


def force_of(start: int, gaps: list[tuple[int, int]]) -> np.ndarray:
    """Floor force at each physics step: standing first, then off and on the floor."""
    parts = [np.full(start // 2, 2.0)]
    for air, ground in gaps:
        parts += [np.zeros(air // 2), np.full(ground // 2, 2.0)]
    return np.concatenate([*parts, np.full(20, 2.0)])


def by_terminal(force: np.ndarray, tick: float, elapsed: np.ndarray) -> int:
    signals = Signals(1, 3, SignalLimits.of(LAMP, tick), ("hops",))
    for one, passed in zip(force, elapsed, strict=True):
        signals.update(np.zeros((1, 3)), np.array([one]), np.zeros(1), elapsed=int(passed))
    return int(signals.hops[0])


def by_comparison(force: np.ndarray, time: np.ndarray) -> int:
    empty = np.zeros((force.size, 3))
    return len(flights(Side("lamp", empty, empty, empty, empty, force, time, 0, None, math.nan, None), LAMP))


def by_calibration(force: np.ndarray, tick: float) -> int:
    least = shortest_flight(LAMP.flight_time, tick)
    return len(flights_by_contact(force > 0.0, tick * np.arange(force.size), least))


def by_judge(force: np.ndarray, clearance: float = 0.01, tilt: float = 0.0) -> float:
    judge = Judge(TWIN, np.zeros(1), 1.0)
    judge.begin(np.zeros(1))
    qpos = np.zeros((1, TWIN.model.nq))
    upright, one = np.cos(tilt / 2), np.zeros(1, np.int64)
    for carried in force > 0.0:
        qpos[0, 0] += 0.0 if carried else SPEED * STEP
        qpos[0, 2:7] = [0.0 if carried else clearance, upright, 0.0, np.sin(tilt / 2), 0.0]
        judge.step(one, qpos, np.array([2.0 * carried]), np.ones(1), np.ones(1))
    return float(judge.hops[0])


def by_truth(force: np.ndarray, clearance: float = 0.01, tilt: float = 0.0) -> Flown:
    """What a truth log of these steps tells: the largest force of each two, every 4 ms."""
    force = force[: force.size // 2 * 2].reshape(-1, 2)
    air = force.max(axis=1) == 0.0
    x = np.cumsum((force == 0.0).sum(axis=1)) * SPEED * STEP
    time = 2 * STEP * np.arange(len(force))
    stamps = np.rint(time * 1e9).astype(np.int64)
    truth = SimpleNamespace(
        log_time=stamps, base_x=x, clearance=np.where(air, clearance, 0.0), pitch=np.full(len(force), -tilt),
        force=force.max(axis=1),
    )  # fmt: skip
    run = SimpleNamespace(
        phase=np.array(["run"]), scheduled=np.zeros(1), write_done=time[-1:], at=lambda stamps: stamps * 1e-9
    )
    return flown(cast(Run, run), cast(Truth, truth), LAMP)


@given(starts, gaps, st.sampled_from([0.01, 0.02]))
def test_flights_count_and_rebounds_do_not_whoever_counts(start: int, gaps: list[tuple[int, int]], tick: float) -> None:
    force = force_of(start, gaps)
    always = sum(air >= LEAST for air, _ in gaps)
    sampled = force[:: round(tick / STEP)]
    counted = by_terminal(sampled, tick, np.ones(sampled.size))
    # A tick sees no more than that a gap was longer than LEAST less a tick.
    assert always <= counted <= sum(air > LEAST - 1e3 * tick for air, _ in gaps)
    assert by_comparison(sampled, tick * np.arange(sampled.size)) == counted
    assert by_calibration(sampled, tick) == counted
    assert by_judge(force) == always
    assert always <= by_truth(force).hops <= sum(air >= LEAST - 4 for air, _ in gaps)


@given(starts, gaps, st.lists(st.sampled_from(["", "", "", "missed", "no reading"]), min_size=400, max_size=400))
def test_missed_ticks_and_gaps_of_the_sensor_are_counted_alike(
    start: int, gaps: list[tuple[int, int]], marks: list[str]
) -> None:
    force = force_of(start, gaps)[::10][:400]
    mark = np.array(marks[: force.size])
    mark[:2] = mark[-1] = ""
    force = np.where(mark == "no reading", np.nan, force)
    there = np.flatnonzero(mark != "missed")
    counted = by_terminal(force[there], 0.02, np.diff(there, prepend=-1))
    read = 0.02 * there[np.isfinite(force[there])]
    # Of what nobody saw for long compare says nothing; and at least half of the ticks ran.
    if np.median(np.diff(there)) == 1 and np.diff(read).max(initial=0.0) <= UNSEEN:
        assert by_comparison(force[there], 0.02 * there) == counted


@pytest.mark.parametrize(
    ("clearance", "degrees", "hops"), [(0.0019, 0.0, 0), (0.0021, 0.0, 1), (0.03, 14.0, 1), (0.03, 16.0, 0)]
)
def test_in_truth_a_hop_clears_the_floor_and_lands_flat(clearance: float, degrees: float, hops: int) -> None:
    force, tilt = force_of(200, [(120, 400)]), math.radians(degrees)
    height = clearance + TWIN.foot_radius * math.sin(tilt) * (degrees > 0.0)
    seen = by_truth(force, clearance, tilt)
    assert by_judge(force, height, tilt) == hops
    assert seen.hops == hops
    [flight] = seen.flights
    assert flight.on - flight.off == pytest.approx(0.12, abs=0.0041)
    assert flight.way == pytest.approx(SPEED * 0.12, abs=0.003)
    assert seen.travel == pytest.approx(SPEED * 0.12)
    assert seen.flight_share == pytest.approx(float(hops), abs=0.05)


def test_the_share_of_flight_is_unknown_of_a_lamp_that_stood() -> None:
    assert math.isnan(by_truth(force_of(200, [])).flight_share)


def test_another_lamps_time_holds_wherever_hops_are_counted() -> None:
    quick = dataclasses.replace(LAMP, flight_time=0.04)
    force = force_of(200, [(60, 200), (60, 200), (18, 200)])
    sampled = force[::10]
    limits = SignalLimits.of(quick, 0.02)
    signals = Signals(1, 3, limits, ("hops",))
    for one in sampled:
        signals.update(np.zeros((1, 3)), np.array([one]), np.zeros(1))
    empty: Any = np.zeros((sampled.size, 3))
    side = Side("lamp", empty, empty, empty, empty, sampled, 0.02 * np.arange(sampled.size), 0, None, math.nan, None)
    assert (int(signals.hops[0]), len(flights(side, quick)), len(flights(side, LAMP))) == (2, 2, 0)
