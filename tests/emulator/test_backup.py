"""Control Table Backup, and what it gives back."""

from __future__ import annotations

from pathlib import Path

from robolamp.dynamixel.registers import Name

from .bench import MotorBench
from .parts import instruction

STORE, RESTORE = instruction(1, 0x20, b"\x01CTRL"), instruction(1, 0x20, b"\x02CTRL")
RESULT, LENGTH = 1, 5


def reboot(bench: MotorBench) -> None:
    bench.ask(instruction(1, 0x08))
    bench.run(0.3)


def test_the_packet_is_the_e_manuals() -> None:
    assert bytes.fromhex("FF FF FD 00 01 08 00 20 01 43 54 52 4C 16 F5") == STORE


def test_eeprom_comes_back_with_a_reboot(tmp_path: Path) -> None:
    bench = MotorBench(store=tmp_path / "servo.toml")
    assert bench.get(Name.BACKUP_READY) == 0
    bench.set(homing_offset=77)
    assert bench.ask(STORE).error == 0
    assert bench.get(Name.BACKUP_READY) == 1
    bench.set(homing_offset=5)
    assert bench.ask(RESTORE).error == 0
    assert not bench.line.feed(instruction(1, 0x01), bench.time)  # it reboots
    bench.run(0.3)
    assert bench.get(Name.HOMING_OFFSET) == 77
    assert MotorBench(store=tmp_path / "servo.toml").get(Name.HOMING_OFFSET) == 77


def test_ram_comes_back_where_startup_configuration_says_so() -> None:
    bench = MotorBench()
    bench.set(position_p_gain=321, profile_velocity=9)
    assert bench.ask(instruction(1, 0x03, (168).to_bytes(2, "little") + (132).to_bytes(2, "little"))).error == 0
    bench.ask(STORE)
    reboot(bench)
    assert bench.get(Name.POSITION_P_GAIN) == 400
    bench.set(startup_configuration=2)
    reboot(bench)
    assert (bench.get(Name.POSITION_P_GAIN), bench.get(Name.PROFILE_VELOCITY)) == (321, 9)
    assert bench.ask(instruction(1, 0x02, (168).to_bytes(2, "little") + b"\2\0")).data == (132).to_bytes(2, "little")


def test_what_is_refused() -> None:
    bench = MotorBench()
    assert bench.ask(RESTORE).error == RESULT  # nothing is stored
    assert bench.ask(instruction(1, 0x20, b"\x01")).error == LENGTH
    assert bench.ask(instruction(1, 0x20, b"\x03CTRL")).error == RESULT
    assert bench.ask(instruction(1, 0x20, b"\x01XXXX")).error == RESULT
    bench.set(torque_enable=1)
    assert bench.ask(STORE).error == RESULT
    assert bench.get(Name.BACKUP_READY) == 0
