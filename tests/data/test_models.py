"""The figures load, stand, and weigh what their READMEs say."""

from __future__ import annotations

import itertools
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.lamp import Lamp, load_lamp
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.lamp_body import Body

from .readme import ROOT, table

SCENES = sorted((ROOT / "sim").glob("*/scene.xml"))
README = "sim/lamp/README.md"
TOUCHING_FLOOR = ("foot", "lower_arm", "upper_arm", "head")


@pytest.fixture(scope="module")
def lamp() -> Lamp:
    return load_lamp(Assets())


@pytest.fixture(scope="module")
def twin(lamp: Lamp) -> TwinModel:
    return build(lamp, load_calibration(Assets()), Assets())


@pytest.fixture(scope="module")
def bare() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(ROOT / "sim/lamp/lamp.xml"))


def lean(data: mujoco.MjData) -> float:
    """Angle of the first body from upright [rad]."""
    return float(np.arccos(np.clip(data.xmat[1][8], -1, 1)))


@pytest.mark.parametrize("scene", SCENES, ids=lambda path: path.parent.name)
def test_figure_stands_without_a_warning(scene: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(scene))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    heights = data.xpos[1:, 2].copy()
    for _ in range(round(2 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        assert not data.warning.number.any()
    assert lean(data) < np.radians(2)
    assert np.abs(data.xpos[1:, 2] - heights).max() < 0.015  # the servos give a little under the weight


@pytest.mark.parametrize("scene", SCENES, ids=lambda path: path.parent.name)
def test_figure_loads_without_its_scene(scene: Path) -> None:
    path = scene.with_name(f"{scene.parent.name}.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.nkey == 1
    assert model.key(0).name == "home"


def test_twin_stands_with_its_friction(twin: TwinModel) -> None:
    body = Body(twin)
    body.step(1000)
    assert not body.data.warning.number.any()
    assert lean(body.data) < np.radians(2)
    assert np.abs(body.angle).max() < 0.075  # weight over stiffness, a P controller's standing error
    assert body.force == pytest.approx(twin.model.body_mass.sum() * 9.81, rel=0.01)


def test_actuators_are_those_of_the_nominal_calibration(bare: mujoco.MjModel, twin: TwinModel) -> None:
    assert [bare.actuator(i).name for i in range(bare.nu)] == list(twin.lamp.names)
    for name in ("actuator_gainprm", "actuator_biasprm", "actuator_damping", "actuator_armature"):
        built, shipped = getattr(twin.model, name), getattr(bare, name)
        np.testing.assert_allclose(shipped, built, rtol=1e-4, err_msg=name)
    np.testing.assert_allclose(bare.actuator_delay, twin.servos.delay, rtol=1e-4)
    joints = [int(bare.joint(name).dofadr[0]) for name in twin.lamp.names]
    for name in ("dof_damping", "dof_armature"):
        shipped, built = getattr(bare, name)[joints], getattr(twin.model, name)[twin.dof]
        np.testing.assert_allclose(shipped, built, rtol=1e-4, err_msg=name)


def test_motor_stalls_and_runs_free_as_the_readme_says(twin: TwinModel) -> None:
    servos = twin.servos
    k, r, v = servos.torque_constant[0], servos.resistance[0], twin.voltage
    assert k * v / r == pytest.approx(0.544, abs=0.0005)
    share = 1 - servos.load_motor[0]
    free = (share * k * v / r - servos.coulomb[0]) / (share * k * k / r + servos.viscous[0])
    assert free == pytest.approx(11.5, abs=0.05)


def test_mass_is_that_of_a_hand_sized_lamp(bare: mujoco.MjModel) -> None:
    assert 0.2 <= bare.body_mass.sum() <= 0.25


def test_link_table_is_the_model(bare: mujoco.MjModel) -> None:
    rows = table(README, "body", "mass [g]")
    assert [row[0] for row in rows] == [bare.body(i).name for i in range(1, bare.nbody)] + ["all"]
    for name, mass, *more in rows[:-1]:
        body = bare.body(name)
        assert float(mass) == pytest.approx(1000 * body.mass[0], abs=0.06), name
        forward, up, about = (float(value) for value in more[:3])
        assert (forward, up) == pytest.approx(tuple(1000 * body.ipos[[0, 2]]), abs=0.06), name
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        pitch = (turn.reshape(3, 3) @ np.diag(body.inertia) @ turn.reshape(3, 3).T)[1, 1]
        assert about == pytest.approx(1e6 * pitch, abs=0.06), name
    assert float(rows[-1][1]) == pytest.approx(1000 * bare.body_mass.sum(), abs=0.06)


def test_contact_shapes_are_the_model(bare: mujoco.MjModel) -> None:
    rows = table(README, "body", "geom", "size [mm]")
    assert [row[1] for row in rows] == list(TOUCHING_FLOOR)
    for body, name, size, _ in rows:
        geom = bare.geom(name)
        assert bare.body(geom.bodyid[0]).name == body
        assert [float(value) for value in size.split()] == pytest.approx(list(geom.size[geom.size > 0] * 1000))
    colliding = {bare.geom(i).name for i in range(bare.ngeom) if bare.geom(i).contype[0] or bare.geom(i).conaffinity[0]}
    assert colliding == set(TOUCHING_FLOOR)


def test_joint_table_is_model_and_lamp(bare: mujoco.MjModel, lamp: Lamp) -> None:
    rows = table(README, "joint", "range [rad]", "goal angles [rad]")
    assert [row[0] for row in rows] == list(lamp.names)
    for joint, (name, stops, goals, _) in zip(lamp.joints, rows, strict=True):
        low, high = (float(value) for value in stops.split())
        assert (low, high) == pytest.approx(tuple(bare.joint(name).range))
        assert [float(value) for value in goals.split()] == pytest.approx([joint.lower, joint.upper])
        assert 0.02 - 1e-9 <= joint.lower - low <= 0.05 + 1e-9
        assert 0.02 - 1e-9 <= high - joint.upper <= 0.05 + 1e-9


def test_solver_table_is_the_model(twin: TwinModel) -> None:
    model = twin.model
    foot = model.geom("foot")
    values = {
        "timestep": f"{model.opt.timestep:g}",
        "integrator": mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_").lower(),
        "cone": mujoco.mjtCone(model.opt.cone).name.removeprefix("mjCONE_").lower(),
        "impratio": f"{model.opt.impratio:g}",
        "condim": f"{foot.condim[0]}",
        "friction": " ".join(f"{value:g}" for value in foot.friction),
        "solref": " ".join(f"{value:g}" for value in foot.solref),
        "gravity": f"{-model.opt.gravity[2]:g}",
    }
    assert {row[0]: row[1] for row in table(README, "where", "value")} == values


def test_servo_table_is_the_model(bare: mujoco.MjModel) -> None:
    gain, knee = bare.actuator("knee").gainprm, bare.actuator("knee").id
    values = {
        "motorconst": gain[1],
        "resistance": gain[0],
        "controller kp": gain[4],
        "controller kd": gain[6],
        "controller vmax": gain[7],
        "damping": bare.actuator_damping[knee],
        "armature": bare.actuator_armature[knee],
        "delay": bare.actuator_delay[knee],
    }
    assert {row[0]: float(row[1]) for row in table(README, "attribute", "value")} == pytest.approx(values)


def test_positive_angles_pitch_forward(bare: mujoco.MjModel, lamp: Lamp) -> None:
    data = mujoco.MjData(bare)
    for name in lamp.names:
        mujoco.mj_resetDataKeyframe(bare, data, 0)
        mujoco.mj_forward(bare, data)
        before = data.site("head").xmat.reshape(3, 3)[:, 2].copy()
        data.joint(name).qpos[0] = 0.1
        mujoco.mj_forward(bare, data)
        after = data.site("head").xmat.reshape(3, 3)[:, 2]
        assert np.cross(before, after)[1] == pytest.approx(np.sin(0.1))


def test_no_part_touches_another_inside_the_limits(bare: mujoco.MjModel, lamp: Lamp) -> None:
    names = {bare.geom(i).name: i for i in range(bare.ngeom)}
    apart = (("foot", "shade"), ("foot", "bulb"), ("foot", "upper_arm"), ("foot", "lower_arm"),
             ("foot", "lower_arm_servo"), ("lower_arm", "shade"), ("lower_arm", "bulb"),
             ("lower_arm_servo", "shade"))  # fmt: skip
    data = mujoco.MjData(bare)
    address = [bare.joint(name).qposadr[0] for name in lamp.names]
    grid = [np.linspace(low, high, 7) for low, high in zip(lamp.lower, lamp.upper, strict=True)]
    for pose in itertools.product(*grid):
        mujoco.mj_resetDataKeyframe(bare, data, 0)
        data.qpos[address] = pose
        mujoco.mj_kinematics(bare, data)
        for one, other in apart:
            gap = mujoco.mj_geomDistance(bare, data, names[one], names[other], 0.01, None)
            assert gap > 0.001, f"{one} and {other} are {1000 * gap:.1f} mm apart at {np.round(pose, 2)}"
