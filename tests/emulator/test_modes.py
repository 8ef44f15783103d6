"""Operating modes, profiles, limits and flags, on a plain motor."""

from __future__ import annotations

import math

import pytest

from robolamp.dynamixel.registers import MODELS, Name
from robolamp.emulator.servo.bare_motor import DATASHEETS

from .bench import COUNT, VELOCITY, MotorBench
from .parts import instruction

RESULT, INSTRUCTION, RANGE, LIMIT = 1, 2, 4, 6
SUPPLY = {"XL330-M288-T": 5.0, "XL330-M077-T": 5.0, "XL430-W250-T": 11.1}


def volts(model: str) -> MotorBench:
    return MotorBench(model, supply=SUPPLY[model])


@pytest.mark.parametrize("model", MODELS)
class TestEveryModel:
    def test_position_mode_goes_to_its_goal(self, model: str) -> None:
        bench = volts(model)
        bench.set(torque_enable=1, goal_position=2600)
        bench.run(2.0)
        assert bench.get(Name.PRESENT_POSITION) == pytest.approx(2600, abs=15)
        assert bench.get(Name.MOVING) == 0
        assert bench.get(Name.MOVING_STATUS) & 1

    def test_velocity_mode_turns_at_its_goal(self, model: str) -> None:
        bench = volts(model)
        bench.set(operating_mode=1, torque_enable=1)
        bench.run(0.2)
        assert bench.motor.velocity == 0.0
        for goal in (100, -150):
            bench.set(goal_velocity=goal)
            bench.run(2.0)
            assert bench.motor.velocity == pytest.approx(goal * VELOCITY, rel=0.03)
            assert bench.get(Name.PRESENT_VELOCITY) == pytest.approx(goal, abs=5)
            assert bench.get(Name.MOVING) == 1
        assert bench.put(Name.GOAL_VELOCITY, bench.get(Name.VELOCITY_LIMIT) + 1) == LIMIT

    def test_pwm_mode_is_a_voltage(self, model: str) -> None:
        bench = volts(model)
        bench.set(operating_mode=16, torque_enable=1, goal_pwm=885)
        bench.run(2.0)
        assert bench.motor.velocity == pytest.approx(DATASHEETS[model].no_load_speed, rel=0.03)
        bench.set(goal_pwm=-442)
        bench.run(2.0)
        assert bench.get(Name.PRESENT_PWM) == -442
        assert -0.6 < bench.motor.velocity / DATASHEETS[model].no_load_speed < -0.4

    def test_extended_position_mode_turns_many_times(self, model: str) -> None:
        bench = volts(model)
        bench.set(operating_mode=4, torque_enable=1)
        assert bench.put(Name.GOAL_POSITION, 1_048_576) == RANGE
        bench.set(goal_position=-9000)
        bench.run(5.0)
        assert bench.get(Name.PRESENT_POSITION) == pytest.approx(-9000, abs=15)
        assert bench.motor.angle == pytest.approx(-9000 * COUNT, abs=15 * COUNT)

    def test_a_profile_takes_the_time_that_the_e_manual_says(self, model: str) -> None:
        bench = volts(model)
        bench.set(profile_velocity=40, profile_acceleration=4, torque_enable=1)
        start = bench.get(Name.PRESENT_POSITION)
        bench.set(goal_position=start + 1500)
        t1 = 0.064 * 40 / 4  # "What is the Profile": t1 = 64 V / A, t2 = 64 distance / V, in ms
        t2 = 0.064 * 1500 / 40
        bench.run((t1 + t2) / 2)
        assert bench.get(Name.VELOCITY_TRAJECTORY) == 40
        assert bench.get(Name.POSITION_TRAJECTORY) == pytest.approx(start + 750, abs=12)
        assert bench.get(Name.MOVING_STATUS) & 0b110010 == 0b110010
        bench.run((t1 + t2) / 2 - 0.03)
        assert bench.get(Name.MOVING_STATUS) & 2
        bench.run(0.06)
        assert not bench.get(Name.MOVING_STATUS) & 2
        assert bench.get(Name.POSITION_TRAJECTORY) == start + 1500


