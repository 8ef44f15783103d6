from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.controller.terminals import figure_terminals
from robolamp.errors import FileError, RobolampError
from robolamp.figure import Figure, figures, load_figure
from robolamp.twin.engine import STATE
from robolamp.twin.figure_model import FigureTwin, World, build_figure
from robolamp.twin.judges.figure_judge import FigureJudge, FigureOutcome
from robolamp.twin.lanes.fleet import Fleet, Job

from .figures import ASSETS, JUMPER, SPIDER, program, sensed, twin

PERIOD = 0.01


def started(figure: FigureTwin, weightless: bool = False) -> mujoco.MjData:
    data = mujoco.MjData(figure.model)
    mujoco.mj_setState(figure.model, data, figure.state, STATE)
    if weightless:
        figure.model.opt.gravity[:] = 0.0
        data.qpos[figure.root + 2] += 5.0
    return data


@pytest.mark.parametrize("figure", [JUMPER, SPIDER], ids=["jumper", "spider"])
def test_every_joint_reaches_its_speed_and_stops_at_its_limit(figure: Figure) -> None:
    compiled = twin(figure)
    for index, joint in enumerate(figure.joints):
        data = started(compiled, weightless=True)
        speed = min(joint.speed, 2.0)
        data.ctrl[compiled.actuator[index]] = speed
        for _ in range(10):
            mujoco.mj_step(compiled.model, data)
        assert data.qvel[compiled.dof[index]] == pytest.approx(speed, rel=0.02), joint.name
        assert data.qpos[compiled.qpos[index]] > 0.1
        for _ in range(round(joint.upper / speed / PERIOD) + 50):
            mujoco.mj_step(compiled.model, data)
        assert data.qpos[compiled.qpos[index]] == pytest.approx(joint.upper, abs=0.05), joint.name
        assert not data.warning.number.any()


@pytest.mark.parametrize("strength", [1.0, 0.25])
def test_motor_turns_a_known_inertia_as_fast_as_its_strength_allows(strength: float) -> None:
    """A weightless Jumper turns its bearing, stiff otherwise: w = min(speed, torque t / inertia)."""
    torque, wanted = 0.08 * strength, 3.0
    bearing = replace(JUMPER.joints[0], strength=torque)
    compiled = twin(replace(JUMPER, joints=(bearing, *JUMPER.joints[1:])))
    model, data = compiled.model, started(compiled, weightless=True)
    bearing = compiled.dof[0]
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    free = [*range(6), bearing]  # base and bearing; the other joints are held
    inertia = 1.0 / np.linalg.inv(mass[np.ix_(free, free)])[6, 6]
    data.ctrl[compiled.actuator[0]] = wanted
    velocity = []
    for _ in range(60):
        mujoco.mj_step(model, data)
        velocity.append(data.qvel[bearing])
    expected = np.minimum(wanted, torque / inertia * PERIOD * np.arange(1, 61))
    assert expected[0] < wanted / 2
    np.testing.assert_allclose(velocity, expected, atol=0.05 * wanted)


def test_motors_hold_a_figure_that_asks_for_nothing() -> None:
    for figure in (JUMPER, SPIDER):
        compiled = twin(figure)
        data = started(compiled)
        for _ in range(500):
            mujoco.mj_step(compiled.model, data)
        assert np.abs(data.qpos[compiled.qpos]).max() < 0.02, figure.name


def test_position_drive_goes_to_its_goals_and_stays_there() -> None:
    goals = ("0.8", "-0.2", "0.3", "-0.5")
    outcome = Fleet([twin(drive="position")], PERIOD, 1).run([program(JUMPER, *goals)], [Job(0, 0, 1.0)], 1.5)
    np.testing.assert_allclose(outcome.angles[0], [float(goal) for goal in goals], atol=0.02)
    assert np.abs(outcome.velocities).max() < 0.05


def test_light_madzia_jumps_and_heavy_madzia_cannot() -> None:
    crouch_and_push = ["0", "(ifltz (- t 0.4) 1.2 (ifltz (- t 0.6) -10 0))", "(ifltz (- t 0.4) -0.5 0)"] * 4
    jumps = [
        Fleet([twin(SPIDER, world=world)], PERIOD, 1)
        .run([program(SPIDER, *crouch_and_push)], [Job(0, 0, 0.5)], 1.5, record=True)
        .trace
        for world in (World(), World(mass=0.35))
    ]
    height = figure_terminals(SPIDER).index("Otrunk.pz")
    heavy, light = (run.inputs[0, :, height].max() - run.inputs[0, 0, height] for run in jumps if run is not None)
    assert heavy < 0.01
    assert light > 0.05


