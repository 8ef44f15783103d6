"""What voltages and currents tell of the supply, through the wire."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robolamp.calibrate.lamp.session import LampRecording, read_session
from robolamp.calibrate.lamp.supply import measure_supply
from tests.calibrate.sessions import LAMP, NOMINAL, recorded, short, steps

OHM, VOLTS = 0.15, -0.1


@pytest.fixture(scope="module")
def sagging(tmp_path_factory: pytest.TempPathFactory) -> tuple[LampRecording, ...]:
    folder = tmp_path_factory.mktemp("sag")
    file = folder / "sag.toml"
    file.write_text(f'name = "sag"\n[supply]\nresistance = {OHM}\nvoltage = {VOLTS}\n')
    plan = [short(steps("squares")[0], 3.0), short(steps("steps-firm")[0], 2.0)]
    recorded(folder / "session", plan, str(file))
    return read_session(folder / "session", LAMP).recordings


def test_resistance_and_voltage_are_found(sagging: tuple[LampRecording, ...]) -> None:
    found = measure_supply(sagging, NOMINAL)
    value, error = found["supply_resistance"]
    assert error < 0.02
    assert value == pytest.approx(OHM, abs=max(3 * error, 0.1 * OHM))
    assert found["supply_voltage"][0] == pytest.approx(NOMINAL.lamp("supply_voltage") + VOLTS, abs=0.05)


def test_a_stiff_supply_has_no_resistance(tmp_path: Path) -> None:
    recorded(tmp_path, [short(steps("steps-firm")[0], 2.0)])
    found = measure_supply(read_session(tmp_path, LAMP).recordings, NOMINAL)
    assert list(found) == ["supply_voltage"]
    assert found["supply_voltage"][0] == pytest.approx(5.0, abs=0.05)


def test_readings_that_are_all_alike_tell_no_resistance(sagging: tuple[LampRecording, ...]) -> None:
    for volts in np.arange(4.5, 5.5, 0.1):
        flat = [replace(one, run=replace(one.run, voltage=np.full_like(one.run.voltage, volts))) for one in sagging]
        assert list(measure_supply(flat, NOMINAL)) == ["supply_voltage"]


def test_servos_that_read_no_current_or_no_voltage(sagging: tuple[LampRecording, ...]) -> None:
    one = sagging[0]
    blank = np.full_like(one.run.current, np.nan)
    mute = replace(one, run=replace(one.run, current=blank))
    found = measure_supply([mute], NOMINAL)
    assert list(found) == ["supply_voltage"]
    assert found["supply_voltage"][0] == pytest.approx(float(np.nanmedian(one.run.voltage[one.rows])), abs=0.05)
    blind = replace(one, run=replace(one.run, voltage=blank))
    assert measure_supply([blind], NOMINAL)["supply_voltage"][0] == NOMINAL.lamp("supply_voltage")
