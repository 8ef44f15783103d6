"""A motor that saturates and a supply that sags: the same weakness in a body, a fleet and the formula."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import Calibration, Parameter, load_calibration
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.lanes.lamp_lanes import settle

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
NOMINAL = load_calibration(ASSETS)
MODEL = LAMP.joints[0].servo
SATURATION, SUPPLY = 0.3, 0.4


def changed(**values: float) -> Calibration:
    servo = {**NOMINAL.groups[MODEL], **{name: Parameter(value, "", None, "") for name, value in values.items()}}
    return dataclasses.replace(NOMINAL, groups={**NOMINAL.groups, MODEL: servo})


def held_torque(calibration: Calibration, error: float) -> np.ndarray:
    """Torque of motors whose joints are held still by friction at an error [Nm]."""
    body = Body(build(LAMP, calibration, ASSETS))
    body.set_goal(np.full(len(LAMP.joints), error))
    for _ in range(40):
        body.data.qvel[:] = 0.0
        body.data.qpos[:] = body.model.key_qpos[0]
        body.step()
    return body.torque.copy()


@pytest.mark.parametrize("error", [0.1, 0.25, -0.6])
def test_a_stalled_motor_gives_what_the_formula_says(error: float) -> None:
    values = NOMINAL.servo(MODEL, "knee")
    k, r, volts = values["torque_constant"], values["resistance"], NOMINAL.lamp("supply_voltage")
    full = held_torque(NOMINAL, error)
    duty = full * r / k / volts
    current = full / k
    saturated = k * current / (1 + SATURATION * np.abs(current))
    np.testing.assert_allclose(held_torque(changed(saturation=SATURATION), error), saturated, rtol=1e-6)
    sagging = k * volts * duty / (r + SUPPLY * duty**2)
    np.testing.assert_allclose(held_torque(changed(supply_resistance=SUPPLY), error), sagging, rtol=1e-6)


def test_terms_that_are_off_change_nothing_to_the_bit() -> None:
    off = changed(saturation=0.0, supply_resistance=0.0, asymmetry=0.0, stribeck_exponent=1.0, load_motor_stribeck=0.0)
    np.testing.assert_array_equal(settle(build(LAMP, NOMINAL, ASSETS)), settle(build(LAMP, off, ASSETS)))
    on = changed(asymmetry=0.2, saturation=SATURATION)
    assert (settle(build(LAMP, NOMINAL, ASSETS)) != settle(build(LAMP, on, ASSETS))).any()