class TestCurrent:
    def test_current_mode_draws_its_goal(self) -> None:
        bench = MotorBench()
        bench.set(operating_mode=0, torque_enable=1)
        bench.motor.locked = True
        for goal in (300, -500):
            bench.set(goal_current=goal)
            bench.run(0.2)
            assert bench.get(Name.PRESENT_CURRENT) == pytest.approx(goal, abs=3)

    def test_current_based_position_yields_at_its_goal_current(self) -> None:
        bench = MotorBench()
        bench.set(operating_mode=5, torque_enable=1, goal_current=100, goal_position=3000)
        bench.run(3.0)
        assert bench.get(Name.PRESENT_POSITION) == pytest.approx(3000, abs=30)
        bench.motor.locked = True
        bench.set(goal_position=6000)
        bench.run(0.3)
        assert bench.get(Name.PRESENT_CURRENT) == pytest.approx(100, abs=3)

    def test_the_current_limit_does_not_act_in_position_mode(self) -> None:
        bench = MotorBench()
        bench.set(current_limit=100, torque_enable=1, goal_position=4000)
        bench.motor.locked = True
        bench.run(0.3)
        assert bench.get(Name.PRESENT_CURRENT) > 1000

    def test_a_goal_beyond_the_current_limit_is_refused(self) -> None:
        bench = MotorBench()
        bench.set(current_limit=200)
        assert bench.put(Name.GOAL_CURRENT, 201) == LIMIT

    def test_the_xl430_has_no_current_modes(self) -> None:
        bench = MotorBench("XL430-W250-T", supply=12.0)
        assert [bench.put(Name.OPERATING_MODE, mode) for mode in (0, 5)] == [RANGE, RANGE]


class TestGainsAndLimits:
    def held(self, **gains: int) -> int:
        """Where a load leaves it, in counts from its goal."""
        bench = MotorBench()
        bench.set(**gains, torque_enable=1)
        bench.motor.external = -0.1
        bench.run(3.0)
        return bench.get(Name.PRESENT_POSITION) - 2048

    def test_p_gain_stiffens_and_i_gain_takes_the_rest_away(self) -> None:
        soft, stiff = self.held(position_p_gain=400), self.held(position_p_gain=1600)
        assert soft < 3 * stiff < 0
        assert abs(self.held(position_p_gain=400, position_i_gain=400)) < abs(soft) / 5

    def test_what_an_i_gain_adds_up_waits_while_the_duty_is_at_its_limit(self) -> None:
        bench = MotorBench(load=0.001)
        bench.set(pwm_limit=300)
        bench.set(position_p_gain=800, position_i_gain=300, torque_enable=1, goal_position=2300)
        bench.motor.locked = True
        bench.run(3.0)
        bench.motor.locked = False
        highest = 0.0
        for _ in range(100):
            bench.run(0.01)
            highest = max(highest, bench.motor.angle / COUNT - 2300)
        assert highest < 80  # counts; 127 where it adds up and is only cut, 927 where it is not

    def test_d_gain_damps(self) -> None:
        def overshoot(gain: int) -> float:
            bench = MotorBench(load=0.01)
            bench.set(position_p_gain=1600, position_d_gain=gain, torque_enable=1, goal_position=2300)
            highest = 0.0
            for _ in range(100):
                bench.run(0.01)
                highest = max(highest, bench.motor.angle / COUNT - 2300)
            return highest

        assert overshoot(0) > 30
        assert overshoot(4000) < overshoot(0) / 2

    def test_pwm_limit_and_goal_pwm_hold_the_duty_back(self) -> None:
        bench = MotorBench()
        bench.set(pwm_limit=200, torque_enable=1, goal_position=4000)
        bench.run(0.1)
        assert bench.get(Name.PRESENT_PWM) == 200
        bench.set(goal_pwm=100)
        bench.run(0.05)
        assert bench.get(Name.PRESENT_PWM) == 100
        assert bench.put(Name.GOAL_PWM, 201) == LIMIT

    def test_a_profile_acceleration_ramps_velocity(self) -> None:
        bench = MotorBench()
        bench.set(operating_mode=1, torque_enable=1, profile_acceleration=10, goal_velocity=200)
        bench.run(0.64)  # 64 ms x 200 / 10 = 1.28 s to get there
        assert bench.get(Name.VELOCITY_TRAJECTORY) == pytest.approx(100, abs=2)
        bench.run(1.0)
        assert bench.get(Name.VELOCITY_TRAJECTORY) == 200

    def test_a_time_based_profile_ends_on_time(self) -> None:
        bench = MotorBench()
        bench.set(drive_mode=4, torque_enable=1, profile_velocity=1000, profile_acceleration=300, goal_position=3000)
        bench.run(0.5)
        assert bench.get(Name.POSITION_TRAJECTORY) == pytest.approx((3000 + 2048) / 2, abs=5)
        bench.run(0.48)
        assert bench.get(Name.POSITION_TRAJECTORY) < 3000
        bench.run(0.04)
        assert bench.get(Name.POSITION_TRAJECTORY) == 3000