def test_box_stands_at_the_goal_and_weighs_what_the_task_says() -> None:
    compiled = twin(SPIDER, world=World(goal_mass=20.0))
    assert compiled.model.body("box").mass[0] == 20.0
    outcome = Fleet([compiled], PERIOD, 1).run([program(SPIDER)], [Job(0, 0, 0.6, direction=-1.0)], 0.2)
    assert outcome.goal[0] == pytest.approx(0.6, abs=1e-3)
    assert outcome.direction[0] == pytest.approx(-1.0, abs=1e-3)
    assert outcome.error[0] == pytest.approx(0.6, abs=2e-3)
    assert not outcome.fallen[0]


def test_terminals_are_told_in_the_directions_of_the_bearing() -> None:
    compiled = twin()
    fleet = Fleet([compiled], PERIOD, 1)
    names = figure_terminals(JUMPER)
    turn = program(JUMPER, "(* 20 (- 1 k0))")  # turns the bearing to the left by 1 rad, and keeps it there
    trace = fleet.run([turn], [Job(0, 0, 1.0, direction=1.0)], 2.0, record=True).trace
    assert trace is not None
    first, last = (dict(zip(names, trace.inputs[0, tick], strict=True)) for tick in (0, -1))
    assert (first["goal_ahead"], first["goal_left"]) == pytest.approx((math.cos(1), math.sin(1)), abs=0.01)
    assert (first["Ogoal.px"], first["Ogoal.py"]) == pytest.approx((math.cos(1), math.sin(1)))
    assert last["t"] == pytest.approx(1.99)
    assert last["k0"] == pytest.approx(1.0, abs=0.05)
    assert last["goal_ahead"] == pytest.approx(last["goal_dist"], abs=0.01)
    assert last["Ohead.pz"] > last["Obase.pz"] > 0.0


def test_lanes_are_the_same_on_any_number_of_threads_and_in_playback() -> None:
    compiled = twin()
    programs = [
        program(JUMPER, f"{turn}", "(ifltz (- k1 0.3) 6 (- 0 t))", f"(* {turn} (- t Obase.px))", "goal_left")
        for turn in (1.0, -2.0, 4.0)
    ]
    jobs = [Job(index % 3, 0, 1.0, direction=0.1 * index) for index in range(7)]
    alone, shared = (Fleet([compiled], PERIOD, workers).run(programs, jobs, 1.0, record=True) for workers in (1, 3))
    for name in ("error", "angles", "idle", "hops", "tilt", "interventions"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(shared, name), err_msg=name)
    assert alone.trace is not None
    assert shared.trace is not None
    np.testing.assert_array_equal(alone.trace.inputs, shared.trace.inputs)
    qpos = Fleet([compiled], PERIOD).play(jobs[4], alone.trace.goals[4], 100)
    np.testing.assert_array_equal(qpos[-1, compiled.qpos], alone.angles[4])


def test_outputs_that_are_no_numbers_or_too_fast_are_kept_from_the_motors() -> None:
    fleet = Fleet([twin()], PERIOD, 1)
    outcome = fleet.run([program(JUMPER, "(* 1e300 1e300)", "1000")], [Job(0, 0, 1.0)], 0.1, record=True)
    assert outcome.trace is not None
    assert outcome.trace.goals[0, :, 0].tolist() == [0.0] * 10
    assert set(outcome.trace.goals[0, :, 1]) == {JUMPER.joints[1].speed}
    assert outcome.interventions[0] == 20


# The verdict, from states made up


def judged(compiled: FigureTwin, *, error: float = 0.0, tilt: float = 0.0, **sensors: float) -> FigureOutcome:
    """Two lanes whose root is `error` from the point (1, 0), leaning by `tilt`, for one second."""
    root = [1.0 - error, 0.0, 0.02]
    verdict = FigureJudge(compiled, np.array([[1.0, 0.0]] * 2), 1.0)
    verdict.begin(sensed(compiled))
    qpos = np.zeros((2, compiled.model.nq))
    qpos[:, compiled.root + 3], qpos[:, compiled.root + 4] = math.cos(tilt / 2), math.sin(tilt / 2)
    qvel = np.zeros((2, compiled.model.nv))
    data = sensed(compiled, Obase=root, **sensors)
    for _ in range(100):
        verdict.step(np.arange(2), data, qvel)
    return verdict.outcome(data, qpos, qvel, np.zeros(2, bool), np.zeros(2, np.int64))


