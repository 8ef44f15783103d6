"""Every key of a reality, by what it does to the lamp: seen on the wire, or in the physics behind it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from robolamp.emulator.reality.file import Reality
from robolamp.foot.protocol import Decoder
from robolamp.twin.actuators.gears import TEETH

from .test_emulated_lamp import LAMP, RAD_PER_COUNT, Client

NONE = replace(Reality.none(LAMP), stiffness=math.inf, backlash=0.0)
"""The twin, but rigid: one thing differs at a time."""

Array = NDArray[np.float64]


def standing(client: Client, seconds: float = 1.0) -> Client:
    client.start()
    client.wait(seconds)
    return client


def swing(reality: Reality) -> tuple[Array, Array]:
    """True horn angles and velocities of a lamp that swings its neck, shape (steps, 3)."""
    client = standing(Client(reality), 0.5)
    angles, speeds = [], []
    for tick in range(60):
        client.go([0.0, 0.0, 0.3 * math.sin(tick * 0.25)])
        client.wait(0.02)
        angles.append(client.lamp.plant.angle)
        speeds.append(client.lamp.plant.velocity)
    return np.array(angles), np.array(speeds)


def link(client: Client, joint: int) -> float:
    """The angle of a link: its joint's, with play and bending."""
    data, twin = client.lamp.plant._data, client.lamp.plant._twin
    gear = twin.gears.qpos[joint]
    return float(data.qpos[twin.qpos[joint]] + (data.qpos[gear] if gear >= 0 else 0.0))


def rotor(client: Client, joint: int) -> float:
    plant = client.lamp.plant
    return float(plant._data.qpos[plant._twin.qpos[joint]])


def push(client: Client, joint: int, torque: float, wait: float = 0.2) -> float:
    """Take a link's weight off it and push it by a torque [Nm]; where it comes to rest [rad]."""
    plant = client.lamp.plant
    model, data = plant._model, plant._data
    hinge = model.joint(plant._twin.lamp.names[joint]).id
    turn = data.qfrc_bias[plant._twin.dof[joint]] + torque
    data.xfrc_applied[model.jnt_bodyid[hinge], 3:] = turn * data.xaxis[hinge]
    client.wait(wait)
    return link(client, joint)


def test_play_moves_freely_from_end_to_end() -> None:
    stiff, loose = standing(Client(NONE)), standing(Client(replace(NONE, backlash=np.array([0.0, 0.0, 0.02]))))
    across = [push(client, 2, 0.01) - push(client, 2, -0.01) for client in (stiff, loose)]
    assert abs(across[0]) < 5e-3  # the gears' friction is more than the push
    assert across[1] == pytest.approx(0.02, abs=4e-3)


def test_a_motor_that_turns_back_crosses_the_play_before_the_link_moves() -> None:
    def turned_before(goal: float) -> float:
        """How far the rotor turns before the link moves [rad], from where the link rests on the far end."""
        client = standing(Client(replace(NONE, backlash=np.array([0.0, 0.0, 0.03]))))
        push(client, 2, 0.01)
        plant = client.lamp.plant
        gear = int(plant._twin.gears.qpos[2])
        plant._data.qpos[gear] = 0.015 * np.sign(plant._data.qpos[gear])  # let go of it: bent teeth throw it back
        at = push(client, 2, 0.0, wait=0.0)
        start = rotor(client, 2)
        client.go([0.0, 0.0, goal])
        client.wait(0.002)  # the teeth that were pushed are let go
        while plant._data.qfrc_applied[plant._twin.gears.dof[2]] == 0.0:  # until its teeth push
            assert abs(link(client, 2) - at) < 1e-3
            client.wait(0.002)
        into = abs(plant._data.qpos[gear]) - 0.015  # the teeth, by when it is seen
        return abs(rotor(client, 2) - start) - into

    near, far = sorted(turned_before(goal) for goal in (0.25, -0.25))
    assert far == pytest.approx(0.03, abs=6e-3)
    assert near < 6e-3


def test_no_play_to_speak_of_is_no_play() -> None:
    exact, _ = swing(NONE)
    tiny, _ = swing(replace(NONE, backlash=1e-6))
    assert np.abs(exact - tiny).max() < 4e-3


@pytest.mark.parametrize(
    ("key", "value", "joint"),
    [("coulomb", 2.0, 2), ("viscous", 4.0, 2), ("stribeck", 6.0, 2), ("load_friction", 1.6, 1), ("armature", 3.0, 2)],
)
def test_more_of_it_changes_how_a_joint_swings(key: str, value: float, joint: int) -> None:
    plain, _ = swing(NONE)
    bent, _ = swing(replace(NONE, **{key: value}))
    assert np.abs(bent - plain)[:, joint].max() > 4e-3


def test_dry_friction_is_torque_that_a_joint_withstands() -> None:
    def turned(reality: Reality) -> float:
        client = standing(Client(reality))
        client.write(3, 100, 0, 2)  # Goal PWM 0: the motor brakes, friction alone holds
        client.wait(0.1)
        at = link(client, 2)
        return abs(push(client, 2, 0.08) - at)

    assert turned(replace(NONE, coulomb=6.0)) < 0.5 * turned(NONE)


def test_stribeck_velocity_widens_the_dip() -> None:
    narrow, _ = swing(replace(NONE, stribeck=6.0))
    wide, _ = swing(replace(NONE, stribeck=6.0, stribeck_velocity=8.0))
    assert np.abs(wide - narrow)[:, 2].max() > 4e-3