class TestDriveMode:
    def test_reverse_mode_turns_everything_round(self) -> None:
        bench = MotorBench(angle=1.0)
        bench.set(drive_mode=1)
        start = bench.get(Name.PRESENT_POSITION)
        assert start == 4096 - round(1.0 / COUNT)
        bench.set(torque_enable=1, goal_position=start + 300)
        bench.run(1.0)
        assert bench.motor.angle == pytest.approx(1.0 - 300 * COUNT, abs=15 * COUNT)
        assert bench.get(Name.PRESENT_POSITION) == pytest.approx(start + 300, abs=15)
        bench.set(torque_enable=0, operating_mode=1)
        bench.set(torque_enable=1, goal_velocity=100)
        bench.run(1.0)
        assert bench.motor.velocity < 0
        assert bench.get(Name.PRESENT_VELOCITY) == pytest.approx(100, abs=5)
        assert bench.get(Name.PRESENT_PWM) > 0
        assert bench.get(Name.PRESENT_CURRENT) > 0

    def test_the_homing_offset_keeps_its_sign_in_reverse(self) -> None:
        bench = MotorBench(angle=1.0)
        bench.set(drive_mode=1, homing_offset=200)
        assert bench.get(Name.PRESENT_POSITION) == 4096 - round(1.0 / COUNT) + 200

    def test_a_goal_turns_torque_on_if_told_so(self) -> None:
        bench = MotorBench()
        bench.set(goal_position=2200)
        assert bench.get(Name.TORQUE_ENABLE) == 0
        bench.set(drive_mode=8, goal_position=2300)
        assert bench.get(Name.TORQUE_ENABLE) == 1
        bench.run(1.0)
        assert bench.get(Name.PRESENT_POSITION) == pytest.approx(2300, abs=15)

    def test_a_large_homing_offset_counts_in_many_turns_only(self) -> None:
        bench = MotorBench()
        bench.set(homing_offset=5000)
        assert bench.get(Name.PRESENT_POSITION) == 2048
        bench.set(operating_mode=4)
        assert bench.get(Name.PRESENT_POSITION) == 7048
        bench.set(torque_enable=1, goal_position=7348)
        bench.run(1.0)
        assert bench.motor.angle == pytest.approx(2348 * COUNT, abs=15 * COUNT)