def test_success_is_near_the_goal_upright_with_no_collision() -> None:
    compiled = twin()
    assert judged(compiled, error=0.049).hit.all()
    assert not judged(compiled, error=0.051).hit.any()
    assert judged(compiled, tilt=0.25).hit.all()
    assert not judged(compiled, tilt=0.27).hit.any()
    assert not judged(compiled, unsafe=1.0).hit.any()
    assert judged(compiled, unsafe=1.0).collision == pytest.approx([PERIOD, PERIOD])


def test_idleness_counts_only_away_from_the_goal() -> None:
    compiled = twin()
    assert judged(compiled, error=0.5).idle == pytest.approx([1.0, 1.0])
    assert judged(compiled, error=0.01).idle == pytest.approx([0.0, 0.0])


def test_jumps_and_what_became_of_the_box_are_measured() -> None:
    """A box pulled 0.2 m towards where Madzia stood, and two flights, of which 30 ms is none."""
    compiled = twin(SPIDER)
    verdict = FigureJudge(compiled, np.array([[0.5, 0.0]] * 2), 1.0)
    qpos, qvel = np.zeros((2, compiled.model.nq)), np.zeros((2, compiled.model.nv))
    qpos[:, compiled.root + 3] = 1.0

    def stood(trunk: float, box: float, support: float, steps: int) -> np.ndarray:
        data = sensed(compiled, Otrunk=[trunk, 0.0, 0.2], Obox=[box, 0.0, 0.05], support=support)
        for _ in range(steps):
            verdict.step(np.arange(2), data, qvel)
        return data

    verdict.begin(sensed(compiled, Otrunk=[0.0, 0.0, 0.2], Obox=[0.5, 0.0, 0.05]))
    stood(0.1, 0.5, 1.0, 20)
    stood(0.15, 0.5, 0.0, 3)
    stood(0.2, 0.3, 1.0, 20)
    stood(0.22, 0.3, 0.0, 5)
    data = stood(0.25, 0.3, 1.0, 10)
    outcome = verdict.outcome(data, qpos, qvel, np.zeros(2, bool), np.zeros(2, np.int64))
    assert outcome.hops.tolist() == [1, 1]
    assert outcome.aloft == pytest.approx([0.05, 0.05])
    assert outcome.flight_gain == pytest.approx([0.05, 0.05])  # from 0.1 m off to 0.05
    assert outcome.goal_moved == pytest.approx([0.2, 0.2])
    assert outcome.goal_pulled == pytest.approx([0.2, 0.2])


def test_light_box_slides_under_a_push_that_would_not_tip_it_and_the_heavy_one_stays() -> None:
    for mass, slides in ((0.05, True), (20.0, False)):
        compiled = twin(SPIDER, world=World(goal_mass=mass))
        data = started(compiled)
        data.qpos[compiled.goal : compiled.goal + 2] = [1.0, 1.0]  # type: ignore[operator]
        start = data.qpos[compiled.goal]
        box = compiled.model.body("box").id
        for _ in range(50):
            data.xfrc_applied[box, 0] = 0.22  # N at its centre: friction of 0.45 would hold 50 g
            mujoco.mj_step(compiled.model, data)
        assert (data.qpos[compiled.goal] - start > 0.05) == slides
        assert abs(data.xmat[box][8]) > 0.999


def test_diverged_lane_has_reached_nothing() -> None:
    compiled = twin()
    verdict = FigureJudge(compiled, np.ones((2, 2)), 1.0)
    data, qpos, qvel = sensed(compiled), np.zeros((2, compiled.model.nq)), np.zeros((2, compiled.model.nv))
    verdict.begin(data)
    verdict.step(np.arange(2), data, qvel)
    outcome = verdict.outcome(data, qpos, qvel, np.array([True, False]), np.zeros(2, np.int64))
    assert np.isnan(outcome.error).tolist() == [True, False]
    assert outcome.fallen.tolist() == [True, False]


def posed(compiled: FigureTwin, quat: list[float], height: float) -> np.ndarray:
    data = mujoco.MjData(compiled.model)
    mujoco.mj_resetDataKeyframe(compiled.model, data, 0)
    data.qpos[compiled.root + 2 : compiled.root + 7] = [height, *quat]
    mujoco.mj_forward(compiled.model, data)
    return data.sensordata


def test_head_on_the_floor_is_a_collision_and_standing_is_none() -> None:
    compiled = twin()
    assert posed(compiled, [1, 0, 0, 0], 0.0)[compiled.unsafe] == 0
    assert posed(compiled, [1, 0, 0, 0], 0.0)[compiled.support] > 0
    assert posed(compiled, [0, 1, 0, 0], 0.55)[compiled.unsafe] > 0  # head down
    assert posed(compiled, [1, 0, 0, 0], 1.0)[compiled.support] == 0


