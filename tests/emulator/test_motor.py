from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.dynamixel.registers import MODELS
from robolamp.emulator.servo.bare_motor import DATASHEETS, Motor
from robolamp.emulator.servo.regulators import duty_for_current


@pytest.mark.parametrize("model", MODELS)
class TestDatasheet:
    def test_no_load_speed_and_stall_current(self, model: str) -> None:
        sheet, motor = DATASHEETS[model], Motor(MODELS[model])
        motor.step(3.0, sheet.voltage)
        assert motor.velocity == pytest.approx(sheet.no_load_speed, rel=0.01)
        motor.locked = True
        motor.step(0.001, sheet.voltage)
        assert motor.current == pytest.approx(sheet.stall_current)
        low = 0.81 if model == "XL330-M077-T" else 1.0
        assert motor.torque - sheet.coulomb == pytest.approx(low * sheet.stall_torque, rel=0.02)

    def test_an_open_winding_coasts_and_a_shorted_one_brakes(self, model: str) -> None:
        still = []
        for voltage in (None, 0.0):
            motor = Motor(MODELS[model])
            motor.step(1.0, DATASHEETS[model].voltage)
            motor.step(0.02, voltage)
            still.append(motor.velocity)
        assert still[0] > 1.2 * still[1] > 0

    def test_dry_friction_holds_a_small_torque(self, model: str) -> None:
        motor = Motor(MODELS[model], external=0.9 * DATASHEETS[model].coulomb)
        motor.step(1.0, None)
        assert motor.angle == math.pi
        motor.external *= 1.2
        motor.step(1.0, None)
        assert motor.angle > math.pi


def test_energy_is_kept() -> None:
    """Electrical work in = heat of the winding + friction + what the shaft has gained."""
    model = MODELS["XL330-M288-T"]
    sheet, motor, load = DATASHEETS[model.name], Motor(model, load=0.002), 0.002
    work = lost = 0.0
    dt = 1e-5
    for _ in range(20_000):
        motor.step(dt, 4.0)
        work += 4.0 * motor.current * dt
        w = motor.velocity
        lost += (sheet.resistance * motor.current**2 + sheet.viscous * w * w + sheet.coulomb * abs(w)) * dt
    gained = 0.5 * (sheet.armature + load) * motor.velocity**2
    assert work == pytest.approx(lost + gained, rel=1e-3)


@given(st.floats(-1.5, 1.5), st.floats(-8.0, 8.0), st.floats(3.5, 7.0))
def test_the_duty_for_a_current_draws_it(current: float, speed: float, voltage: float) -> None:
    k, r = 0.36, 3.4
    duty = duty_for_current(current, speed, voltage, k, r)
    winding = (duty * voltage - k * speed) / r
    drawn = abs(duty) * winding if current else winding
    assert drawn == pytest.approx(current, abs=1e-9)
