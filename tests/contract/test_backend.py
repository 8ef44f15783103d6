"""One suite for every lamp backend: what `robolamp.signals.LampBackend` promises."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest

from robolamp.controller.pilot import PilotStep
from robolamp.errors import SafetyError
from robolamp.runtime.loop import run
from robolamp.signals import Command, Interventions, LampBackend, Observation, Tick

from .backends import BACKENDS, LAMP

N = len(LAMP.joints)


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Iterator[LampBackend]:
    with BACKENDS[request.param]() as backend:
        backend.open()
        yield backend


def hold(backend: LampBackend, goal: np.ndarray, seconds: float) -> Observation:
    """Command a pose every 20 ms, as the loop does, and return the last observation."""
    end = backend.clock.now() + seconds
    while True:
        seen = backend.observe()
        backend.command(Command(goal))
        if backend.clock.now() >= end:
            return seen
        backend.clock.sleep_until(backend.clock.now() + 0.02)


def test_an_observation_is_complete(backend: LampBackend) -> None:
    assert backend.joints == LAMP.names
    backend.clock.sleep_until(backend.clock.now() + 0.05)
    seen = backend.observe()
    for values in (seen.angle, seen.velocity, seen.current, seen.angle_age, seen.health.voltage):
        assert values.shape == (N,)
        assert np.isfinite(values).all()
    assert np.abs(seen.angle) == pytest.approx(np.zeros(N), abs=0.05)  # it starts in the neutral pose
    assert (seen.angle_age < 0.1).all()
    assert (seen.angle_age >= 0.0).all()
    assert seen.foot_force == pytest.approx(2.1, abs=0.4)  # it stands on its foot
    assert 0.0 <= seen.foot_age < 0.1
    assert seen.health.torque.tolist() == [0] * N
    assert seen.health.hardware_error.tolist() == [0] * N
    assert seen.faults == ()


def test_its_servos_are_described(backend: LampBackend) -> None:
    traits = backend.traits
    assert traits.lowest_voltage.shape == (N,)
    assert (traits.lowest_voltage < backend.observe().health.voltage).all()
    assert 0.0 <= traits.tick_time < 0.02
    assert traits.error_words(0x20)


def test_time_goes_forward(backend: LampBackend) -> None:
    first = backend.observe()
    backend.clock.sleep_until(first.time + 0.1)
    second = backend.observe()
    assert second.time >= first.time + 0.1
    assert backend.clock.now() >= second.time


def test_torque_on_does_not_move(backend: LampBackend) -> None:
    before = backend.observe().angle
    backend.torque(True)
    backend.clock.sleep_until(backend.clock.now() + 0.1)
    seen = backend.observe()
    assert seen.health.torque.tolist() == [1] * N
    assert seen.angle == pytest.approx(before, abs=0.05)


def test_every_joint_follows_its_goal(backend: LampBackend) -> None:
    backend.torque(True)
    for goal in (np.zeros(N), np.array([0.08, -0.3, 0.2]), np.array([-0.08, 0.3, -0.2])):
        seen = hold(backend, goal, 0.6)
        assert (np.abs(seen.angle - goal) < [0.06, 0.17, 0.06]).all()  # the knee carries the head: it sags by 0.12 rad


def test_a_goal_that_must_not_be_is_refused(backend: LampBackend) -> None:
    backend.torque(True)
    hold(backend, np.zeros(N), 0.1)
    for bad in (math.nan, math.inf, -math.inf, 1e300, 0.86, -1.2):
        with pytest.raises(SafetyError):
            backend.command(Command(np.array([0.3, bad, 0.3])))
    backend.clock.sleep_until(backend.clock.now() + 0.1)
    assert backend.observe().angle == pytest.approx(np.zeros(N), abs=0.05)


def test_torque_off_and_close_may_be_repeated(backend: LampBackend) -> None:
    backend.torque(False)
    backend.torque(True)
    backend.torque(False)
    assert backend.observe().health.torque.tolist() == [0] * N
    backend.torque(False)
    backend.close()
    backend.close()


def test_the_loop_runs_on_it(backend: LampBackend) -> None:
    class Nod:
        def step(self, observation: Observation, time: float) -> PilotStep:
            goal = np.array([0.0, 0.0, 0.2 * math.sin(8 * time)])
            return PilotStep(np.array([time]), goal, goal, 0, True, Interventions())

    ticks: list[Tick] = []
    result = run(backend, Nod(), LAMP, duration=0.8, on_tick=ticks.append)
    assert (result.ended, result.reason) == ("finished", "")
    phases = Counter(tick.phase for tick in ticks)
    assert (phases["start"], phases["landing"]) == (100, 51)  # soft moves make up for ticks that were missed
    assert 40 - result.missed_ticks <= phases["run"] <= 40
    assert backend.observe().health.torque.tolist() == [0] * N
    nod = np.array([tick.observation.angle[2] for tick in ticks if tick.phase == "run"])
    assert np.nanmax(nod) > 0.1
    assert np.nanmin(nod) < -0.1
