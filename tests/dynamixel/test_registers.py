from __future__ import annotations

import csv
import math
from importlib.resources import files

import pytest

from robolamp.dynamixel.registers import (
    ACCELERATION_UNIT,
    BAUD_CODES,
    MODELS,
    RAD_PER_COUNT,
    VELOCITY_UNIT,
    HardwareError,
    Model,
    Name,
    model_by_number,
)

SDK_FILES = {"XL330-M288-T": "xl330_m288_fw52", "XL330-M077-T": "xl330_m077_fw52", "XL430-W250-T": "xl430_w250"}


def sdk_table(model: str) -> dict[str, tuple[int, int]]:
    """Name -> (address, size), as dynamixel_easy_sdk ships it."""
    text = (files("dynamixel_easy_sdk") / "control_table" / f"{SDK_FILES[model]}.model").read_text()
    rows = csv.reader(text.split("[control table]")[1].strip().splitlines()[1:], delimiter="\t")
    return {name: (int(address), int(size)) for address, size, name in rows}


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_agrees_with_the_makers_own_table(model: Model) -> None:
    theirs = sdk_table(model.name)
    ours = {register.name.value: (register.address, register.size) for register in model.registers.values()}
    plain = {name: place for name, place in theirs.items() if not name.startswith("Indirect")}
    assert len(plain) > 40
    assert {name: ours.get(name) for name in plain} == plain
    assert ours.keys() - plain.keys() == {"Startup Configuration", "Backup Ready"}  # in the e-manual only
    assert (model.indirect[0].address, 2) == theirs["Indirect Address 1"]
    assert (model.indirect[0].data, 1) == theirs["Indirect Data 1"]
    if len(model.indirect) > 1:
        assert (model.indirect[1].address, 2) == theirs["Indirect Address Read"]
        assert (model.indirect[1].data, 1) == theirs["Indirect Data Read"]


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_units_and_signs_agree_with_the_makers(model: Model) -> None:
    text = (files("dynamixel_easy_sdk") / "control_table" / f"{SDK_FILES[model.name]}.model").read_text()
    rows = csv.reader(text.split("[unit info]")[1].split("[control table]")[0].strip().splitlines()[1:], delimiter="\t")
    checked = 0
    for name, value, unit, sign in rows:
        register = model[Name(name)]
        assert register.signed == (sign == "signed"), name
        if unit == "rad/s":
            assert register.scale == pytest.approx(float(value), rel=1e-3), name
            checked += 1
    assert checked >= 2


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_a_table_is_consistent(model: Model) -> None:
    end = 0
    for name, register in model.registers.items():
        assert name is register.name
        assert register.address >= end, f"{name} overlaps the register before it"
        end = register.address + register.size
        low, high = (
            (-(1 << 8 * register.size - 1), 1 << 8 * register.size - 1) if register.signed else (0, 256**register.size)
        )
        for value in (register.initial, register.low, register.high, *register.choices):
            assert value is None or low <= value < high, name
        if register.initial is not None and register.low is not None and register.high is not None:
            assert register.low <= register.initial <= register.high, name
        assert register.eeprom == (register.address < 64)
        assert set(register.bounds) <= model.registers.keys()
    assert model_by_number(model.number) is model
    assert model[Name.MODEL_NUMBER].initial == model.number


def test_units() -> None:
    assert pytest.approx(2 * math.pi) == 4096 * RAD_PER_COUNT
    assert pytest.approx(math.radians(0.088), rel=2e-3) == RAD_PER_COUNT  # as the e-manual rounds it
    assert pytest.approx(0.0239691227, rel=1e-3) == VELOCITY_UNIT  # as the SDK's .model files have it
    assert pytest.approx(214.577 / 0.229) == 60 * ACCELERATION_UNIT / VELOCITY_UNIT
    assert BAUD_CODES[57600] == 1
    assert BAUD_CODES[1_000_000] == 3


def test_hardware_errors_in_words() -> None:
    assert HardwareError.words(0) == ""
    assert HardwareError.words(0x21) == "input voltage outside its limits, overload"
    assert HardwareError.words(0x84) == "overheating, bits 0x80"


def test_unknown_model_number() -> None:
    assert model_by_number(12) is None
