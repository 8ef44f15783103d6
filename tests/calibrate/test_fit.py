"""A servo of known parameters is found again, and what its recordings do not tell is said."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibrate.servo.fast_pendulum import Pendulum
from robolamp.calibrate.servo.ladder import Chart, switched_off
from robolamp.calibrate.servo.pendulum_fit import Problem
from robolamp.calibrate.servo.servo_fit import advice, fit_servo
from robolamp.calibration import load_calibration
from robolamp.cli.main import main
from tests.calibrate.bench_parts import NOMINAL, TRUTH, chirp, drop, record, steps, write_bam, write_csv

FREE = (
    "torque_constant", "resistance", "armature", "viscous", "coulomb", "delay", "encoder_offset", "load_motor",
    "load_external",
)  # fmt: skip
_BESIDE = Path(__file__).resolve().parents[3] / "shared" / "recordings"
REAL = Path(os.environ.get("ROBOLAMP_RECORDINGS", str(_BESIDE))) / "xl330-m288"


def test_known_parameters_are_found_again() -> None:
    recordings = [
        record(steps, p_gain=800.0, seconds=3.0), record(chirp, seconds=3.0, seed=1),
        record(drop, off_at=1.0, seconds=3.0, seed=2), record(steps, p_gain=200.0, off_at=2.0, seconds=3.5, seed=3),
    ]  # fmt: skip
    chart = Chart(FREE, NOMINAL, switched_off(NOMINAL))
    solution = Problem(Pendulum(recordings)).best(chart, [np.zeros(len(FREE)), np.full(len(FREE), 0.3)])
    errors = chart.slope(solution.z) * np.sqrt(np.diag(solution.covariance))
    for name, error in zip(FREE, errors, strict=True):
        found, true = solution.values[name], TRUTH[name]
        said = f"{name}: {found:.5g}, truly {true:.5g} ± {error:.2g}"
        assert abs(found - true) < max(0.02 * abs(true), 3 * error), said
        assert abs(found - true) < 0.15 * abs(true) + 2e-4, said  # and the errors are no excuse


def test_a_chirp_alone_cannot_separate_torque_constant_and_resistance() -> None:
    base = load_calibration(Assets())
    alone = fit_servo([record(chirp, seconds=3.0)], base, starts=1)
    assert not alone.identified("torque_constant")
    assert not alone.identified("resistance")
    assert "torque_constant and resistance cannot be separated" in advice(alone)[0]
    assert "torque-off drop" in advice(alone)[0]
    assert any("too few recordings" in line for line in advice(alone))
    assert not any("drop" in line for line in advice(alone)[1:])


def test_a_drop_tells_the_motors_constants() -> None:
    chart = Chart(FREE, NOMINAL, switched_off(NOMINAL))
    made = [
        record(chirp, seconds=3.0),
        *(record(drop, off_at=0.6, seconds=2.5, p_gain=gain) for gain in (400.0, 800.0)),
    ]
    start = np.zeros(len(FREE))
    alone, dropped = (Problem(Pendulum(each)).fit(chart, start) for each in (made[:1], made))
    assert dropped.covariance[0, 0] < 0.5 * alone.covariance[0, 0]
    assert dropped.values["torque_constant"] == pytest.approx(TRUTH["torque_constant"], rel=0.03)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    write_csv(folder, record(steps, p_gain=800.0, seconds=1.8), "a-steps.csv")
    write_csv(folder, record(drop, off_at=0.8, seconds=1.6, seed=1), "b-drop.csv")
    write_csv(folder, record(chirp, seconds=1.8, seed=2), "c-chirp.csv")
    return folder


def run(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    return int(ended.value.code or 0)


def test_fit_and_score_from_the_command_line(bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.toml"
    words = ("calibrate", "fit", bench, "-o", file, "--leave-out", "c-chirp.csv", "--starts", "1", "--by", "A. Person")
    assert run(*words, "--json") == 0
    captured = capsys.readouterr()
    told = json.loads(captured.out)
    assert "Coulomb and viscous friction" in captured.err  # progress
    assert told["left_out_mae_mrad"] < 15
    assert {"value", "stderr", "unit", "identified"} == set(told["parameters"]["armature"])
    calibration = load_calibration(Assets(), file)
    assert calibration.provenance["by"] == "A. Person"
    assert len(calibration.provenance["recordings"]) == 2
    names = calibration.provenance["covariance"]["parameters"]
    matrix = np.array(calibration.provenance["covariance"]["matrix"])
    assert matrix.shape == (len(names), len(names))
    assert (np.linalg.eigvalsh(matrix) > 0).all()
    armature = calibration.groups["XL330-M288-T"]["armature"]
    assert armature.identified
    assert armature.stderr == pytest.approx(np.sqrt(matrix[names.index("armature"), names.index("armature")]), rel=1e-4)

    assert run("calibrate", "score", file, bench, "--json") == 0
    scored = json.loads(capsys.readouterr().out)
    assert [row["seen"] for row in scored["recordings"]] == [True, True, False]
    unseen = scored["recordings"][2]["mae_mrad"]
    assert unseen == pytest.approx(told["left_out_mae_mrad"], abs=0.01)  # MuJoCo says what the fit said
    assert scored["mae_unseen_mrad"] == unseen
    assert scored["mae_mrad"] == pytest.approx(np.mean([row["mae_mrad"] for row in scored["recordings"]]))
    assert run("calibrate", "score", "nominal", bench) == 0
    assert "mean of 3 recordings" in capsys.readouterr().out


def test_with_too_few_recordings_the_ladder_is_that_of_the_base_and_the_report_is_made(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, page = tmp_path / "mine.toml", tmp_path / "mine.html"
    recordings = (bench / "a-steps.csv", bench / "b-drop.csv")
    assert run("calibrate", "fit", *recordings, "-o", file, "--starts", "1") == 0
    assert "the error on unseen ones is not known" in capsys.readouterr().out
    ladder = load_calibration(Assets(), file).provenance["ladder"]
    assert [row["name"] for row in ladder if row["kept"]] == [
        "Coulomb and viscous friction",
        "friction grows with load",
        "Stribeck",
        "Stribeck grows with load",
    ]
    assert not any("left_out_mae" in row for row in ladder)
    assert run("calibrate", "report", file, *recordings, "-o", page) == 0
    assert "(the motor saturates)" in page.read_text()


@pytest.mark.parametrize("verb", ["fit", "score"])
def test_unfit_recordings_are_named_and_nothing_is_written(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = record(steps, seconds=1.0)
    path = write_bam(tmp_path, made, "other.json", motor="xl430")
    out = tmp_path / "out.toml"
    words = ("-o", out) if verb == "fit" else ()
    first = () if verb == "fit" else ("nominal",)
    for file, reason in ((path, "XL430-W250-T"), (tmp_path / "gone.json", "no such file"), (tmp_path, "XL430-W250-T")):
        assert run("calibrate", verb, *first, file, *words, "--json") == 2
        told = json.loads(capsys.readouterr().out)
        assert reason in told["error"]
    assert not out.exists()


def test_a_name_to_leave_out_that_is_none_is_refused(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("calibrate", "fit", bench, "-o", tmp_path / "x.toml", "--leave-out", "d.csv") == 2
    assert "'d.csv' is none of the recordings; expected one of a-steps.csv" in capsys.readouterr().err


@pytest.mark.skipif(not REAL.is_dir(), reason=f"no recordings in {REAL}")
def test_the_shipped_bench_calibration_predicts_the_real_servo(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("calibrate", "score", "xl330-m288-bench", REAL, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["mae_mrad"] < 18
    assert all(row["seen"] for row in told["recordings"])
    assert load_calibration(Assets(), "xl330-m288-bench").provenance["left_out_mae"] < 0.025
