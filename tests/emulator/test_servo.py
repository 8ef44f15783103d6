from __future__ import annotations

import math
from dataclasses import replace

import pytest

from robolamp.dynamixel.registers import MODELS, Name

from .parts import Bench, instruction, read, u16, write

INSTRUCTION, RANGE, LENGTH, LIMIT, ACCESS = 2, 4, 5, 6, 7


@pytest.mark.parametrize("model", MODELS)
def test_ping_gives_model_number_and_firmware(model: str) -> None:
    answer = Bench(model=model).ask(instruction(1, 0x01))
    assert answer.error == 0
    assert int.from_bytes(answer.data[:2], "little") == MODELS[model].number
    assert len(answer.data) == 3


@pytest.mark.parametrize("model", MODELS)
def test_every_register_has_its_factory_value(model: str) -> None:
    bench = Bench(model=model)
    for register in MODELS[model].registers.values():
        if register.initial is not None and register.name not in (
            Name.BAUD_RATE,
            Name.RETURN_DELAY_TIME,
            Name.BACKUP_READY,
        ):
            answer = bench.ask(read(1, register.address, register.size))
            assert (answer.error, int.from_bytes(answer.data, "little", signed=register.signed)) == (
                0,
                register.initial,
            ), register.name


def test_what_is_written_is_read_back() -> None:
    bench = Bench()
    assert bench.ask(write(1, 84, 800, 2)).error == 0
    assert bench.value(84, 2) == 800


def test_several_registers_at_once_are_written_all_or_none() -> None:
    bench = Bench()
    velocity_and_goal = (50).to_bytes(4, "little") + (2100).to_bytes(4, "little")
    assert bench.ask(instruction(1, 0x03, u16(112) + velocity_and_goal)).error == 0
    assert (bench.value(112, 4), bench.value(116, 4)) == (50, 2100)
    beyond = (60).to_bytes(4, "little") + (5000).to_bytes(4, "little")
    assert bench.ask(instruction(1, 0x03, u16(112) + beyond)).error == LIMIT
    assert (bench.value(112, 4), bench.value(116, 4)) == (50, 2100)


@pytest.mark.parametrize(
    ("address", "value", "size", "error"),
    [
        (132, 0, 4, ACCESS),  # Present Position is read-only
        (66, 0, 1, ACCESS),  # no such register
        (117, 0, 1, ACCESS),  # the middle of one
        (116, 0, 2, LENGTH),  # half of one
        (64, 2, 1, RANGE),
        (68, 3, 1, RANGE),
        (7, 253, 1, RANGE),
        (11, 2, 1, RANGE),
        (84, 16384, 2, RANGE),
        (116, 4096, 4, LIMIT),
        (116, -1, 4, LIMIT),
        (100, 886, 2, LIMIT),
        (104, -446, 4, LIMIT),
    ],
)
def test_refused_writes(address: int, value: int, size: int, error: int) -> None:
    assert Bench().ask(write(1, address, value, size)).error == error


def test_goals_keep_inside_the_position_limits() -> None:
    bench = Bench()
    assert bench.ask(write(1, 48, 3000, 4)).error == 0
    assert bench.ask(write(1, 52, 1000, 4)).error == 0
    assert [bench.ask(write(1, 116, goal, 4)).error for goal in (999, 1000, 3000, 3001)] == [LIMIT, 0, 0, LIMIT]


def test_eeprom_is_locked_while_torque_is_on() -> None:
    bench = Bench()
    bench.ask(write(1, 64, 1, 1))
    assert bench.ask(write(1, 9, 5, 1)).error == ACCESS
    assert bench.ask(write(1, 65, 1, 1)).error == 0
    bench.ask(write(1, 64, 0, 1))
    assert bench.ask(write(1, 9, 5, 1)).error == 0


@pytest.mark.parametrize(("address", "size", "error"), [(0, 0, LENGTH), (140, 200, ACCESS), (60000, 4, ACCESS)])
def test_refused_reads(address: int, size: int, error: int) -> None:
    answer = Bench().ask(read(1, address, size))
    assert (answer.error, answer.data) == (error, b"")


def test_a_block_is_read_with_its_gaps_as_zeros() -> None:
    answer = Bench().ask(read(1, 60, 12))
    assert (answer.error, len(answer.data)) == (0, 12)
    assert answer.data[1] == 0


@pytest.mark.parametrize("code", [0x07, 0x8A, 0x92, 0xEE])
def test_instructions_it_does_not_know(code: int) -> None:
    assert Bench().ask(instruction(1, code)).error == INSTRUCTION


@pytest.mark.parametrize("parameters", [b"", b"\x84\x00\x04"])
def test_a_read_without_all_its_parameters(parameters: bytes) -> None:
    assert Bench().ask(instruction(1, 0x02, parameters)).error == LENGTH


def test_status_return_level() -> None:
    bench = Bench()
    bench.send(write(1, 68, 1, 1))
    assert bench.send(write(1, 65, 1, 1)) == []
    assert bench.ask(read(1, 65, 1)).data == b"\x01"
    bench.send(write(1, 68, 0, 1))
    assert bench.send(read(1, 65, 1)) == []
    assert bench.send(instruction(0xFE, 0x82, u16(65) + u16(1) + b"\x01")) == []
    assert bench.ask(instruction(1, 0x01)).error == 0


