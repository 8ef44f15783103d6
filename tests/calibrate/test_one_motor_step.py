"""The same servo, told and fed the same, gives the same torque, friction and duty wherever it is simulated."""

from __future__ import annotations

import copy
import dataclasses
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from robolamp.assets import Assets
from robolamp.calibrate.servo.fast_pendulum import Pendulum as WrittenOut
from robolamp.calibrate.servo.fast_pendulum import parameter_set
from robolamp.calibrate.servo.mujoco_bench import Bench
from robolamp.calibrate.servo.recordings import Recording
from robolamp.calibration import SERVO, Parameter, load_calibration
from robolamp.emulator.plant.pendulum import Pendulum
from robolamp.emulator.plant.plant import Plant
from robolamp.emulator.servo.drive import Drive
from robolamp.lamp import load_lamp
from robolamp.twin.actuators.motors import Motors, Views
from robolamp.twin.actuators.servo import ServoParameters
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.pendulum_model import Load, build_pendulum
from tests.calibrate.bench_parts import MODEL, NOMINAL

VALUES = {
    **NOMINAL, "delay": 0.0085, "stribeck_exponent": 0.7, "load_motor_stribeck": 0.05, "asymmetry": -0.08,
    "saturation": 0.3, "supply_resistance": 0.2, "resistance_temperature": 0.008, "viscous_temperature": -0.05,
}  # fmt: skip
LOAD, GAIN, VOLTS, WARM = Load(0.49, 0.1), 400, 7.3, 41.0
DT, COUNT, OFF = 0.001, 900, 700
SHARE = 0.4  # of a step for which the motor is still driven when torque goes off
GOALS = np.choose(np.arange(COUNT) // 230, [0.9, -0.5, 1.4, 0.2])


def of_lane() -> dict[str, np.ndarray]:
    """A lane of the twin's: what each step gives."""
    twin = build_pendulum(ServoParameters.single(VALUES), LOAD, DT)
    batch = Batch(twin.model, 1, 1)
    views = Views.of_batch(batch, [twin], gains=True)
    motors = Motors([twin], views)
    motors.full[:], motors.temperature[:], motors.p_gain[:] = VOLTS, WARM, GAIN
    motors.forget(GOALS[0])
    batch.forward()
    rows = []
    for step, goal in enumerate(GOALS):
        motors.goal[:], motors.driven[:] = goal, 1.0 if step < OFF else SHARE if step == OFF else 0.0
        motors.before_step()
        batch.step(np.zeros(1, np.int64), 1)
        rows.append([motors.torque[0, 0], views.loss[0, 0], motors.duty[0, 0], motors.current[0, 0], views.qpos[0, 0]])
    return dict(zip(("torque", "friction", "duty", "current", "angle"), np.array(rows).T, strict=True))


def of_emulated_pendulum() -> dict[str, np.ndarray]:
    """The same of the emulated pendulum."""
    pendulum = Pendulum({**VALUES, "encoder_offset": 0.0}, LOAD, DT, zero=0.0)
    drives = {goal: Drive(True, goal, GAIN, 1.0) for goal in GOALS}
    off, rows = Drive(False, 0.0, GAIN, 1.0), []
    for step, goal in enumerate(GOALS):
        late = SHARE if step == OFF else 0.0
        pendulum.step(drives[goal] if step < OFF else off, VOLTS, WARM, late)
        seen, model, data = pendulum.sensed(pendulum.time, VOLTS, WARM), pendulum._model, pendulum._data
        rows.append([data.actuator_force[0], model.dof_frictionloss[0], seen.duty, seen.current, seen.angle])
    return dict(zip(("torque", "friction", "duty", "current", "angle"), np.array(rows).T, strict=True))


def recorded() -> Recording:
    """What the servo is told and fed, as a recording of a sample a step."""
    time, nothing = np.asarray(np.arange(COUNT + 1) * DT, np.float64), np.full(COUNT + 1, math.nan)
    return Recording(
        name="", path=Path("made.csv"), sha256="", source="csv", servo=MODEL, joint="", time=time, goal_time=time,
        goal=np.append(GOALS, GOALS[-1]), angle=np.zeros(COUNT + 1), velocity=np.zeros(COUNT + 1), current=nothing,
        pwm=nothing, voltage=np.full(COUNT + 1, VOLTS), temperature=np.full(COUNT + 1, WARM),
        torque=np.ones(COUNT + 1, bool), p_gain=np.full(COUNT + 1, float(GAIN)), mass=LOAD.mass, length=LOAD.length,
        trajectory="", release=(OFF + SHARE) * DT,
    )  # fmt: skip


def test_a_pendulums_servo_is_one_in_twin_emulator_bench_and_fit() -> None:
    lane, emulated = of_lane(), of_emulated_pendulum()
    assert np.abs(lane["duty"]).max() == 1.0
    assert np.abs(lane["torque"][OFF + 1 :]).max() < 1e-20 < np.abs(lane["torque"][OFF])
    for name, values in lane.items():
        np.testing.assert_allclose(emulated[name], values, rtol=0, atol=1e-12, err_msg=name)
    sets = parameter_set({**VALUES, "encoder_offset": 0.0})[None]
    for simulator in (Bench([recorded()], workers=1), WrittenOut([recorded()], workers=1)):
        angle = simulator.simulate(sets)[0][0]
        np.testing.assert_allclose(angle[1:], lane["angle"], rtol=0, atol=1e-8)


@pytest.mark.parametrize("play", [0.0, 0.006], ids=["rigid", "play"])
def test_a_lamps_servos_are_one_in_body_lane_and_plant(play: float) -> None:
    assets = Assets()
    lamp, nominal = load_lamp(assets), load_calibration(assets)
    servo = {name: Parameter(VALUES[name], "", None, "") for name in SERVO}
    joints = {f"joint {name}": {"backlash": Parameter(play, "", None, "")} for name in lamp.names}
    calibration = dataclasses.replace(nominal, groups={**nominal.groups, MODEL: servo, **joints})
    twin = build(lamp, calibration, assets, clamped=True)
    plant = Plant(dataclasses.replace(twin, model=copy.copy(twin.model)))
    batch = Batch(twin.model, 2, 1)
    views = Views.of_batch(batch, [twin, twin], gains=True)
    lanes, body = Motors([twin, twin], views), Body(twin)
    state = mujoco.mjtState.mjSTATE_INTEGRATION
    start = np.empty(mujoco.mj_stateSize(twin.model, state))
    plant._data.qfrc_applied[:] = 0.0
    mujoco.mj_getState(plant._model, plant._data, start, state)
    batch.state[:] = start
    mujoco.mj_setState(body.model, body.data, start, state)
    for gains in (body.model.actuator_gainprm, views.gains):
        gains[..., [4, 6]] = 0.0  # the windings are open, as the plant's are
    batch.forward()
    mujoco.mj_forward(plant._model, plant._data)
    mujoco.mj_forward(body.model, body.data)
    goals = np.array([[0.0, 0.0, 0.0], [0.4, -0.3, 0.5], [-0.2, 0.3, 0.1]])
    every, one = np.arange(2), np.ones(3, bool)
    moved = []
    for step in range(300):
        goal = goals[step // 100]
        if step % 100 == 0:
            for joint in range(3):
                plant.drive(joint, Drive(True, float(goal[joint]), 600, 0.9))
            body.set_motors(np.full(3, 600.0), np.full(3, twin.voltage), one, 0.9)
            body.set_goal(goal)
            lanes.p_gain[:], lanes.limit[:], lanes.goal[:] = 600, 0.9, goal
        lanes.before_step()
        batch.step(every, 1)
        body.step()
        plant.step()
        moved.append(plant.angle)
        found = [
            (plant.torque, plant.duty, plant.current, plant._model.dof_frictionloss),
            (body.torque, body._motors.duty[0], body.current, body.model.dof_frictionloss),
            *((lanes.torque[k], lanes.duty[k], lanes.current[k], views.loss[k]) for k in every),
        ]
        for name, *values in zip(("torque", "duty", "current", "friction"), *found, strict=True):
            for other in values[1:]:
                np.testing.assert_allclose(other, values[0], rtol=0, atol=1e-12, err_msg=f"{name} in step {step}")
    assert np.ptp(moved, axis=0).min() > 0.2
