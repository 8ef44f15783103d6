from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from robolamp.dynamixel.registers import Name
from robolamp.errors import FileError

from .bench import MotorBench
from .parts import instruction


def test_what_was_written_is_there_again(tmp_path: Path) -> None:
    store = tmp_path / "servo.toml"
    bench = MotorBench(store=store)
    assert not store.exists()
    bench.set(position_p_gain=900)
    assert not store.exists()  # RAM
    bench.set(operating_mode=5, homing_offset=-300, return_delay_time=10)
    again = MotorBench(store=store)
    values = [again.get(name) for name in (Name.OPERATING_MODE, Name.HOMING_OFFSET, Name.RETURN_DELAY_TIME)]
    assert values == [5, -300, 10]
    assert again.get(Name.POSITION_P_GAIN) == 400
    assert tomllib.loads(store.read_text())["eeprom"]["Homing Offset"] == -300


def test_who_reads_it_while_it_is_written_reads_the_old_one_whole(tmp_path: Path) -> None:
    store = tmp_path / "servo.toml"
    bench = MotorBench(store=store)
    bench.set(homing_offset=-300)
    old = store.read_text()
    with store.open() as reader:
        bench.set(homing_offset=200)
        assert (reader.read(), store.read_text()) == (old, old.replace("-300", "200"))


def test_a_factory_reset_is_kept_too(tmp_path: Path) -> None:
    store = tmp_path / "servo.toml"
    bench = MotorBench(store=store)
    bench.set(homing_offset=-300)
    bench.ask(instruction(1, 0x06, b"\x02"))
    assert MotorBench(store=store).get(Name.HOMING_OFFSET) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not toml", "not valid TOML"),
        ('model = "XL430-W250-T"', "model: 'XL430-W250-T' is not one of XL330-M288-T"),
        ('model = "XL330-M288-T"\n[eeprom]\nID = 300', "eeprom.ID: 300 is not a whole number from 0 to 252"),
        ('model = "XL330-M288-T"\n[eeprom]\n"Operating Mode" = 2', "eeprom.Operating Mode: 2 is not one of 0, 1, 3"),
        ('model = "XL330-M288-T"\n[eeprom]\nNose = 1', "eeprom.Nose: unknown"),
        ('model = "XL330-M288-T"\n[eeprom]\nLED = 1', "eeprom.LED: unknown"),
    ],
)
def test_a_file_that_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    store = tmp_path / "servo.toml"
    store.write_text(text)
    with pytest.raises(FileError) as caught:
        MotorBench(store=store)
    assert message in str(caught.value)
    assert str(store) in str(caught.value)