def test_trunk_on_the_floor_is_a_collision_and_on_the_box_is_none() -> None:
    compiled = twin(SPIDER)
    assert posed(compiled, [1, 0, 0, 0], 0.205)[compiled.unsafe] == 0
    assert posed(compiled, [1, 0, 0, 0], 0.029)[compiled.unsafe] > 0
    data = mujoco.MjData(compiled.model)
    mujoco.mj_resetDataKeyframe(compiled.model, data, 0)
    data.qpos[compiled.goal : compiled.goal + 3] = [0.0, 0.0, 0.13]  # type: ignore[operator]
    mujoco.mj_forward(compiled.model, data)
    touching = {frozenset((pair[0], pair[1])) for pair in data.contact.geom}
    assert frozenset((compiled.model.geom("trunk").id, compiled.model.geom("box").id)) in touching
    assert data.sensordata[compiled.unsafe] == 0


# Descriptions


def own(folder: Path, name: str, old: str, new: str, file: str = "figure.toml") -> Assets:
    """A folder of one's own with a figure that differs in one place."""
    copy = folder / "sim" / name
    shutil.copytree(JUMPER.path.parents[1] / name, copy)
    text = (copy / file).read_text()
    assert old in text
    (copy / file).write_text(text.replace(old, new, 1))
    return Assets(folder)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("upper = 3.15", "upper = 9.9", "upper: 9.9 is not a number from 0 to 3.15"),
        ("speed = 6.0", "speed = 0", "speed: 0 is not a number from 0.01 to 100 rad/s"),
        ('name = "lower_leg"', 'name = "bearing"', "two joints have the same name"),
        ('drive = "velocity"', 'drive = "force"', "drive: 'force' is not one of position, velocity"),
        ('["base", "head"]', '["base", "he.ad"]', "is not a list of different bodies' names"),
        ("schema = 1", "schema = 1\ncolour = 3", "colour: unknown"),
        ('name = "jumper"', 'name = "hopper"', "name: 'hopper' is not one of jumper"),
    ],
)
def test_malformed_description_is_refused_by_name(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(FileError, match=message) as caught:
        load_figure(own(tmp_path, "jumper", old, new), "jumper")
    assert "figure.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "file", "message"),
    [
        ('name = "head"', 'name = "tail"', "figure.toml", "no joint named 'tail'"),
        ('root = "base"', 'root = "lamp"', "figure.toml", "no body named 'lamp'"),
        ('root = "base"', 'root = "head"', "figure.toml", "body 'head' has no free joint"),
        ('goal = "point"', 'goal = "box"', "figure.toml", "no body named 'box'"),
        ('<contact name="unsafe"', '<contact name="hit"', "jumper.xml", "no contact sensor named 'unsafe'"),
        ("<worldbody>", "<worldboddy>", "jumper.xml", "not a MuJoCo model"),
    ],
)
def test_model_that_lacks_what_its_description_names_is_refused(
    tmp_path: Path, old: str, new: str, file: str, message: str
) -> None:
    assets = own(tmp_path, "jumper", old, new, file)
    with pytest.raises(FileError, match=message) as caught:
        build_figure(load_figure(assets, "jumper"), assets)
    assert "\n" not in str(caught.value)


def test_unknown_figure_is_refused_with_the_known_ones() -> None:
    assert {"jumper", "spider"} <= set(figures(ASSETS))
    with pytest.raises(FileError, match=r"figure 'dog': no such figure; expected one of lamp, jumper"):
        load_figure(ASSETS, "dog")


def test_period_must_be_a_whole_number_of_steps() -> None:
    with pytest.raises(RobolampError, match=r"0.015 s is not a whole number of physics steps of 0.01 s"):
        Fleet([twin()], 0.015)


def test_shipped_models_are_their_descriptions() -> None:
    for figure in (JUMPER, SPIDER):
        shipped = mujoco.MjModel.from_xml_path(str(ASSETS.path(figure.model)))
        compiled = twin(replace(figure)).model
        np.testing.assert_allclose(shipped.tendon_frictionloss, compiled.tendon_frictionloss)
        np.testing.assert_allclose(shipped.actuator_ctrlrange, compiled.actuator_ctrlrange)
        np.testing.assert_allclose(shipped.actuator_gainprm, compiled.actuator_gainprm)
        np.testing.assert_allclose(shipped.jnt_range, compiled.jnt_range)
