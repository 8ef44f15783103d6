from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from robolamp.runtime.health import (
    ANGLE_AGE,
    FOOT_AGE,
    FOOT_AGE_STOP,
    FOOT_STUCK,
    FOOT_STUCK_AIR,
    GOALS_LOST,
    TEMPERATURE,
    VOLTAGE_TIME,
    Action,
    Guard,
)
from robolamp.signals import Observation

from .fake import LAMP, TRAITS, FakeLamp


def observation(change: Callable[[Observation], None] = lambda o: None) -> Observation:
    lamp = FakeLamp(change)
    lamp.on = True
    return lamp.observe()


def test_a_healthy_lamp() -> None:
    guard = Guard(LAMP, TRAITS)
    assert guard.check(observation()) == Action.GO
    assert not guard.faults


def change(name: str, value: float) -> Callable[[Observation], None]:
    """Set the knee's entry of a health array."""

    def apply(o: Observation) -> None:
        getattr(o.health, name)[1] = value

    return apply


def age(*joints: int) -> Callable[[Observation], None]:
    def apply(o: Observation) -> None:
        o.angle[list(joints)] = np.nan
        o.angle_age[list(joints)] = ANGLE_AGE * 1.01

    return apply


def stood_still(o: Observation) -> None:
    """A reading in the midst of which this computer stood still, such as a process that was suspended."""
    o.angle_age[:] = ANGLE_AGE * 1.01


def foot(age: float) -> Callable[[Observation], None]:
    def apply(o: Observation) -> None:
        o.foot_age = age

    return apply


@pytest.mark.parametrize(
    ("spoil", "verdict", "text"),
    [
        (change("hardware_error", 0x20), Action.LAND, "knee: hardware error (overload)"),
        (change("torque", 0), Action.LAND, "knee: torque went off"),
        (change("temperature", TEMPERATURE + 1), Action.LAND, "knee: above 65 degC"),
        (change("voltage", 3.4), Action.GO, "knee: supply below 3.5 V"),
        (age(1), Action.LAND, "knee: no answer for 0.1 s"),
        (age(0, 1, 2), Action.CUT, "no servo has answered for 0.1 s"),
        (stood_still, Action.CUT, "a reading took more than 0.1 s: this computer stood still"),
        (foot(FOOT_AGE * 1.01), Action.GO, "foot: no force for 0.05 s"),
        (foot(FOOT_AGE_STOP * 1.01), Action.LAND, "foot: no force for 0.1 s"),
        (foot(float("inf")), Action.LAND, "foot: no force for 0.1 s"),
    ],
)
def test_each_fault_is_named_and_judged(spoil: Callable[[Observation], None], verdict: Action, text: str) -> None:
    guard = Guard(LAMP, TRAITS)
    assert guard.check(observation(spoil)) == verdict
    assert guard.faults[text] == 1
    assert guard.reason == (text if verdict else "")
    assert spoil is not stood_still or list(guard.faults) == [text]


@pytest.mark.parametrize("name", ["hardware_error", "torque"])
def test_unknown_is_not_a_fault(name: str) -> None:
    guard = Guard(LAMP, TRAITS)
    assert guard.check(observation(change(name, -1))) == Action.GO
    assert not guard.faults


def test_a_lasting_low_voltage_lands() -> None:
    guard = Guard(LAMP, TRAITS)

    def at(time: float, volts: float) -> Action:
        low = observation(change("voltage", volts))
        low.time = time
        return guard.check(low)

    assert [at(0.0, 3.0), at(VOLTAGE_TIME / 2, 3.0), at(VOLTAGE_TIME * 0.9, 5.0)] == [Action.GO] * 3
    assert at(VOLTAGE_TIME * 1.1, 3.0) == Action.GO  # counted anew
    assert at(VOLTAGE_TIME * 2.2, 3.0) == Action.LAND


def test_the_reason_is_that_of_now() -> None:
    guard = Guard(LAMP, TRAITS)
    guard.check(observation(change("torque", 0)))
    assert guard.reason == "knee: torque went off"
    guard.check(observation(age(0, 1, 2)))
    assert guard.reason == f"no servo has answered for {ANGLE_AGE:g} s"
    assert guard.check(observation()) == Action.GO
    assert guard.reason == ""


