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
from robolamp.twin.lamp_body import Body
from robolamp.twin.lamp_model import Bend, build

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


def moved(convergence: ModuleType, goal: float, steps: tuple[float, float], stiffness: float, play: float) -> float:
    """How far a landing moves between two steps [ms], by what it may; if the lamp bends, the median of five starts."""
    rigid = math.isinf(stiffness) and not play
    coarse, fine = (
        float(np.median(convergence.landings(convergence.lamp(step / 1e3, stiffness, play), goal, 1 if rigid else 5)))
        for step in steps
    )
    assert coarse > 0.8 * goal
    share, least = (0.01, 0.003) if rigid else (0.03, 0.005)
    return abs(coarse - fine) / max(share * fine, least)


@pytest.mark.parametrize("goal", [0.2, 0.4, 0.6])
@pytest.mark.parametrize("steps", [(4.0, 2.0), (2.0, 1.0), (2.0, 0.5)])
def test_a_rigid_lamp_lands_where_it_does_with_finer_steps(
    convergence: ModuleType, goal: float, steps: tuple[float, float]
) -> None:
    assert moved(convergence, goal, steps, math.inf, 0.0) < 1.0


@pytest.mark.parametrize("goal", [0.2, 0.4, 0.6])
@pytest.mark.parametrize(("stiffness", "play"), [(100.0, 0.0), (400.0, 0.0), (1e4, 0.0), (math.inf, 0.002)])
def test_so_does_one_that_bends_or_has_play(
    convergence: ModuleType, goal: float, stiffness: float, play: float
) -> None:
    assert moved(convergence, goal, (1.0, 0.5), stiffness, play) < 1.0


def test_a_very_stiff_lamp_is_rigid_and_very_little_play_is_none(convergence: ModuleType) -> None:
    rigid, stiff, tight = (
        convergence.landings(convergence.lamp(1e-3, stiffness, play), 0.4)[0]
        for stiffness, play in ((math.inf, 0.0), (1e4, 0.0), (math.inf, 1e-5))
    )
    assert stiff == pytest.approx(rigid, rel=0.01)
    assert tight == pytest.approx(rigid, rel=0.02)


@pytest.mark.parametrize("step", [0.001, 0.0005])
@pytest.mark.parametrize("stiffness", [5.0, 20.0, 100.0, 1000.0])
def test_the_energy_of_a_bent_arm_falls(stiffness: float, step: float) -> None:
    twin = build(DESK, NOMINAL, ASSETS, Bend(stiffness=stiffness), timestep=step, clamped=True)
    body = Body(twin)
    body.set_motors(np.zeros(3), np.full(3, 5.0), np.zeros(3, bool))
    body.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    body.model.opt.gravity[:] = 0.0
    body.data.qpos[twin.gears.bending] = np.array([1.0, -1.0, 1.0]) * math.sqrt(0.02 / stiffness)  # 10 mJ each
    energy = []
    for _ in range(round(0.2 / step)):
        body.step()
        energy.append(float(body.data.energy.sum()))
    assert energy[0] == pytest.approx(0.03)
    mean = np.reshape(energy, (20, -1)).mean(axis=1)  # within a step, speed and angle are half a step apart
    assert (np.diff(mean) < 1e-12).all()
    assert mean[-1] < 0.2 * mean[0]


def test_a_bent_arm_swings_as_its_spring_and_inertia_say() -> None:
    """A head on its neck's spring: omega = sqrt(K / I), where nothing else moves."""
    stiffness, step = 20.0, 0.001
    twin = build(DESK, NOMINAL, ASSETS, Bend(stiffness=stiffness), timestep=step, clamped=True)
    model, data = twin.model, mujoco.MjData(twin.model)
    neck = int(twin.gears.bending_dof[2])
    model.opt.gravity[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    added = model.dof_armature[neck]
    model.dof_armature[np.arange(model.nv) != neck] = 1e3  # nothing else moves
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = full[neck, neck] - added
    data.qpos[twin.gears.bending[2]] = 0.002
    seen = []
    for _ in range(200):
        mujoco.mj_step(model, data)
        seen.append(data.qpos[twin.gears.bending[2]])
    signs = np.flatnonzero(np.diff(np.sign(seen)))
    period = 2.0 * step * float(np.diff(signs[:7]).mean())
    assert period == pytest.approx(math.tau * math.sqrt(inertia / stiffness), rel=0.05)
