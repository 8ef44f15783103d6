"""Play, links that bend and a supply that sags in the calibrated twin: the same in a body, a fleet and the emulator."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import JOINT, LAMP, SERVO, Calibration, Parameter, load_calibration
from robolamp.controller.controller_file import load_controller
from robolamp.controller.terminals import on_board_terminals
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.reality.reality import Reality
from robolamp.emulator.servo.drive import Drive
from robolamp.lamp import load_lamp
from robolamp.twin.actuators.gears import TEETH
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.fleet import Fleet, Job
from robolamp.twin.lanes.lamp_body import Body

Array = NDArray[np.float64]

ASSETS = Assets()
DESK = load_lamp(ASSETS)
NOMINAL = load_calibration(ASSETS)


def changed(play: float = 0.0, **lamp: float) -> Calibration:
    """Return nominal with play at every joint, and other values of the lamp."""
    groups = {name: dict(parameters) for name, parameters in NOMINAL.groups.items()}
    for name, value in lamp.items():
        groups["lamp"][name] = Parameter(value, LAMP[name].unit, None, "")
    if play:
        for name in DESK.names:
            groups[f"joint {name}"] = {"backlash": Parameter(play, JOINT["backlash"].unit, None, "")}
    return dataclasses.replace(NOMINAL, groups=groups)


def twin(calibration: Calibration, *, clamped: bool = False) -> TwinModel:
    return build(DESK, calibration, ASSETS, clamped=clamped)


def goals(ticks: int) -> Array:
    time = 0.02 * np.arange(ticks)[:, None]
    return np.array([0.2, 0.4, 0.3]) * np.sin(time * np.array([5.0, 7.0, 9.0]))


def swung(calibration: Calibration, ticks: int = 60) -> Array:
    """Return the angles of a clamped lamp that swings, shape (ticks, 3) [rad]."""
    body = Body(twin(calibration, clamped=True))
    angles = []
    for goal in goals(ticks):
        body.set_goal(goal)
        body.step(round(0.02 / body.model.opt.timestep))
        angles.append(body.angle.copy())
    return np.array(angles)


def test_values_that_are_off_leave_the_model_as_it_was() -> None:
    plain, off = twin(NOMINAL).model, twin(changed(supply_resistance=0.0)).model
    assert plain.nq == off.nq == 10
    assert (twin(NOMINAL).gears.qpos < 0).all()
    np.testing.assert_array_equal(swung(NOMINAL), swung(changed(supply_resistance=0.0)))


def test_no_play_to_speak_of_is_no_play() -> None:
    assert np.abs(swung(changed(play=1e-6)) - swung(NOMINAL)).mean() < 0.004


def test_a_delay_ends_within_a_step_too() -> None:
    """Halfway between two whole steps of delay, play or not, a lamp swings halfway between their angles."""

    def late(steps: float, play: float) -> Array:
        calibration = changed(play)
        for name in DESK.names:
            group = calibration.groups.setdefault(f"joint {name}", {})  # pyright: ignore
            group["delay"] = Parameter(steps * timestep, SERVO["delay"].unit, None, "")
        return swung(calibration)

    timestep = twin(NOMINAL).timestep
    for backlash in (0.0, 0.004):
        early, middle, latest = (late(steps, backlash) for steps in (4.0, 4.5, 5.0))
        apart = np.abs(latest - early).mean()
        assert apart > 1e-3
        assert np.abs(middle - (early + latest) / 2).mean() < 0.05 * apart, backlash


def standing(calibration: Calibration) -> tuple[Array, Array, Array]:
    """Return the loads [Nm], the gears [rad] and what encoders read beyond the joints of a lamp that came to rest."""
    body = Body(twin(calibration, clamped=True))
    body.set_goal(np.array([0.4, 0.4, 0.3]))
    body.step(2000)
    read = body.angle - body.data.qpos[body._twin.qpos]
    return -body.data.qfrc_bias[body._twin.dof], body.data.qpos[body._twin.gears.qpos], read


def test_a_link_rests_at_the_end_of_its_play_and_bends_the_teeth() -> None:
    load, gear, read = standing(changed(play=0.02))
    np.testing.assert_allclose(gear, 0.01 * np.sign(load) + load / TEETH, atol=1e-4)
    np.testing.assert_allclose(read, gear, atol=1e-12)


def test_every_joint_bends_under_its_load_behind_the_encoder() -> None:
    load, gear, read = standing(changed(arm_stiffness=10.0))
    np.testing.assert_allclose(gear, load / 10.0, atol=1e-4)
    np.testing.assert_array_equal(read, 0.0)


def test_an_encoder_reads_play_and_teeth_but_not_what_bends_behind_it() -> None:
    load, gear, read = standing(changed(play=0.02, arm_stiffness=10.0))
    np.testing.assert_allclose(gear, 0.01 * np.sign(load) + load / TEETH + load / 10.0, atol=1e-4)
    np.testing.assert_allclose(read, 0.01 * np.sign(load) + load / TEETH, atol=1e-4)


def test_the_speed_at_the_horn_is_how_the_angle_there_changes() -> None:
    """Through the play and at its ends, with springs on both sides of the encoder."""
    calibration = changed(play=0.02, arm_stiffness=10.0)
    body = Body(build(DESK, calibration, ASSETS, clamped=True, timestep=1e-4))
    body.set_goal(np.array([0.4, 0.4, 0.3]))
    angles, speeds, gears = [], [], []
    for _ in range(4000):
        body.step()
        angles.append(body.angle)
        speeds.append(body.velocity)
        gears.append(body.data.qpos[body._twin.gears.qpos].copy())
    inside = np.abs(gears) < 0.01
    assert 0.02 < inside.mean() < 0.98
    same = inside[1:] == inside[:-1]
    np.testing.assert_allclose((np.diff(angles, axis=0) / 1e-4)[same], np.array(speeds)[1:][same], atol=0.02)


@pytest.mark.parametrize(
    "calibration",
    [changed(0.006), changed(arm_stiffness=30.0), changed(0.004, arm_stiffness=30.0, supply_resistance=0.2)],
    ids=["play", "springs", "all"],
)
def test_a_lane_of_the_fleet_is_its_playback_to_the_bit(calibration: Calibration) -> None:
    lamps = [twin(calibration), build(DESK, calibration, ASSETS, Bend(strength=0.95))]
    hop = load_controller(ASSETS.path("sim/lamp/controllers/hop-counting.toml"), DESK).compile(on_board_terminals(3))
    jobs = [Job(0, lamp, goal) for lamp in (0, 1) for goal in (0.1, 0.3)]
    runs = [Fleet(lamps, 0.02, workers).run([hop], jobs, 1.0, record=True) for workers in (1, 2)]
    traces = [run.trace for run in runs]
    assert traces[0]
    assert traces[1]
    np.testing.assert_array_equal(traces[0].goals, traces[1].goals)
    ticks = int(traces[0].ticks[3])
    seen = Fleet(lamps, 0.02).play(jobs[3], traces[0].goals[3], ticks)
    body = Body(lamps[1])
    body.data.qpos[:] = seen[-1]
    np.testing.assert_array_equal(body.angle, runs[0].angles[3])


def test_the_emulated_lamp_of_a_calibration_with_play_is_that_twin() -> None:
    calibration = changed(0.006, arm_stiffness=30.0)
    lamp = EmulatedLamp(DESK, calibration, ASSETS, Reality.none(DESK), clamped=True)
    bent = EmulatedLamp(
        DESK, NOMINAL, ASSETS, dataclasses.replace(Reality.none(DESK), backlash=0.006, stiffness=30.0), clamped=True
    )
    body = Body(twin(calibration, clamped=True))
    body.data.qpos[:] = lamp.plant._data.qpos  # friction keeps how a lamp began
    for world in (lamp, bent):
        for joint in range(3):
            world.plant.drive(joint, Drive(torque=True, goal=0.2, p_gain=800, duty_limit=1.0))
        for _ in range(250):
            world.plant.step()
    np.testing.assert_array_equal(lamp.plant.angle, bent.plant.angle)
    body.set_goal(np.full(3, 0.2))
    body.step(250)
    np.testing.assert_allclose(lamp.plant.angle, body.angle, atol=2e-3)


def test_all_servos_share_one_supply() -> None:
    ohm, error = 0.2, 0.4
    body = Body(twin(changed(supply_resistance=ohm)))
    body.set_goal(np.full(3, error))
    for _ in range(60):  # the joints held as by hand: motors that stall
        body.data.qvel[:] = 0.0
        body.data.qpos[:] = body.model.key_qpos[0]
        body.step()
    values = NOMINAL.servo(DESK.joints[0].servo, "knee")
    share = min(800 * 4096 / math.tau / (values["gain_divisor"] * 885) * error, 1.0)
    # V = V0 - R 3 duty (duty V / r)
    expected = NOMINAL.lamp("supply_voltage") / (1.0 + 3.0 * ohm * share**2 / values["resistance"])
    assert body.voltage == pytest.approx(expected, rel=1e-4)
    assert body.torque == pytest.approx(values["torque_constant"] * share * expected / values["resistance"], rel=1e-3)
    stiff = Body(twin(NOMINAL))
    assert stiff.voltage == NOMINAL.lamp("supply_voltage")