def over(seconds: float, name: str, value: float) -> tuple[Guard, Action]:
    """The most urgent verdict on a knee that shows a value for a time, at 50 Hz."""
    guard, worst = Guard(LAMP, TRAITS), Action.GO
    for tick in range(round(seconds * 50)):
        seen = observation()
        seen.time = tick * 0.02
        (seen.current if name == "current" else seen.health.pwm)[1] = value
        worst = max(worst, guard.check(seen))
    return guard, worst


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("pwm", -1.0, "knee: stalled, duty above 90% over 2 s"),
        ("current", -1.2, "knee: current above 0.8 A over 2 s"),
    ],
)
def test_load_that_lasts_ends_the_run(name: str, value: float, said: str) -> None:
    guard, worst = over(0.4, name, value)
    assert (worst, dict(guard.faults)) == (Action.GO, {})  # a hop is shorter
    guard, worst = over(6.0, name, value)
    assert (worst, guard.reason) == (Action.LAND, said)
    guard, worst = over(6.0, name, value / 2)
    assert worst == Action.GO
    guard, worst = over(6.0, name, math.nan)
    assert worst == Action.GO


def test_currents_count_by_their_heat() -> None:
    """Half the time 1.3 A: the mean is 0.65 A, the rms 0.92 A."""
    guard, worst = Guard(LAMP, TRAITS), Action.GO
    for tick in range(300):
        seen = observation()
        seen.time = tick * 0.02
        seen.current[1] = 1.3 * (tick % 2)
        worst = max(worst, guard.check(seen))
    assert (worst, guard.reason) == (Action.LAND, "knee: current above 0.8 A over 2 s")


def test_a_warm_servo_is_a_fault_and_goes_on() -> None:
    guard = Guard(LAMP, TRAITS)
    assert guard.check(observation(change("temperature", 62.0))) == Action.GO
    assert dict(guard.faults) == {"knee: above 60 degC": 1}


def test_torque_off_is_no_fault_where_it_is_meant_to_be() -> None:
    guard = Guard(LAMP, TRAITS, powered=False)
    assert guard.check(observation(change("torque", 0))) == Action.GO
    assert not guard.faults


@pytest.mark.parametrize(
    ("force", "moves", "lasts", "verdict"),
    [
        (2.0, 0.2, FOOT_STUCK * 0.9, Action.GO),
        (2.0, 0.2, FOOT_STUCK * 1.3, Action.LAND),
        (2.0, 0.01, 5.0, Action.GO),  # it stands still: a quiet sensor may show the same
        (0.0, 0.2, FOOT_STUCK_AIR * 0.9, Action.GO),
        (0.0, 0.2, FOOT_STUCK_AIR * 1.1, Action.LAND),
    ],
)
def test_a_force_that_never_changes_while_the_lamp_moves_is_stuck(
    force: float, moves: float, lasts: float, verdict: Action
) -> None:
    guard, worst = Guard(LAMP, TRAITS), Action.GO
    for step in range(round(lasts / 0.02) + 1):
        seen = observation()
        seen.time, seen.foot_force = step * 0.02, force
        seen.angle[1] = moves * (step % 2)
        worst = max(worst, guard.check(seen))
    assert worst == verdict
    assert bool(guard.faults) == bool(verdict)


def test_a_force_is_not_stuck_for_what_nobody_saw() -> None:
    guard = Guard(LAMP, TRAITS)
    for time, angle in ((0.0, 0.0), (0.02, 0.0), (1.0, 0.5)):  # the port was away meanwhile
        seen = observation()
        seen.time, seen.foot_force = time, 2.0
        seen.angle[1] = angle
        assert guard.check(seen) == Action.GO


@pytest.mark.parametrize(("speed", "verdict"), [(0.2, Action.GO), (0.5, Action.LAND)])
def test_a_lamp_that_creeps_presses_the_floor_with_its_weight_alone(speed: float, verdict: Action) -> None:
    guard, worst = Guard(LAMP, TRAITS), Action.GO
    for step in range(40):
        seen = observation()
        seen.time, seen.foot_force = step * 0.01, 2.119
        seen.angle[1] = 0.3 - speed * seen.time
        worst = max(worst, guard.check(seen))
    assert worst == verdict


def low(o: Observation) -> None:
    o.health.voltage[1] = 3.0


def stalled(o: Observation) -> None:
    o.health.pwm[1] = -1.0


def overloaded(o: Observation) -> None:
    o.current[1] = 1.2


def astray(o: Observation) -> None:
    o.health.goal = np.array([1, 0, 1])


def stuck(o: Observation) -> None:
    o.foot_force = 2.0
    o.angle[1] = 0.2 * (round(o.time / 0.02) % 4 < 2)


LASTING = {
    low: "knee: supply below 3.5 V",
    stalled: "knee: stalled, duty above 90% over 2 s",
    overloaded: "knee: current above 0.8 A over 2 s",
    astray: f"knee: {GOALS_LOST} goals in a row did not arrive",
    stuck: "foot: stuck, the force stays the same while the lamp moves",
}
"""What ends a run where it lasts, and why."""


