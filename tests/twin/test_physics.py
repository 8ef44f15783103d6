"""The body against mechanics that can be written down: free fall, energy, weight, and that friction only takes."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.lamp_body import Body

from .parts import ASSETS, CALIBRATION, LAMP, TWIN, N

G = 9.81


def floating(friction: float, timestep: float) -> Body:
    """A lamp high above the floor, torque off, its joints turning."""
    twin = build(LAMP, CALIBRATION, ASSETS, Bend(friction=friction), timestep=timestep)
    body = Body(twin)
    body.set_motors(twin.p_gain, np.full(N, twin.voltage), np.zeros(N, bool))
    body.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    body.data.qpos[2] = 5.0
    body.data.qvel[twin.dof] = [1.0, -1.5, 2.0]
    mujoco.mj_forward(body.model, body.data)
    return body


def test_the_centre_of_mass_falls_with_g_whatever_the_joints_do() -> None:
    body = floating(friction=1.0, timestep=1e-4)
    start = body.data.subtree_com[0].copy()
    mujoco.mj_subtreeVel(body.model, body.data)
    velocity = body.data.subtree_linvel[0].copy()
    body.step(2000)
    mujoco.mj_forward(body.model, body.data)
    time = body.data.time
    expected = start + velocity * time + np.array([0, 0, -G * time**2 / 2])
    np.testing.assert_allclose(body.data.subtree_com[0], expected, atol=2e-4)


def test_energy_is_kept_without_friction_and_lost_with_it() -> None:
    changes = []
    for friction in (0.0, 1.0):
        body = floating(friction, timestep=5e-5)
        body.model.opt.gravity[:] = 0  # falling would swamp what the joints hold
        mujoco.mj_forward(body.model, body.data)
        before = body.data.energy.sum()
        kinetic = body.data.energy[1]
        body.step(3000)  # the neck is about to meet its limit
        mujoco.mj_forward(body.model, body.data)
        changes.append((body.data.energy.sum() - before) / kinetic)
    kept, lost = changes
    assert abs(kept) < 2e-3
    assert lost < -0.2


def test_it_stands_still_in_the_neutral_pose_and_the_foot_carries_its_weight() -> None:
    body = Body(TWIN)
    body.step(1000)
    weight = TWIN.model.body_mass.sum() * G
    assert body.force == pytest.approx(weight, rel=1e-3)
    x, z, pitch = body.base
    assert abs(x) < 1e-3
    assert abs(z) < 1e-3
    assert abs(pitch) < 0.01
    assert np.abs(body.velocity).max() < 0.02  # friction in MuJoCo is soft: a loaded joint creeps towards its sag
    assert not [count for count in body.data.warning.number if count]


def test_bodies_of_one_twin_share_nothing() -> None:
    first, second = Body(TWIN), Body(TWIN)
    first.set_motors(np.full(N, 100.0), np.full(N, 3.0), np.zeros(N, bool))
    first.step(50)
    untouched = Body(TWIN)
    for body in (second, untouched):
        body.step(50)
    assert second.angle.tolist() == untouched.angle.tolist()
    assert second.angle.tolist() != first.angle.tolist()


def test_the_bases_pitch_is_positive_forward() -> None:
    body = Body(TWIN)
    for angle in (-1.2, -0.3, 0.0, 0.4, 1.5):
        body.data.qpos[:7] = [0.1, 0.0, 0.2, np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0]
        mujoco.mj_kinematics(body.model, body.data)
        assert body.base == pytest.approx((0.1, 0.2, angle))
        up = body.data.xmat[body.model.body("base").id].reshape(3, 3)[:, 2]
        assert np.sign(up[0]) == np.sign(angle)  # the foot's axis leans towards +x


def test_the_current_is_what_an_energy_balance_says() -> None:
    """Electrical power = winding's heat + mechanical power, wherever the duty is positive work."""
    body = Body(TWIN)
    body.step(300)
    body.set_goal(np.array([0.3, -0.4, 0.3]))
    for _ in range(40):
        speed = body.data.qvel[TWIN.dof].copy()  # of the motors: the horns' is another where gears give
        body.step()
        winding = body.torque / TWIN.servos.torque_constant
        power = TWIN.servos.resistance * winding**2 + body.torque * speed
        # `current` keeps the winding's sign; what the supply gives is duty times winding current.
        np.testing.assert_allclose(np.abs(body.current) * TWIN.voltage, np.abs(power), atol=1e-9)


def test_what_is_there_to_be_seen_changes_nothing_but_pictures(tmp_path: Path) -> None:
    ends = []
    for twin in (TWIN, build(LAMP, CALIBRATION, ASSETS, looks=True)):
        body = Body(twin)
        for goals in ([0.3, 0.6, -0.5], [-0.3, -0.9, 0.2], [0.0, 0.0, 0.0]):
            body.set_goal(np.array(goals))
            body.step(150)
        ends.append(body.data.qpos.copy())
    np.testing.assert_array_equal(ends[0], ends[1])
    assert not TWIN.model.nmesh
    assert TWIN.seen.nmesh > 10
    assert TWIN.seen.nq == TWIN.model.nq

    folder = tmp_path / "sim/lamp"  # where a link weighs what its geoms weigh, they stay
    shutil.copytree(ASSETS.path("sim/lamp/lamp.xml").parent, folder)
    text = (folder / "lamp.xml").read_text(encoding="utf-8")
    text = re.sub(r'(<joint name="neck"[^>]*>)\s*<inertial[^>]*>', r"\1", text)
    (folder / "lamp.xml").write_text(text.replace('mesh="shade"/>', 'mesh="shade" mass="0.05"/>'), encoding="utf-8")
    own = build(LAMP, CALIBRATION, Assets.of(tmp_path))
    assert own.model.body("head").mass[0] == pytest.approx(0.05)