class TestModeChange:
    def test_it_resets_gains_profile_and_goals(self) -> None:
        bench = MotorBench()
        bench.set(position_p_gain=900, velocity_p_gain=7, profile_velocity=50, profile_acceleration=5, goal_pwm=100)
        bench.set(operating_mode=3)
        assert bench.get(Name.POSITION_P_GAIN) == 900
        bench.set(operating_mode=4)
        values = [bench.get(name) for name in (Name.POSITION_P_GAIN, Name.VELOCITY_P_GAIN, Name.PROFILE_VELOCITY)]
        assert values == [400, 180, 0]
        assert bench.get(Name.GOAL_PWM) == 885
        assert bench.get(Name.GOAL_POSITION) == bench.get(Name.PRESENT_POSITION)

    def test_position_mode_forgets_turns(self) -> None:
        bench = MotorBench()
        bench.set(operating_mode=4, torque_enable=1, goal_position=10_000)
        bench.run(4.0)
        bench.set(torque_enable=0, operating_mode=3)
        assert bench.get(Name.PRESENT_POSITION) == pytest.approx(10_000 % 4096, abs=15)
        bench.set(torque_enable=1, goal_position=10_000 % 4096 + 100)
        bench.run(1.0)
        assert bench.motor.angle == pytest.approx(10_100 * COUNT, abs=15 * COUNT)


class TestClear:
    PACKET = instruction(1, 0x10, b"\x01\x44\x58\x4c\x22")

    def test_it_takes_turns_away_and_stays_where_it_is(self) -> None:
        bench = MotorBench()
        bench.set(operating_mode=4, torque_enable=1, goal_position=10_000)
        bench.run(0.1)
        assert bench.ask(self.PACKET).error == RESULT  # in motion
        bench.run(4.0)
        angle = bench.motor.angle
        assert bench.ask(self.PACKET).error == 0
        assert bench.get(Name.PRESENT_POSITION) == pytest.approx(10_000 % 4096, abs=15)
        bench.run(1.0)
        assert bench.motor.angle == pytest.approx(angle, abs=3 * COUNT)

    @pytest.mark.parametrize(("parameters", "error"), [(b"", 5), (b"\x01", 5), (b"\x02\x44\x58\x4c\x22", 1)])
    def test_what_it_refuses(self, parameters: bytes, error: int) -> None:
        assert MotorBench().ask(instruction(1, 0x10, parameters)).error == error


@pytest.mark.parametrize(
    ("mode", "goal", "value"),
    [
        (1, Name.GOAL_VELOCITY, 200),
        (16, Name.GOAL_PWM, 500),
        (0, Name.GOAL_CURRENT, 100),
        (4, Name.GOAL_POSITION, 90_000),
        (5, Name.GOAL_POSITION, 90_000),
    ],
)
def test_the_bus_watchdog_stops_every_mode(mode: int, goal: Name, value: int) -> None:
    bench = MotorBench(eeprom={Name.HOMING_OFFSET: 700})
    bench.set(operating_mode=mode)
    if mode == 5:
        bench.set(goal_current=500)
    bench.set(torque_enable=1, bus_watchdog=5)
    assert bench.put(goal, value) == 0
    bench.run(0.09)
    speed = abs(bench.motor.velocity)
    assert speed > 0.5
    bench.run(0.6)
    assert abs(bench.motor.velocity) < 0.05
    assert bench.get(Name.BUS_WATCHDOG) == -1
    assert bench.get(Name.TORQUE_ENABLE) == 1
    assert bench.put(goal, value) == RANGE
    bench.set(bus_watchdog=0)
    bench.run(0.3)
    assert abs(bench.motor.velocity) < 0.05
    assert bench.put(goal, value) == 0
    bench.run(0.3)
    assert abs(bench.motor.velocity) > 0.5


def test_startup_configuration_turns_torque_on() -> None:
    bench = MotorBench()
    bench.set(startup_configuration=1)
    bench.ask(instruction(1, 0x08))
    bench.run(0.3)
    assert bench.get(Name.TORQUE_ENABLE) == 1
    assert bench.motor.angle == pytest.approx(math.pi, abs=COUNT)


def test_realtime_tick_counts_milliseconds() -> None:
    bench = MotorBench()
    first = bench.get(Name.REALTIME_TICK)
    bench.run(0.25)
    assert bench.get(Name.REALTIME_TICK) - first == pytest.approx(250, abs=2)