def blank(o: Observation) -> None:
    """Lose what the servos say."""
    for values in (o.angle, o.velocity, o.current, o.health.voltage, o.health.temperature, o.health.pwm):
        values[:] = math.nan
    o.health.torque[:] = o.health.hardware_error[:] = -1
    o.health.goal = np.array([-1, -1, -1])


def landed(spoil: Callable[[Observation], None], lost: Callable[[int], bool], until: float = 8.0) -> tuple[float, str]:
    """When the guard lands a lamp that is spoiled in each reading that is not lost [s], and why."""
    guard = Guard(LAMP, TRAITS)
    for tick in range(1, round(until / 0.02)):
        seen = observation()
        seen.time = tick * 0.02
        spoil(seen)
        if lost(tick):
            blank(seen)
        if guard.check(seen) == Action.LAND:
            return seen.time, guard.reason
    return math.inf, ""


def stuck_in_the_air(o: Observation) -> None:
    stuck(o)
    o.foot_force = 0.0


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (low, 0.2),
        (stalled, 2.0 * math.log(10.0)),  # a mean over 2 s comes to 90 %
        (overloaded, -2.0 * math.log(1.0 - (0.8 / 1.2) ** 2)),  # a mean square over 2 s comes to (0.8 A)^2
        (astray, 0.1),
        (stuck, 0.1),
        (stuck_in_the_air, 0.5),
    ],
)
def test_how_long_what_ends_a_run_may_last(spoil: Callable[[Observation], None], expected: float) -> None:
    assert landed(spoil, lambda tick: False)[0] == pytest.approx(expected, abs=0.041)  # two ticks


@pytest.mark.parametrize("spoil", LASTING)
def test_a_lost_reading_is_not_forgotten_what_was_before(spoil: Callable[[Observation], None]) -> None:
    at, why = landed(spoil, lambda tick: False)
    assert why == LASTING[spoil]
    late, why = landed(spoil, lambda tick: tick % 3 == 1)  # one reading in three is lost
    assert why == LASTING[spoil]
    counted = {astray: 1.5, stuck: 1.7}.get(spoil, 1.0)  # by readings, not by time
    assert at <= late <= counted * at + 0.061


@pytest.mark.parametrize("spoil", [low, stalled, overloaded, astray])
def test_lost_readings_are_no_evidence(spoil: Callable[[Observation], None]) -> None:
    """Spoiled for half of what is too long, then nothing is heard, then all is well."""
    at, _ = landed(spoil, lambda tick: False)
    half = round(at / 0.02 / 2)
    guard = Guard(LAMP, TRAITS)
    for tick in range(1, 8 * half):
        seen = observation()
        seen.time = tick * 0.02
        seen.health.goal = np.array([1, 1, 1])
        if tick <= half:
            spoil(seen)
        elif tick < 6 * half:
            blank(seen)
        assert guard.check(seen) == Action.GO, (tick, guard.reason)


@pytest.mark.parametrize("spoil", [stalled, overloaded])
def test_one_reading_after_a_pause_is_not_the_whole_pause(spoil: Callable[[Observation], None]) -> None:
    guard = Guard(LAMP, TRAITS)
    for time in (0.02, 0.04, 9.0, 9.02):
        seen = observation()
        seen.time = time
        if time > 1.0:
            spoil(seen)
        assert guard.check(seen) == Action.GO, guard.reason


def test_a_goal_that_arrives_in_between_begins_the_count_anew() -> None:
    guard = Guard(LAMP, TRAITS)
    for tick in range(1, 10 * GOALS_LOST):
        seen = observation(astray if tick % GOALS_LOST else lambda o: setattr(o.health, "goal", np.ones(3, np.int64)))
        assert guard.check(seen) == Action.GO


def test_a_low_supply_before_a_pause_says_nothing_of_after_it() -> None:
    guard = Guard(LAMP, TRAITS)
    for time in (0.0, 5.0):
        seen = observation(low)
        seen.time = time
        assert guard.check(seen) == Action.GO
        guard.resume()


def test_a_force_that_nobody_measured_is_not_stuck() -> None:
    """The same for 0.08 s, then no frame for 0.04 s: not the 0.1 s of a stuck one."""
    guard = Guard(LAMP, TRAITS)
    for tick in range(7):
        seen = observation(lambda o: None)
        seen.time = tick * 0.02
        stuck(seen)
        seen.foot_age = 0.001 + max(0.0, (tick - 4) * 0.02)
        assert guard.check(seen) == Action.GO, (tick, guard.reason)
