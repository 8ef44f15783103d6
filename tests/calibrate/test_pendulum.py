"""The step that is written out for fits is MuJoCo's, and each term of the servo's model does what it says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robolamp.calibrate.servo.fast_pendulum import Pendulum, parameter_set
from robolamp.calibrate.servo.ladder import LADDER, switched_off
from robolamp.calibrate.servo.mujoco_bench import Bench
from robolamp.errors import FileError
from robolamp.twin.pendulum_model import POINT, Load
from tests.calibrate.bench_parts import COUNT, NOMINAL, TRUTH, chirp, drop, record, steps

EVERYTHING = {
    **NOMINAL, "stribeck_exponent": 0.7, "load_motor_stribeck": 0.05, "asymmetry": -0.08, "saturation": 0.3,
    "supply_resistance": 0.2, "resistance_temperature": 0.008, "viscous_temperature": -0.05, "encoder_offset": 0.02,
}  # fmt: skip
RECORDINGS = [
    record(steps, seconds=2.0), record(chirp, p_gain=800.0, seconds=2.5), record(drop, off_at=1.0, seconds=2.0, seed=3),
]  # fmt: skip


@pytest.mark.parametrize("values", [switched_off(NOMINAL), TRUTH, EVERYTHING], ids=["simplest", "truth", "everything"])
def test_the_written_out_step_is_mujocos(values: dict[str, float]) -> None:
    warm = [type(each)(**{**vars(each), "temperature": np.linspace(26, 39, len(each.time))}) for each in RECORDINGS]
    sets = np.stack([parameter_set(values), parameter_set({**values, "coulomb": 0.02, "delay": 0.011})])
    there, here = Bench(warm, workers=2).simulate(sets), Pendulum(warm, workers=2).simulate(sets)
    for mujoco, written in zip(there, here, strict=True):
        assert np.ptp(mujoco) > 0.5
        np.testing.assert_allclose(written, mujoco, rtol=0, atol=1e-7)


STRONG = {
    **EVERYTHING, "stribeck": 0.05, "stribeck_velocity": 2.0, "load_external_stribeck": 0.5, "load_motor_stribeck": 0.3,
    "asymmetry": 0.4, "stribeck_exponent": 0.3,
}  # fmt: skip


@pytest.mark.parametrize("name", [name for rung in LADDER[1:] for name in rung.parameters])
def test_each_term_can_be_switched_on_alone_and_shows(name: str) -> None:
    made = RECORDINGS[0]
    warm = type(made)(**{**vars(made), "temperature": np.full(len(made.time), 45.0)})
    off = switched_off(NOMINAL)
    if name in ("stribeck_velocity", "stribeck_exponent"):  # say how another term falls with speed
        off["stribeck"] = STRONG["stribeck"]
    pendulum = Pendulum([warm], workers=1)
    without, with_it = pendulum.simulate(np.stack([parameter_set(off), parameter_set({**off, name: STRONG[name]})]))[0]
    assert np.abs(with_it - without).max() > 2 * COUNT


def test_a_servo_held_by_friction_does_not_creep() -> None:
    seconds = 6.0
    held = record(drop, {**TRUTH, "coulomb": 0.1}, seconds=seconds, p_gain=200.0)
    late = held.time > seconds / 2
    assert np.ptp(held.angle[late]) < 0.004
    assert 0.1 < held.angle[-1] < 1.2  # far from the goal, away from hanging


def test_without_torque_the_pendulum_swings_out() -> None:
    free = record(drop, off_at=0.8, seconds=5.0)
    after = free.angle[free.time > 0.8]
    assert after.min() < -0.2  # through the lowest point: no braking by a shorted winding
    assert abs(after[-1] - TRUTH["encoder_offset"]) < 0.1


def test_a_recording_without_weight_or_supply_is_refused() -> None:
    made = RECORDINGS[0]
    with pytest.raises(FileError, match="not of a pendulum bench: no mass and length"):
        Pendulum([type(made)(**{**vars(made), "mass": None})])
    with pytest.raises(FileError, match="no supply voltage"):
        Bench([type(made)(**{**vars(made), "voltage": np.full(len(made.time), math.nan)})])


ROD = Load(0.0, 0.1, 0.3)


@pytest.mark.parametrize("load", [Load(0.49, 0.1), Load(0.2, 0.1, 0.15), ROD])
def test_one_body_is_the_weight_and_its_rod(load: Load) -> None:
    mass, centre, inertia = load.body
    assert mass == pytest.approx(load.mass + load.arm_mass)
    assert mass * centre == pytest.approx((load.mass + load.arm_mass / 2) * load.length)
    assert inertia + mass * centre**2 - POINT == pytest.approx((load.mass + load.arm_mass / 3) * load.length**2)


@pytest.mark.parametrize("load", [Load(0.2, 0.1, 0.15), ROD])
def test_a_rod_swings_as_a_rod(load: Load) -> None:
    made = record(drop, off_at=0.7, seconds=4.0)
    heavy = type(made)(**{**vars(made), "mass": load.mass, "arm_mass": load.arm_mass})
    smooth = {**switched_off(NOMINAL), "coulomb": 1e-5, "viscous": 1e-5, "load_motor": 0.0, "load_external": 0.0}
    sets = parameter_set(smooth)[None]
    there, here = Bench([heavy], workers=1).simulate(sets)[0][0], Pendulum([heavy], workers=1).simulate(sets)[0][0]
    np.testing.assert_allclose(here, there, rtol=0, atol=1e-7)
    free = heavy.time > 0.8
    time, angle = heavy.time[free], here[free]
    up = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    period = float(np.mean(np.diff(time[up] - angle[up] * np.diff(time)[up] / np.diff(angle)[up])))
    # A physical pendulum, with the elliptic integral's series for its amplitude.
    inertia = smooth["armature"] + (load.mass + load.arm_mass / 3) * 0.1**2
    small = 2 * math.pi * math.sqrt(inertia / ((load.mass + load.arm_mass / 2) * 9.81 * 0.1))
    top = float(np.abs(angle).max())
    assert period == pytest.approx(small * (1 + top**2 / 16 + 11 * top**4 / 3072 + 173 * top**6 / 737280), rel=0.01)
