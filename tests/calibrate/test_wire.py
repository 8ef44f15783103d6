"""A single servo through the wire: recorded by the loop, read, fitted, and what a chirp alone does not tell is said."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robolamp.calibrate.lamp.session import read_session
from robolamp.calibrate.manifest import load_manifest
from robolamp.calibrate.servo.fast_pendulum import Pendulum, parameter_set
from robolamp.calibrate.servo.pendulum_fit import Problem
from robolamp.calibrate.servo.procedure import load_bench
from robolamp.calibrate.servo.recordings import Recording, read_recordings
from robolamp.calibrate.servo.servo_fit import advice, fit_servo
from robolamp.calibrate.servo.soundness import faults
from robolamp.errors import FileError
from robolamp.log.writer import LogWriter
from tests.calibrate.sessions import ASSETS, LAMP
from tests.calibrate.test_fit import run
from tests.calibrate.wire_parts import CALIBRATION, CHART, FREE, MODEL, NOMINAL, known_servo, record_servo
from tests.log.ticks import make_tick

BENCH = """
name = "mine"

[[servo]]
model = "XL330-M288-T"
baud = 1_000_000

[servo.pendulum]
mass = 0.2
length = 0.1
"""
STEPS = ("ramps", "chirp", "steps-firm", "drop-1", "drop-2")


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Recording], dict[str, float], Path]:
    folder = tmp_path_factory.mktemp("known")
    servo, truth = known_servo(5)
    return record_servo(folder, servo, STEPS), truth, folder


def test_recordings_hold_what_came_over_the_wire(known: tuple[list[Recording], dict[str, float], Path]) -> None:
    recordings, truth, folder = known
    assert [each.name for each in recordings] == [f"{name}.mcap" for name in sorted(STEPS)]
    for each in recordings:
        assert faults(each) == []
        assert (each.servo, each.mass, each.length, each.joint) == (MODEL, 0.2, 0.1, "")
        counts = (each.angle + np.pi) / (2 * np.pi / 4096)
        assert counts == pytest.approx(np.round(counts), abs=1e-6)  # what an encoder says
        assert each.voltage == pytest.approx(np.round(each.voltage, 1))
        assert np.isfinite(each.current).all()
        assert np.isfinite(each.temperature).all()
    drop = next(each for each in recordings if each.name == "drop-1.mcap")
    assert drop.torque[drop.time < drop.release].all()
    assert not drop.torque[drop.time > drop.release].any()
    assert np.ptp(drop.angle[~drop.torque]) > 0.5
    # The model with the true parameters and the stamps as they are: nothing is late by a millisecond.
    for each, angles in zip(recordings, Pendulum(recordings).simulate(parameter_set(truth)[None]), strict=True):
        speed, off = np.gradient(each.angle, each.time), angles[0] - each.angle
        fast = np.abs(speed) > 1.0
        assert abs((off[fast] * speed[fast]).sum() / (speed[fast] ** 2).sum()) < 5e-4
    manifest = load_manifest(folder)
    assert manifest
    assert manifest.servo == MODEL
    with pytest.raises(FileError, match="is of a single XL330-M288-T, not of a lamp"):
        read_session(folder, LAMP)


def test_known_parameters_are_found_through_the_wire(
    known: tuple[list[Recording], dict[str, float], Path],
) -> None:
    recordings, truth, _ = known
    problem = Problem(Pendulum(recordings))
    solution = problem.best(CHART, problem.starts(CHART, np.random.default_rng(0), 3))
    sigma = np.sqrt(np.diag(solution.covariance))
    assert (sigma < 0.5).all()  # of the priors': the errors are no excuse
    for name, error in zip(FREE, CHART.slope(solution.z) * sigma, strict=True):
        off = abs(solution.values[name] - truth[name])
        assert off <= max(0.02 * abs(truth[name]), 3 * error), f"{name}: {solution.values[name]:.5g}, {truth[name]:.5g}"


def test_of_a_chirp_alone_the_motors_constants_keep_their_priors(
    known: tuple[list[Recording], dict[str, float], Path],
) -> None:
    chirp = [each for each in known[0] if each.name == "chirp.mcap"]
    alone = fit_servo(chirp, CALIBRATION, starts=1)
    assert "torque_constant and resistance cannot be separated" in advice(alone)[0]
    assert "record a torque-off drop to separate K from R" in advice(alone)[0]
    for name in alone.solution.chart.names:
        if not alone.identified(name) and name not in alone.at_bound:
            assert alone.solution.values[name] == pytest.approx(NOMINAL[name], rel=1e-9, abs=1e-12), name
    for name in ("torque_constant", "resistance", "viscous"):
        assert not alone.identified(name)
    told = [name for name in alone.solution.chart.names if alone.identified(name)]
    assert told  # the others are fitted around them
    assert any(alone.solution.values[name] != pytest.approx(NOMINAL[name], rel=1e-3) for name in told)


def test_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.toml").write_text(BENCH)
    words = ("calibrate", "record", "--servo", tmp_path / "mine.toml", "--emulate", "-o", tmp_path / "rec")
    assert run(*words, "--step", "steps-soft", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert [each["step"] for each in told["recordings"]] == ["steps-soft"]
    assert told["left"][0] == "ramps"
    assert run(*words, "--step", "steps-soft", "--step", "drop-1") == 0
    said = capsys.readouterr().out
    assert "recorded already" in said
    assert run("calibrate", "score", "nominal", tmp_path / "rec", "--json") == 0
    assert json.loads(capsys.readouterr().out)["mae_mrad"] < 1.0
    assert run("calibrate", "report", "nominal", tmp_path / "rec", "-o", tmp_path / "page.html", "--json") == 0
    assert len(json.loads(capsys.readouterr().out)["recordings"]) == 2


@pytest.mark.parametrize(
    ("text", "options", "reason"),
    [
        (BENCH, (), "--port"),
        (BENCH, ("--emulate", "--foot-port", "x"), "--emulate"),
        (BENCH, ("--port", "x", "--foot-port", "x"), "a bench has no foot sensor"),
        (BENCH, ("--port", "x", "--reality", "worn"), "without --emulate"),
        (BENCH, ("--emulate", "--reality", "worn"), "no such joint; expected one of bench"),
        (BENCH, ("--emulate", "--step", "nod"), "'nod' is not a step; expected one of ramps, chirp"),
        (BENCH.split("[servo.pendulum]", maxsplit=1)[0], ("--emulate",), "has no pendulum"),
        (BENCH.replace("mass = 0.2", "mass = 20"), ("--emulate",), "mass"),
        (BENCH + BENCH.split('"mine"')[1].replace("baud", "id = 2\nbaud"), ("--emulate",), "lists 2 servos"),
    ],
)
def test_what_cannot_be_recorded_is_refused(
    text: str, options: tuple[str, ...], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.toml").write_text(text)
    words = ("calibrate", "record", "--servo", tmp_path / "mine.toml", "-o", tmp_path / "rec", *options)
    assert run(*words) == 2
    error = capsys.readouterr().err
    assert reason in error.replace("\n", " ")
    assert not list(tmp_path.glob("rec/*.mcap*"))


def test_a_heavy_arm_is_swung_less(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(BENCH)
    light = load_bench(path, ASSETS)
    path.write_text(BENCH.replace("mass = 0.2", "mass = 0.5"))
    heavy = load_bench(path, ASSETS)
    assert light.load.swing == pytest.approx(np.pi / 2)
    assert 0.5 * 9.81 * 0.1 * np.sin(heavy.load.swing) == pytest.approx(0.26)  # half of 0.52 Nm (e-manual)


def test_the_weight_of_the_arm_goes_all_the_way(tmp_path: Path) -> None:
    servo, truth = known_servo(5)
    assert servo.pendulum
    servo = replace(servo, pendulum=replace(servo.pendulum, mass=0.0, arm_mass=0.3))
    (chirp,) = record_servo(tmp_path, servo, ("chirp",))
    assert (chirp.mass, chirp.arm_mass, faults(chirp)) == (0.0, 0.3, [])
    wrong = replace(chirp, mass=0.15, arm_mass=0.0)  # the same weight for gravity, another inertia
    mae = [np.abs(each - chirp.angle).mean() for each in (
        Pendulum([made]).simulate(parameter_set(truth)[None])[0][0] for made in (chirp, wrong)
    )]  # fmt: skip
    assert mae[0] < 0.002
    assert mae[1] > 3 * mae[0]


@pytest.mark.parametrize(
    ("pendulum", "words"),
    [
        ("mass = 0.0\nlength = 0.1\n", "mass: 0.0 is not a number from 0.01 to 5 kg"),
        ("mass = 0.0\nlength = 0.1\narm_mass = 0.001\n", "mass: 0.0 is not a number from 0.01 to 5 kg"),
        ("mass = 0.2\nlength = 0.1\narm_mass = -1.0\n", "arm_mass: -1.0 is not a number from 0 to 5 kg"),
    ],
)
def test_a_bench_without_weight_is_refused(tmp_path: Path, pendulum: str, words: str) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(BENCH.partition("mass = ")[0] + pendulum)
    with pytest.raises(FileError, match=re.escape(words)):
        load_bench(path, ASSETS)


def test_samples_without_an_answer_are_said(tmp_path: Path) -> None:
    path = tmp_path / "run.MCAP"
    with LogWriter(path, context={"goal_m": "0.3", "control_period": "0.02"}, joints=LAMP.names, now=100.0) as log:
        for index in range(50):
            log.tick(make_tick(index))  # of which each fifth lacks the knee's angle
    said: list[str] = []
    found = {each.joint: each for each in read_recordings([path], said.append)}
    assert (len(found["ankle"].time), len(found["knee"].time)) == (50, 40)
    assert said == ["run.MCAP#knee: 10 of 50 samples left out: the servo did not answer"]