def test_a_new_id_counts_from_the_next_packet() -> None:
    bench = Bench()
    assert bench.ask(write(1, 7, 30, 1)).id == 1
    assert bench.send(instruction(1, 0x01)) == []
    assert bench.ask(instruction(30, 0x01)).id == 30


def test_the_shadow_id_obeys_without_an_answer() -> None:
    bench = Bench()
    bench.ask(write(1, 12, 40, 1))
    assert bench.send(write(40, 65, 1, 1)) == []
    assert bench.send(read(40, 65, 1)) == []
    assert bench.value(65, 1) == 1


def test_present_values_in_register_units() -> None:
    bench = Bench()
    bench.shaft = replace(bench.shaft, angle=3.1416, velocity=-1.0, current=-0.25, duty=0.5)
    assert bench.value(132, 4) == 2048
    assert bench.value(128, 4) == -42  # 0.229 rev/min each
    assert bench.value(126, 2) == -250
    assert bench.value(124, 2) == 442
    assert bench.value(144, 2) == 50
    assert bench.value(146, 1) == 30
    assert bench.value(122, 1) == 1
    bench.shaft = replace(bench.shaft, velocity=0.1)
    assert bench.value(122, 1) == 0


def test_homing_offset_shifts_what_is_read_and_what_is_driven() -> None:
    bench = Bench()
    bench.shaft = replace(bench.shaft, angle=3.1416)
    bench.ask(write(1, 20, 100, 4))
    assert bench.value(132, 4) == 2148
    bench.ask(write(1, 116, 2148, 4))
    assert bench.servos[0].drive().goal == pytest.approx(3.1416, abs=1e-4)


def test_what_it_does_to_its_motor() -> None:
    bench = Bench()
    for data in (write(1, 84, 640, 2), write(1, 100, 177, 2), write(1, 116, 1024, 4), write(1, 64, 1, 1)):
        assert bench.ask(data).error == 0
    drive = bench.servos[0].drive()
    assert drive.torque
    assert (drive.p_gain, drive.duty_limit) == (640, pytest.approx(0.2))
    assert drive.goal == pytest.approx(3.14159265 / 2)


def test_the_goal_after_power_on_is_where_it_stands() -> None:
    assert Bench().value(116, 4) == round(3.0 / (2 * 3.14159265 / 4096))


def test_reboot_forgets_ram_keeps_eeprom_and_takes_a_while() -> None:
    bench = Bench()
    bench.ask(write(1, 9, 7, 1))
    bench.ask(write(1, 84, 800, 2))
    bench.ask(write(1, 64, 1, 1))
    assert bench.ask(instruction(1, 0x08)).error == 0
    assert not bench.servos[0].drive().torque
    assert bench.send(instruction(1, 0x01)) == []
    bench.time += 0.5
    assert bench.ask(instruction(1, 0x01)).error == 0
    assert (bench.value(9, 1), bench.value(84, 2), bench.value(64, 1)) == (7, 400, 0)


def test_a_full_turn_reads_as_zero() -> None:
    bench = Bench()
    bench.shaft = replace(bench.shaft, angle=2 * math.pi - 1e-6)
    assert bench.value(132, 4) == 0
    bench.shaft = replace(bench.shaft, angle=2 * math.pi - 0.0016)
    assert bench.value(132, 4) == 4095


class TestBusWatchdog:
    def trip(self, bench: Bench, silence: float = 0.2) -> None:
        bench.ask(write(1, 116, 3000, 4))
        bench.ask(write(1, 64, 1, 1))
        bench.ask(write(1, 98, 5, 1))
        bench.time += silence
        bench.servos[0].poll(bench.time)

    def test_it_stops_where_it_stands_and_refuses_goals_until_cleared(self) -> None:
        bench = Bench()
        self.trip(bench)
        drive = bench.servos[0].drive()
        assert (drive.torque, drive.goal) == (True, 3.0)
        assert bench.value(98, 1) == -1
        assert bench.ask(write(1, 116, 2000, 4)).error == RANGE
        assert bench.ask(write(1, 98, 0, 1)).error == 0
        assert bench.servos[0].drive().goal == 3.0
        assert bench.ask(write(1, 116, 2000, 4)).error == 0
        assert bench.servos[0].drive().goal == pytest.approx(2000 * 2 * 3.14159265 / 4096)

    def test_torque_off_ends_the_stop(self) -> None:
        bench = Bench()
        self.trip(bench)
        bench.ask(write(1, 64, 0, 1))
        drive = bench.servos[0].drive()
        assert (drive.torque, drive.goal) == (False, pytest.approx(3000 * 2 * math.pi / 4096))

    def test_any_instruction_feeds_it(self) -> None:
        bench = Bench(ids=(1, 2))
        self.trip(bench, 0.09)
        bench.ask(instruction(2, 0x01))
        bench.time += 0.09
        bench.servos[0].poll(bench.time)
        assert bench.value(98, 1) == 5

    def test_it_sleeps_while_torque_is_off(self) -> None:
        bench = Bench()
        bench.ask(write(1, 98, 5, 1))
        bench.time += 1.0
        bench.servos[0].poll(bench.time)
        assert bench.value(98, 1) == 5
