from __future__ import annotations

import copy
import dataclasses
import math

import mujoco
import numpy as np
import pytest

from robolamp.calibration import SERVO
from robolamp.errors import FileError
from robolamp.twin.actuators.motors import Motors, Views
from robolamp.twin.actuators.servo import friction_loss
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.lamp_body import Body

from .parts import ASSETS, CALIBRATION, LAMP, TWIN, N, bent


def torques(angle: np.ndarray, velocity: np.ndarray, goal: np.ndarray, *, torque: bool = True) -> np.ndarray:
    """What the motors give at one state, the goal long since arrived [Nm]."""
    model = copy.copy(TWIN.model)
    data = mujoco.MjData(model)
    data.qpos[:] = model.key_qpos[0]
    data.qpos[TWIN.qpos] = angle
    data.qvel[TWIN.dof] = velocity
    motors = Motors([TWIN], Views.of_one(model, data))
    motors.forget(goal)
    motors.driven[:] = torque
    motors.before_step()
    mujoco.mj_forward(model, data)
    return data.qfrc_actuator[TWIN.dof].copy()


def test_the_motor_is_a_voltage_behind_a_winding() -> None:
    """tau = K (V - K w) / R, V = duty Vin, duty = clip(gain counts / 885, -1, 1), 4096 counts a turn."""
    rng = np.random.default_rng(1)
    servo = CALIBRATION.servo(LAMP.joints[0].servo, "ankle")
    k, r, supply = servo["torque_constant"], servo["resistance"], CALIBRATION.lamp("supply_voltage")
    clipped = 0
    for _ in range(100):
        angle, velocity = rng.uniform(-0.5, 0.5, N), rng.uniform(-8, 8, N)
        goal = angle + rng.normal(0, 0.5, N)
        gain = np.array([joint.position_p_gain for joint in LAMP.joints]) / servo["gain_divisor"]
        duty = gain * (goal - angle) * 4096 / (2 * math.pi) / 885
        clipped += np.count_nonzero(np.abs(duty) > 1)
        expected = k * (np.clip(duty, -1, 1) * supply - k * velocity) / r - servo["viscous"] * velocity
        found = torques(angle, velocity, goal)
        # MuJoCo counts the motor's own damping as a passive force; see the next test.
        np.testing.assert_allclose(found - servo["viscous"] * velocity, expected, atol=1e-12)
    assert 50 < clipped < 250


def test_viscous_friction_is_a_passive_force() -> None:
    data = mujoco.MjData(TWIN.model)
    data.qvel[TWIN.dof] = [1.0, -2.0, 3.0]
    mujoco.mj_forward(TWIN.model, data)
    viscous = CALIBRATION.servo(LAMP.joints[0].servo, "ankle")["viscous"]
    np.testing.assert_allclose(data.qfrc_passive[TWIN.dof], -viscous * data.qvel[TWIN.dof], atol=1e-15)


def test_without_torque_a_motor_neither_drives_nor_brakes() -> None:
    moving = np.full(N, 0.3), np.full(N, 10.0), np.full(N, -0.6)
    assert np.abs(torques(*moving, torque=False)).max() == 0.0
    assert np.abs(torques(*moving)).min() > 0.1


def test_motors_changed_while_running_equal_motors_compiled_so() -> None:
    joints = tuple(
        dataclasses.replace(joint, position_p_gain=gain)
        for joint, gain in zip(LAMP.joints, (200, 400, 1600), strict=True)
    )
    compiled = build(dataclasses.replace(LAMP, joints=joints), CALIBRATION, ASSETS, Bend(supply=-0.7))
    body = Body(TWIN)
    body.set_motors(np.array([200.0, 400.0, 1600.0]), np.full(N, TWIN.voltage - 0.7), np.ones(N, bool))
    body.step()
    np.testing.assert_allclose(
        body.model.actuator_gainprm[TWIN.actuator], compiled.model.actuator_gainprm[compiled.actuator], rtol=1e-14
    )


