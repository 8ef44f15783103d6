"""The driver and the loop on an emulated lamp in lockstep, with faults at exact moments."""

from __future__ import annotations

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.pilot import PilotStep
from robolamp.dynamixel.registers import Name
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import Event, Faults, Rates
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import load_reality
from robolamp.lamp import load_lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.robot.shadow_lamp import ShadowLamp
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


def test_a_run_that_only_watches_goes_on_after_a_replug() -> None:
    script = Faults("script", events=(Event("unplugged", at=2.5, lasts=0.5, port="servo"),))
    world = EmulatedLamp(
        LAMP, load_calibration(Assets()), Assets(), load_reality("none", LAMP, Assets()), faults=script
    )
    ports = Lockstep(world, LAMP.bus_baud)
    robot = RobotLamp(LAMP, ports.servo_port, ports.foot_port, ports.clock)
    robot.open()
    torque: set[int] = set()
    world.watch(lambda lamp: torque.update(servo.register(Name.TORQUE_ENABLE) for servo in lamp.servos))
    shadow = ShadowLamp(robot, LAMP)
    result = run(shadow, Still(), LAMP, duration=1.0, powered=False, reconnect=robot.reconnect)
    robot.close()
    assert (result.ended, result.replugs, torque) == ("finished", 1, {0})


def test_a_port_that_comes_back_untold_ends_the_run() -> None:
    result, _, robot, _ = go(Event("unplugged", at=2.5, lasts=60.0, port="servo"))
    assert (result.ended, result.replugs) == ("cut", 0)
    assert robot.left_on == LAMP.names


def test_a_run_with_faults_repeats_exactly() -> None:
    runs = [go(Event("unplugged", at=2.4, lasts=0.4, port="servo"), resume=True)[1] for _ in range(2)]
    assert [tick.read_done for tick in runs[0]] == [tick.read_done for tick in runs[1]]
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one.observation.angle, other.observation.angle)


def test_an_instruction_that_is_damaged_is_told() -> None:
    _, clean, _, _ = go()
    tick = [tick for tick in clean if tick.phase == "landing"][20]  # on the move: no two goals are the same
    for at, text in (
        (tick.began - 0.001, "ankle: answered only when asked again"),  # the reading
        (tick.read_done - 0.0001, "knee: a goal did not arrive"),  # the goals: told by the next reading
    ):
        result, ticks, _, _ = go(Event("corrupted", at=at))
        told = [index for index, seen in enumerate(ticks) if text in seen.observation.faults]
        assert (result.ended, told) == ("finished", [tick.index + text.endswith("arrive")])


def test_an_answer_that_comes_twice_is_told() -> None:
    _, ticks, _, _ = go(Event("duplicated", at=2.5, stream="status"))
    told = [tick for tick in ticks if "bus: bytes that nobody asked for" in tick.observation.faults]
    assert len(told) == 1
    assert 2.5 < told[0].began < 2.55


@pytest.mark.parametrize(
    ("what", "said"), [("dropped", "frames lost"), ("corrupted", "damaged bytes"), ("duplicated", "frames repeated")]
)
def test_what_happens_to_the_foots_frames_is_told(what: str, said: str) -> None:
    result, ticks, _, _ = go(Event(what, at=2.5, stream="foot", packets=3))
    assert result.ended == "finished"
    assert f"foot: {said}" in {text for tick in ticks for text in tick.observation.faults}


def test_a_servo_that_lost_its_id_is_without_torque_at_the_end() -> None:
    result, _, _, world = go(Event("id_lost", at=2.5, servo=2, id=9))
    assert result.ended == "cut"  # nobody confirms it
    assert "torque may still be on: knee" in result.reason
    assert [servo.register(Name.TORQUE_ENABLE) for servo in world.servos] == [0, 0, 0]


def test_a_port_that_comes_back_untold_is_used_to_turn_torque_off() -> None:
    result, _, robot, world = go(Event("unplugged", at=2.5, lasts=1.0, port="servo"))
    assert (result.ended, result.replugs) == ("cut", 0)
    assert robot.left_on == ()
    assert [servo.register(Name.TORQUE_ENABLE) for servo in world.servos] == [0, 0, 0]


def test_the_error_byte_of_every_answer_is_kept() -> None:
    _, ticks, _, _ = go(Event("overload", at=2.5, servo=2))
    bytes_of_knee = {int(tick.observation.health.error[1]) for tick in ticks}
    assert bytes_of_knee == {0x00, 0x80}
    assert {int(tick.observation.health.error[0]) for tick in ticks} == {0x00}


def test_noise_on_every_line_never_gives_a_wrong_register() -> None:
    for seed in range(3):
        rates = Rates(duplicated=0.2, late=0.2, late_by=0.01)
        world = EmulatedLamp(
            LAMP,
            load_calibration(Assets()),
            Assets(),
            load_reality("none", LAMP, Assets()),
            faults=Faults("noise", seed, {"status": rates}),
        )
        ports = Lockstep(world, LAMP.bus_baud)
        robot = RobotLamp(LAMP, ports.servo_port, ports.foot_port, ports.clock)
        robot.open()  # reads some sixty registers; a wrong one would be refused
        robot.close()
