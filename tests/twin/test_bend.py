"""Bent lamps beside others: what a lamp differs in acts in a lane of many as in a fleet of its own."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import load_controller
from robolamp.controller.terminals import on_board_terminals
from robolamp.lamp import load_lamp
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.fleet import Fleet, Job

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
NOMINAL = load_calibration(ASSETS)
HOP = load_controller(ASSETS.path("sim/lamp/controllers/hop-counting.toml"), LAMP).compile(on_board_terminals(3))

PLAIN = Bend(
    stiffness=40.0, backlash=0.004, encoder_nonlinearity=0.002, resistance=0.05, foot_noise=0.02, floor_tilt=0.002
)
OTHER: dict[str, Any] = {
    "strength": np.array([1.0, 0.9, 1.0]), "friction": 1.2, "coulomb": 1.3, "viscous": 1.3, "stribeck": 1.5,
    "stribeck_velocity": 1.3, "load_friction": 1.2, "armature": 1.2, "link_mass": np.array([1.0, 1.1, 1.0]),
    "backlash": 0.006, "encoder_offset": 0.01, "encoder_nonlinearity": 0.006, "encoder_phase": 2.0, "delay": 0.002,
    "supply": -0.3, "resistance": 0.2, "foot_gain": 1.3, "foot_noise": 0.3, "floor_friction": 0.6, "floor_tilt": 0.02,
    "floor_softness": 2.0, "mass": 1.1, "sideways": 0.002, "stiffness": 20.0, "seed": 7,
}  # fmt: skip


def lamp(bend: Bend) -> TwinModel:
    return build(LAMP, NOMINAL, ASSETS, bend)


def ran(twins: list[TwinModel], variant: int, workers: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return what the hop sees and sends on one of some lamps, and how its run ends."""
    jobs = [Job(0, variant, 0.3), Job(0, 0, 0.1), Job(0, len(twins) - 1, 0.2)]
    outcome = Fleet(twins, 0.02, workers).run([HOP], jobs, 1.2, record=True)
    assert outcome.trace is not None
    seen = np.concatenate([outcome.trace.inputs[0], outcome.trace.goals[0]], axis=1)
    return seen, np.array([outcome.error[0], outcome.tilt[0], *outcome.angles[0]])


@pytest.fixture(scope="module")
def plain() -> TwinModel:
    return lamp(PLAIN)


@pytest.mark.parametrize("name", [field.name for field in fields(Bend)])
def test_a_lamp_differs_in_it_and_does_the_same_beside_others(name: str, plain: TwinModel) -> None:
    other = lamp(replace(PLAIN, **{name: OTHER[name]}))
    alone, beside = ran([other], 0), ran([plain, other], 1, workers=2)
    for one, two in zip(alone, beside, strict=True):
        np.testing.assert_array_equal(one, two)
    assert not np.array_equal(alone[0], ran([plain], 0)[0]), "it does nothing"