def test_heavier_links_weigh_on_the_foot_and_on_their_joint() -> None:
    plain, heavy = (standing(Client(replace(NONE, link_mass=np.array([1.0, 1.0, m])))) for m in (1.0, 1.5))
    sag = [abs(client.angles()[2]) for client in (plain, heavy)]
    assert sag[1] > 1.2 * sag[0]
    model, bent = plain.lamp.plant._model, heavy.lamp.plant._model
    more = bent.body_mass - model.body_mass
    assert more[model.body("head").id] == pytest.approx(0.5 * model.body_mass[model.body("head").id])
    assert more.sum() == pytest.approx(more[model.body("head").id])


def test_an_encoder_that_is_off_moves_the_joint_not_the_reading() -> None:
    plain, off = standing(Client(NONE)), standing(Client(replace(NONE, encoder_offset=np.array([0.0, 0.0, 0.05]))))
    for client in (plain, off):
        client.go([0.0, 0.0, -0.5])
        client.wait(0.5)
    assert off.angles()[2] == pytest.approx(plain.angles()[2], abs=0.01)
    assert off.lamp.plant.angle[2] == pytest.approx(plain.lamp.plant.angle[2] - 0.05, abs=0.01)


def test_an_encoder_errs_by_a_sine_over_its_turn() -> None:
    client = Client(replace(NONE, encoder_nonlinearity=0.02, encoder_phase=0.7))
    joint = client.lamp.lamp.joints[2]
    client.start()
    for goal in (-0.9, -0.4, 0.0, 0.3):
        client.go([0.0, 0.0, goal])
        client.wait(0.5)
        true = client.lamp.plant.angle[2]
        shaft = joint.zero + joint.sign * true
        error = joint.sign * (client.angles()[2] - true)
        assert error == pytest.approx(0.02 * math.sin(shaft + 0.7), abs=RAD_PER_COUNT)


def test_a_bending_link_sinks_under_its_load_and_no_encoder_tells() -> None:
    rigid, soft = standing(Client(NONE)), standing(Client(replace(NONE, stiffness=10.0)))
    head = [client.lamp.plant._data.site("head").xpos[2] for client in (rigid, soft)]
    assert head[0] - head[1] > 0.001
    plant = soft.lamp.plant
    assert np.abs(plant._data.qpos[plant._twin.gears.qpos]).max() > 0.004
    assert soft.angles() == pytest.approx(plant.angle.tolist(), abs=RAD_PER_COUNT)


def test_play_and_bending_at_one_joint() -> None:
    client = standing(Client(replace(NONE, stiffness=20.0, backlash=0.02)))
    plant = client.lamp.plant
    knee = 1
    gear, read = plant._data.qpos[plant._twin.gears.qpos[knee]], plant.angle[knee] - rotor(client, knee)
    # Its load pushes it to the end of its play, and bends what follows: the teeth, and what the encoder does not see.
    bent = abs(gear) - 0.01
    assert bent > 3e-3
    assert abs(read) == pytest.approx(0.01 + bent * 20.0 / (20.0 + TEETH))
    assert gear * read > 0.0
    assert client.angles() == pytest.approx(plant.angle.tolist(), abs=RAD_PER_COUNT)


def test_a_tilted_floor_makes_it_lean_on_its_joints() -> None:
    level, uphill = (standing(Client(replace(NONE, floor_tilt=tilt))) for tilt in (0.0, 0.15))
    assert uphill.lamp.plant.angle[0] - level.lamp.plant.angle[0] < -0.005  # pulled backwards, downhill
    assert uphill.lamp.plant.truth().fallen is False


def test_a_soft_floor_gives() -> None:
    hard, soft = (standing(Client(replace(NONE, floor_softness=factor))) for factor in (1.0, 5.0))
    assert soft.lamp.plant.truth().base_z < hard.lamp.plant.truth().base_z - 2e-4


def test_a_slow_servo_moves_late() -> None:
    def started(reality: Reality) -> int:
        client = standing(Client(reality), 0.5)
        client.go([0.0, 0.0, 0.3])
        at = client.lamp.plant.angle[2]
        steps = 0
        while abs(client.lamp.plant.angle[2] - at) < 0.01:
            client.wait(0.002)
            steps += 1
        return steps

    assert started(replace(NONE, delay=0.01)) - started(NONE) == 5


def test_a_foot_reads_old_forces() -> None:
    def forces(dead: float) -> Array:
        client = standing(Client(replace(NONE, foot_dead_time=dead)), 0.5)
        client.lamp.frames(client.time)
        client.go([0.2, 0.3, 0.3])
        client.wait(0.3)
        return np.array([frame.force for frame in Decoder().feed(client.lamp.frames(client.time))])

    now, late = forces(0.0), forces(0.02)
    np.testing.assert_allclose(late[10:], now[:-10], atol=1e-9)
    assert np.ptp(now) > 0.05


def test_a_hot_room_is_read_and_weakens_copper() -> None:
    cool, hot = (standing(Client(replace(NONE, temperature=air, resistance_per_kelvin=0.0039))) for air in (30.0, 60.0))
    assert hot.value(1, 146, 1) - cool.value(1, 146, 1) in (30, 31)
    sag = [abs(client.angles()[1]) for client in (cool, hot)]
    assert sag[1] > 1.05 * sag[0]


def test_a_low_supply_is_read_and_weakens() -> None:
    low, full = standing(Client(replace(NONE, supply=-1.0))), standing(Client(NONE))
    assert full.value(1, 144, 2) - low.value(1, 144, 2) == 10
    assert abs(low.angles()[1]) > 1.1 * abs(full.angles()[1])
