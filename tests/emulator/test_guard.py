"""Heat, overload and supply: what shuts a servo down, and what only a reboot mends."""

from __future__ import annotations

import math

import pytest

from robolamp.dynamixel.registers import HardwareError, Name
from robolamp.emulator.servo.bare_motor import DATASHEETS
from robolamp.emulator.servo.shutdown import OVERLOAD_TIME

from .bench import MotorBench
from .parts import instruction, read, u16, write

ALERT, RESULT = 0x80, 1


def stalled(**values: int) -> MotorBench:
    bench = MotorBench()
    bench.set(**values, torque_enable=1, goal_position=4000)
    bench.motor.locked = True
    return bench


class TestOverload:
    def test_a_stall_shuts_it_down_until_a_reboot(self) -> None:
        bench = stalled()
        bench.run(OVERLOAD_TIME - 0.1)
        assert bench.get(Name.TORQUE_ENABLE) == 1
        bench.run(0.2)
        assert not bench.servo.drive().torque
        answer = bench.ask(read(1, 64, 1))
        assert (answer.error, answer.data) == (ALERT, b"\0")
        assert bench.ask(read(1, 70, 1)).data == bytes([HardwareError.OVERLOAD])
        assert bench.ask(write(1, 64, 1, 1)).error == ALERT | RESULT
        assert bench.ask(write(1, 65, 1, 1)).error == ALERT  # everything else still works
        assert bench.ask(instruction(1, 0x01)).error == ALERT
        bench.motor.locked = False
        bench.ask(instruction(1, 0x08))
        bench.run(0.3)
        assert bench.get(Name.HARDWARE_ERROR_STATUS) == 0
        bench.set(torque_enable=1)

    def test_a_limited_duty_never_gets_that_far(self) -> None:
        bench = stalled(goal_pwm=600)
        bench.run(2 * OVERLOAD_TIME)
        assert bench.get(Name.TORQUE_ENABLE) == 1

    def test_without_its_shutdown_bit_it_goes_on_and_the_bit_goes_with_the_load(self) -> None:
        bench = stalled(shutdown=0)
        bench.run(OVERLOAD_TIME + 0.1)
        assert bench.ask(read(1, 64, 1)).data == b"\1"
        assert bench.ask(read(1, 70, 1)).data == bytes([HardwareError.OVERLOAD])
        bench.motor.locked = False
        bench.run(0.5)
        assert bench.get(Name.HARDWARE_ERROR_STATUS) == 0

    def test_turning_fast_at_full_duty_is_no_overload(self) -> None:
        bench = MotorBench()
        bench.set(operating_mode=16, torque_enable=1, goal_pwm=885)
        bench.run(2 * OVERLOAD_TIME)
        assert bench.get(Name.HARDWARE_ERROR_STATUS) == 0


class TestHeat:
    def test_the_winding_heats_as_first_order(self) -> None:
        bench = stalled(shutdown=0, goal_pwm=442)
        sheet = DATASHEETS["XL330-M288-T"]
        current = 0.5 * 5.0 / sheet.resistance
        bench.run(8.0)
        expected = sheet.resistance * current**2 * sheet.thermal_resistance * -math.expm1(-8.0 / sheet.thermal_time)
        assert bench.servo.heat == pytest.approx(expected, rel=0.02)
        assert bench.get(Name.PRESENT_TEMPERATURE) == round(25.0 + expected)

    def test_it_shuts_down_above_its_limit(self) -> None:
        bench = MotorBench()
        bench.set(temperature_limit=60, torque_enable=1)
        bench.air = 59.0
        bench.run(0.1)
        assert bench.get(Name.HARDWARE_ERROR_STATUS) == 0
        bench.air = 61.0
        bench.run(0.1)
        assert bench.ask(read(1, 70, 1)).data == bytes([HardwareError.OVERHEATING])
        assert not bench.servo.drive().torque

    def test_a_reboot_does_not_cool_it(self) -> None:
        bench = stalled(shutdown=0)
        bench.run(4.0)
        heat = bench.servo.heat
        bench.ask(instruction(1, 0x08))
        assert bench.servo.heat == heat > 2.0


class TestSupply:
    def test_a_short_dip_is_forgiven_a_long_one_is_not(self) -> None:
        bench = MotorBench()
        bench.set(torque_enable=1)
        for dip, torque in ((0.03, True), (0.1, False)):
            bench.supply = 3.0
            bench.run(dip)
            bench.supply = 5.0
            bench.run(0.1)
            assert bench.servo.drive().torque is torque
        assert bench.ask(read(1, 70, 1)).data == bytes([HardwareError.VOLTAGE])

    def test_the_xl430_only_reports_it(self) -> None:
        bench = MotorBench("XL430-W250-T", supply=12.0)
        bench.set(torque_enable=1)
        bench.supply = 15.0
        bench.run(0.2)
        assert bench.ask(read(1, 70, 1)).data == bytes([HardwareError.VOLTAGE])
        assert bench.servo.drive().torque
        bench.supply = 12.0
        bench.run(0.2)
        assert bench.get(Name.HARDWARE_ERROR_STATUS) == 0


class TestAlert:
    def test_it_is_on_every_kind_of_answer(self) -> None:
        bench = MotorBench()
        bench.servo.fail(HardwareError.ELECTRICAL_SHOCK)
        for data in (
            instruction(1, 0x01),
            read(1, 132, 4),
            write(1, 65, 1, 1),
            instruction(0xFE, 0x82, u16(132) + u16(4) + b"\x01"),
            instruction(0xFE, 0x92, b"\x01" + u16(132) + u16(4)),
            instruction(1, 0x10, b"\x01\x44\x58\x4c\x22"),
        ):
            assert bench.ask(data).error & ALERT
        (reply,) = bench.line.feed(instruction(0xFE, 0x8A, u16(132) + u16(4) + b"\x01"), 1.0)
        assert reply.data[8] == ALERT

    def test_a_goal_does_not_turn_torque_on_after_a_shutdown(self) -> None:
        bench = MotorBench()
        bench.set(drive_mode=8)
        bench.servo.fail(HardwareError.OVERLOAD)
        bench.put(Name.GOAL_POSITION, 2100)
        assert not bench.servo.drive().torque
