"""What is simulated does not depend on the step: landings of a hop whose goals are frozen, and springs left alone.

`benchmarks/convergence.py` measures the same for more lamps and from more starts.
"""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.lamp import load_lamp
from robolamp.twin.actuators.motors import Motors, Views
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.lamp_body import Body

ASSETS = Assets()
DESK = load_lamp(ASSETS)
NOMINAL = load_calibration(ASSETS)


@pytest.fixture(scope="module")
def convergence() -> ModuleType:
    path = Path(__file__).parents[2] / "benchmarks/convergence.py"
    spec = importlib.util.spec_from_file_location("convergence", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("goal", [0.2, 0.4, 0.6])
@pytest.mark.parametrize("steps", [(4.0, 2.0), (2.0, 1.0), (2.0, 0.5)])
def test_a_rigid_lamp_lands_where_it_does_with_finer_steps(
    convergence: ModuleType, goal: float, steps: tuple[float, float]
) -> None:
    coarse, fine = (float(convergence.landings(convergence.lamp(step / 1e3), goal)[0]) for step in steps)
    assert coarse > 0.8 * goal
    assert abs(coarse - fine) < max(0.01 * fine, 0.003)


@pytest.mark.parametrize("goal", [0.2, 0.4, 0.6])
@pytest.mark.parametrize(
    ("stiffness", "play"), [(100.0, 0.0), (400.0, 0.0), (1e4, 0.0), (math.inf, 0.002), (23.0, 0.005)]
)
def test_so_does_one_that_bends_or_has_play(
    convergence: ModuleType, goal: float, stiffness: float, play: float
) -> None:
    """By medians, as such lamps are chaotic: within two standard errors of 3 % or 5 mm."""
    coarse, fine = (median(convergence, convergence.lamp(step, stiffness, play), goal) for step in (2e-3, 1e-3))
    assert coarse[0] > 0.8 * goal
    assert abs(coarse[0] - fine[0]) < max(0.03 * fine[0], 0.005) + 2.0 * math.hypot(coarse[1], fine[1])


def median(convergence: ModuleType, twin: TwinModel, goal: float) -> tuple[float, float]:
    """Return the median of some landings, and its standard error by a normal law [m]."""
    landed = convergence.landings(twin, goal, 12)
    stood = landed[~np.isnan(landed)]
    assert len(stood) > 3
    return float(np.median(stood)), 1.25 * float(np.std(stood)) / math.sqrt(len(stood))


def test_a_very_stiff_lamp_is_rigid_and_very_little_play_is_none(convergence: ModuleType) -> None:
    rigid, stiff, tight = (
        convergence.landings(convergence.lamp(1e-3, stiffness, play), 0.4)[0]
        for stiffness, play in ((math.inf, 0.0), (1e4, 0.0), (math.inf, 1e-5))
    )
    assert stiff == pytest.approx(rigid, rel=0.01)
    assert tight == pytest.approx(rigid, rel=0.02)


@pytest.mark.parametrize("step", [0.002, 0.001, 0.0005])
@pytest.mark.parametrize("stiffness", [5.0, 20.0, 100.0, 1000.0])
def test_the_energy_of_a_bent_arm_falls(stiffness: float, step: float) -> None:
    twin = build(DESK, NOMINAL, ASSETS, Bend(stiffness=stiffness, backlash=0.0), timestep=step, clamped=True)
    body = Body(twin)
    body.set_motors(np.zeros(3), np.full(3, 5.0), np.zeros(3, bool))
    body.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    body.model.opt.gravity[:] = 0.0
    body.data.qpos[twin.gears.qpos] = np.array([1.0, -1.0, 1.0]) * math.sqrt(0.02 / stiffness)  # 10 mJ each
    springs, moving = [], []
    for _ in range(round(0.2 / step) + 1):
        springs.append(0.5 * stiffness * float((body.data.qpos[twin.gears.qpos] ** 2).sum()))
        body.step()
        moving.append(float(body.data.energy[1]))  # at the step's start
    assert springs[0] == pytest.approx(0.03)
    energy = np.array(springs[:-1]) + (np.array(moving[:-1]) + moving[1:]) / 2  # speeds are half a step from angles
    mean = energy.reshape(10, -1).mean(axis=1)
    assert (np.diff(mean) < 1e-12).all()
    assert mean[-1] < 0.2 * mean[0]


def test_a_bent_arm_swings_as_its_spring_and_inertia_say() -> None:
    """A head on its neck's spring: omega = sqrt(K / I), where nothing else moves."""
    stiffness, step = 20.0, 0.001
    twin = build(DESK, NOMINAL, ASSETS, Bend(stiffness=stiffness, backlash=0.0), timestep=step, clamped=True)
    model, data = twin.model, mujoco.MjData(twin.model)
    neck = int(twin.gears.dof[2])
    model.opt.gravity[:] = 0.0
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = full[neck, neck]
    data.qpos[twin.gears.qpos[2]] = 0.002
    motors = Motors([twin], Views.of_one(model, data))
    seen = []
    for _ in range(200):
        motors.before_step()
        model.dof_frictionloss[:] = 0.0
        model.dof_armature[np.arange(model.nv) != neck] = 1e3  # nothing else moves
        mujoco.mj_step(model, data)
        seen.append(data.qpos[twin.gears.qpos[2]])
    signs = np.flatnonzero(np.diff(np.sign(seen)))
    period = 2.0 * step * float(np.diff(signs[:7]).mean())
    assert period == pytest.approx(math.tau * math.sqrt(inertia / stiffness), rel=0.05)
