"""The driver and the loop on an emulated lamp in lockstep, with faults at exact moments."""

from __future__ import annotations

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.pilot import PilotStep
from robolamp.emulator.faults import Event, Faults
from robolamp.emulator.lamp import EmulatedLamp
from robolamp.emulator.lockstep import Lockstep
from robolamp.emulator.reality import load_reality
from robolamp.lamp import load_lamp
from robolamp.robot.lamp import RobotLamp
from robolamp.runtime.loop import run
from robolamp.runtime.result import RunResult
from robolamp.signals import Interventions, Observation, Tick

LAMP = load_lamp(Assets())


class Still:
    def step(self, observation: Observation, time: float) -> PilotStep:
        goal = np.zeros(3)
        return PilotStep(np.empty(0), goal, goal, 0, True, Interventions())


def go(*events: Event, resume: bool = False) -> tuple[RunResult, list[Tick], RobotLamp, EmulatedLamp]:
    world = EmulatedLamp(
        LAMP,
        load_calibration(Assets()),
        Assets(),
        load_reality("none", LAMP, Assets()),
        faults=Faults("script", 1, events=events),
    )
    ports = Lockstep(world, LAMP.bus_baud)
    robot = RobotLamp(LAMP, ports.servo_port, ports.foot_port, ports.clock)
    robot.open()
    ticks: list[Tick] = []
    result = run(
        robot, Still(), LAMP, duration=1.0, on_tick=ticks.append, reconnect=robot.reconnect if resume else None
    )
    robot.close()
    return result, ticks, robot, world


def test_a_tick_is_one_reading_and_one_write() -> None:
    result, ticks, robot, _ = go()
    assert (result.ended, result.missed_ticks, result.faults) == ("finished", 0, {})
    assert robot.transport == ""  # closed
    # Fast sync read of 3 x 17 to 19 bytes: 17 + 8 + 3 x 23 bytes of 10 us; nothing waits for anything.
    reading = np.array([tick.read_done - tick.began for tick in ticks])
    assert reading.max() < 0.0012


def test_a_lost_answer_is_asked_for_again_within_the_tick() -> None:
    result, ticks, _, world = go(Event("dropped", at=2.6, stream="status"), Event("dropped", at=2.8, stream="status"))
    assert len(world.injector.injections) == 2
    assert result.ended == "finished"
    assert not any(np.isnan(tick.observation.angle).any() for tick in ticks)
    assert max(tick.read_done - tick.began for tick in ticks) < 0.006


def test_a_silent_servo_costs_two_milliseconds_and_its_own_data() -> None:
    result, ticks, _, _ = go(Event("silent", at=2.5, servo=2, lasts=0.06))
    assert result.ended == "finished"
    gaps = [tick for tick in ticks if np.isnan(tick.observation.angle).any()]
    assert 2 <= len(gaps) <= 4
    assert all(np.isnan(tick.observation.angle).tolist() == [False, True, False] for tick in gaps)
    assert all(tick.read_done - tick.began < 0.0035 for tick in gaps[1:])  # the reading itself takes 1 ms
    assert result.held_ticks == len(gaps)


def test_a_servo_that_reboots_lands_the_lamp() -> None:
    result, ticks, _, _ = go(Event("reboot", at=2.5, servo=2))
    assert result.ended == "guard"
    assert result.reason in {"knee: torque went off", "knee: no answer for 0.1 s"}
    assert not any((np.abs(tick.observation.angle) > 1.5).any() for tick in ticks)  # an empty block is no angle


def test_an_overload_lands_the_lamp() -> None:
    result, _, _, _ = go(Event("overload", at=2.5, servo=2))
    assert result.ended == "guard"
    assert "knee: hardware error (overload)" in result.faults


@pytest.mark.parametrize("lasts", [0.5, 3.0])
def test_a_port_that_comes_back_is_taken_up_again_if_told(lasts: float) -> None:
    result, ticks, robot, world = go(Event("unplugged", at=2.5, lasts=lasts, port="servo"), resume=True)
    assert (result.ended, result.replugs) == ("finished", 1)
    back = next(i for i, tick in enumerate(ticks) if tick.scheduled > 2.5 + lasts)
    goals = np.array([tick.goal for tick in ticks[back - 1 :]])
    assert np.abs(goals[1] - ticks[back].observation.angle).max() < 0.02  # goal := present
    assert np.abs(np.diff(goals[1:], axis=0)).max() < 0.04
    assert robot.left_on == ()
    assert not world.plant.truth().fallen


def test_a_port_that_comes_back_untold_ends_the_run() -> None:
    result, _, robot, _ = go(Event("unplugged", at=2.5, lasts=60.0, port="servo"))
    assert (result.ended, result.replugs) == ("cut", 0)
    assert robot.left_on == LAMP.names


def test_a_run_with_faults_repeats_exactly() -> None:
    runs = [go(Event("unplugged", at=2.4, lasts=0.4, port="servo"), resume=True)[1] for _ in range(2)]
    assert [tick.read_done for tick in runs[0]] == [tick.read_done for tick in runs[1]]
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one.observation.angle, other.observation.angle)