def test_load_dependent_friction_follows_its_formula() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        p = dict(zip(SERVO, rng.uniform(0.02, 0.3, len(SERVO)), strict=True)) | {
            "stribeck_exponent": rng.uniform(0.5, 2)
        }
        tau, load, w = rng.normal(size=3)
        still = np.exp(-((abs(w) / p["stribeck_velocity"]) ** p["stribeck_exponent"]))
        sticking = p["stribeck"] + p["load_external_stribeck"] * abs(load) + p["load_motor_stribeck"] * abs(tau)
        expected = p["coulomb"] + abs(p["load_external"] * load - p["load_motor"] * tau) + still * sticking
        expected *= 1 + p["asymmetry"] * np.sign(w)
        assert friction_loss(np.array(list(p.values())), tau, load, w) == pytest.approx(expected, rel=1e-13)


def test_a_motor_that_carries_gravity_meets_less_friction_than_one_that_fights_it() -> None:
    servo = TWIN.servos.table[0]
    against, along = (friction_loss(servo, torque, 0.2, 1.0) for torque in (-0.2, 0.2))
    assert against > 2 * along > 0


@pytest.mark.parametrize(
    ("delay", "timestep"), [(0.0, 0.002), (0.02, 0.002), (0.038, 0.002), (0.1, 0.002), (0.0, 0.0005)]
)
def test_a_goal_acts_after_the_servos_delay_and_not_before(delay: float, timestep: float) -> None:
    twin = build(LAMP, CALIBRATION, ASSETS, Bend(delay=delay), timestep=timestep)
    body = Body(twin)
    body.step(200)
    before, rest = body.data.time, body.torque.copy()
    body.set_goal(np.full(N, 0.3))
    steps = 0
    while np.abs(body.torque - rest).min() < 0.1:
        body.step()
        steps += 1
        assert steps < 1000
    wanted = min(CALIBRATION.servo(LAMP.joints[0].servo, "ankle")["delay"] + delay, 0.05)
    assert body.data.time - before == pytest.approx(wanted, abs=1.5 * timestep)


def test_a_bend_changes_what_it_says_and_nothing_else() -> None:
    strong = bent(Bend(strength=np.array([1.0, 2.0, 1.0]), friction=1.5, delay=0.004))
    assert (strong.servos.torque_constant / TWIN.servos.torque_constant).tolist() == [1.0, 2.0, 1.0]
    assert strong.servos.delay == pytest.approx(TWIN.servos.delay + 0.004)
    assert strong.servos.coulomb == pytest.approx(1.5 * TWIN.servos.coulomb)
    assert strong.servos.resistance.tolist() == TWIN.servos.resistance.tolist()
    heavy = bent(Bend(mass=1.1, floor_friction=0.5))
    assert heavy.model.body_mass.sum() == pytest.approx(1.1 * TWIN.model.body_mass.sum())
    assert heavy.model.body_inertia == pytest.approx(1.1 * TWIN.model.body_inertia)
    assert heavy.model.geom("floor").friction[0] == pytest.approx(0.5 * TWIN.model.geom("floor").friction[0])
    assert heavy.servos.torque_constant.tolist() == TWIN.servos.torque_constant.tolist()


def test_a_model_that_lacks_a_part_is_refused_by_name(tmp_path) -> None:
    folder = tmp_path / "sim" / "lamp"
    folder.mkdir(parents=True)
    shipped = ASSETS.path("sim/lamp/lamp.xml").read_text()
    (folder / "scene.xml").write_text(ASSETS.path("sim/lamp/scene.xml").read_text())
    own = dataclasses.replace(ASSETS, own=tmp_path)
    for old, new, message in (
        ('<touch name="foot_force"', '<touch name="force"', "no sensor named 'foot_force'"),
        ('<site name="head"', '<site name="bulb"', "no site named 'head'"),
        ('<dcmotor name="knee"', '<dcmotor name="elbow"', "no joint and actuator named 'knee'"),
        ("<keyframe>", "<keyframes>", "not a MuJoCo model"),
    ):
        assert old in shipped
        (folder / "lamp.xml").write_text(shipped.replace(old, new))
        with pytest.raises(FileError, match=message) as caught:
            build(LAMP, CALIBRATION, own)
        assert str(folder / "scene.xml") in str(caught.value)
        assert "\n" not in str(caught.value)
