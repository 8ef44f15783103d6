"""A whole lamp, found through the wire: joints, foot and floor; what it says; its file and its page."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import robolamp.calibrate.lamp.session as session_module
from robolamp.calibrate.lamp.calibration_file import lamp_file
from robolamp.calibrate.lamp.findings import findings, verdict
from robolamp.calibrate.lamp.floor_fit import flights
from robolamp.calibrate.lamp.hop_proof import prove
from robolamp.calibrate.lamp.lamp_fit import LampFit, fit_lamp
from robolamp.calibrate.lamp.open_loop_fit import covariance
from robolamp.calibrate.lamp.session import LampSession, read_session
from robolamp.calibrate.lamp.simulation import rescale, simulate
from robolamp.calibrate.report.calibration_page import page
from robolamp.calibrate.report.simulations import show_session
from robolamp.calibration import Calibration, load_calibration
from robolamp.controller.hop_counter import shortest_flight
from robolamp.errors import FileError, RobolampError
from robolamp.log.reader import Run
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import build
from tests.calibrate.sessions import ASSETS, LAMP, NOMINAL, recorded, short, steps

REALITY = """
name = "bent"
seed = 3
[joint.knee]
strength = 0.94
friction = 1.25
encoder_noise = 0.001
[foot]
gain = 1.2
noise = 0.02
[lamp]
mass = 1.05
"""
PLAN = [
    short(steps("squares")[0], 3.0),
    short(steps("steps-soft")[0], 2.0),
    short(steps("steps-firm")[0], 2.0),
    *steps("drop-2", "hop-15cm"),
]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> LampSession:
    folder = tmp_path_factory.mktemp("bent")
    file = folder / "bent.toml"
    file.write_text(REALITY)
    recorded(folder / "session", PLAN, str(file))
    return read_session(folder / "session", LAMP)


@pytest.fixture(scope="module")
def fit(session: LampSession) -> LampFit:
    asked = ("torque_constant", "viscous", "coulomb", "load_motor", "load_external", "delay")
    return fit_lamp(session, LAMP, NOMINAL, ASSETS, names=asked, iterations=4, gears=False)


@pytest.fixture(scope="module")
def fitted(fit: LampFit, session: LampSession, tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    path = tmp_path_factory.mktemp("file") / "bent.toml"
    path.write_text(lamp_file("bent", fit, session, LAMP, NOMINAL))
    return load_calibration(ASSETS, path)


def test_a_twin_that_is_right_predicts_its_recordings(tmp_path: Path) -> None:
    recorded(tmp_path, [PLAN[1]])
    recording = read_session(tmp_path, LAMP).recordings[0]
    shot = simulate(recording, [build(LAMP, NOMINAL, ASSETS, clamped=True)])
    assert np.abs(shot.angle[0] - recording.run.angle[recording.rows]).mean() < 0.002


def test_lanes_do_not_touch_each_other(session: LampSession) -> None:
    recording = session.recordings[1]
    weak = replace(NOMINAL, groups={**NOMINAL.groups, "lamp": {**NOMINAL.groups["lamp"]}})
    weak.groups["lamp"]["mass_scale"] = replace(weak.groups["lamp"]["mass_scale"], value=1.3)  # pyright: ignore
    twins = [build(LAMP, each, ASSETS, clamped=True) for each in (NOMINAL, weak)]
    both = simulate(recording, twins).angle
    assert (both[0] == simulate(recording, twins[:1]).angle[0]).all()
    assert (both[1] == simulate(recording, twins[1:]).angle[0]).all()
    assert not (both[0] == both[1]).all()


def test_lamps_of_different_strength_in_one_call_do_what_each_does_alone(session: LampSession) -> None:
    recording = next(each for each in session.recordings if each.name == "hop-15cm")  # its motors saturate
    twins = [build(LAMP, NOMINAL, ASSETS, Bend(strength=strength)) for strength in (1.0, 1.1)]
    both = simulate(recording, twins)
    for lane, twin in enumerate(twins):
        alone = simulate(recording, [twin])
        np.testing.assert_array_equal(both.angle[lane], alone.angle[0])


def test_the_weak_joint_is_found_and_the_others_left_alone(fit: LampFit) -> None:
    values = {unknown.label: unknown.value(z) for unknown, z in zip(fit.asked, fit.z, strict=True)}
    assert values["knee.torque_constant"] == pytest.approx(0.94 * 0.37, rel=0.03)
    assert values["ankle.torque_constant"] == pytest.approx(0.37, rel=0.03)
    assert values["neck.torque_constant"] == pytest.approx(0.37, rel=0.05)
    assert values["knee.load_external"] / values["ankle.load_external"] == pytest.approx(1.25, rel=0.12)


def test_mass_foot_and_hop_come_from_scale_force_and_ruler(fit: LampFit) -> None:
    assert fit.lamp["mass_scale"][0] == pytest.approx(1.05, abs=0.005)
    assert fit.lamp["foot_gain"][0] == pytest.approx(1.2, rel=0.01)
    judged = verdict(fit)
    assert judged.held_out[1] < judged.held_out[0] / 3
    assert judged.travel < 0.10
    assert judged.time < 0.020
    assert judged.good


def test_a_reading_is_late_by_what_its_bytes_do_not_take(session: LampSession, fit: LampFit) -> None:
    """The emulator's line takes a reading's bytes, 0.8 ms, and nothing more."""
    assert np.median(np.concatenate([each.run.read_done - each.run.began for each in session.recordings])) > 5e-4
    assert fit.latency == pytest.approx(0.0, abs=1e-5)


def test_the_delay_is_measured_twice(fit: LampFit, session: LampSession) -> None:
    told = findings(fit, session, LAMP, NOMINAL)
    assert "They agree within 2.5 ms." in told[0]
    late = replace(fit, latency=0.008)
    assert "They do not agree" in findings(late, session, LAMP, NOMINAL)[0]


def test_the_file_is_a_calibration_with_errors_and_provenance(
    fit: LampFit, fitted: Calibration, session: LampSession
) -> None:
    knee = fitted.groups["joint knee"]["torque_constant"]
    assert knee.stderr
    assert knee.stderr < 0.02
    assert fitted.provenance["lamp_sha256"] == session.manifest.lamp_sha256
    assert len(fitted.provenance["recordings"]) == 5
    names, matrix = fitted.provenance["covariance"]["parameters"], fitted.provenance["covariance"]["matrix"]
    assert np.linalg.eigvalsh(np.array(matrix)).min() > 0
    at = names.index("knee.torque_constant")
    assert np.sqrt(matrix[at][at]) == pytest.approx(knee.stderr, rel=1e-3)
    assert fitted.servo("XL330-M288-T", "knee")["armature"] == 0.0018  # what was not asked is the base's
    assert build(LAMP, fitted, ASSETS).foot_gain == pytest.approx(fit.lamp["foot_gain"][0], rel=1e-5)


def test_what_no_recording_tells_keeps_its_prior_and_says_what_would_tell_it(session: LampSession) -> None:
    alone = replace(session, recordings=tuple(one for one in session.recordings if one.name == "steps-soft"))
    brief = replace(alone.recordings[0], last=alone.recordings[0].first + 60)
    alone = replace(alone, recordings=(brief,))
    poor = fit_lamp(alone, LAMP, NOMINAL, ASSETS, names=("torque_constant", "resistance"), iterations=1)
    told = " ".join(findings(poor, alone, LAMP, NOMINAL))
    unknown = [index for index in range(len(poor.asked)) if not poor.identified(index)]
    assert unknown
    assert (poor.z[unknown] == 0.0).all()
    assert "Record a torque-off drop to separate K from R" in told
    text = lamp_file("poor", poor, alone, LAMP, NOMINAL)
    for index in unknown:
        own = text.split(f"[joint.{poor.asked[index].joint}]")[1].split("[")[0]
        assert f"{poor.asked[index].name} =" not in own


def test_the_proof_is_better_after_than_before(session: LampSession, fitted: Calibration) -> None:
    hop = session.named("hop")[0]
    before, after = (prove(hop, LAMP, one, ASSETS) for one in (NOMINAL, fitted))
    assert after.mae < before.mae / 2
    assert after.travel_error < before.travel_error


def test_the_page_shows_every_recording_and_every_parameter(session: LampSession, fitted: Calibration) -> None:
    text = page(fitted, show_session(session, LAMP, fitted, ASSETS))
    assert text.count("<svg") == 5
    assert "http" not in text.replace("http://www.w3.org", "")  # nothing is fetched
    for word in ("steps-firm", "left out", "contact_softness", "0.354 (e-manual", "agree within", "The twin predicts"):
        assert word in text.replace("\u00a0", " ")


def test_a_session_without_a_clamped_recording_is_refused(session: LampSession) -> None:
    with pytest.raises(RobolampError, match="no recording of the clamped lamp"):
        fit_lamp(replace(session, recordings=session.named("hop")), LAMP, NOMINAL, ASSETS)


def test_a_session_of_another_lamp_is_refused(session: LampSession) -> None:
    text = LAMP.source.replace("upper = 0.78", "upper = 0.77")
    knee = replace(LAMP.joints[1], upper=0.77)
    other = replace(LAMP, source=text, joints=(LAMP.joints[0], knee, LAMP.joints[2]))
    with pytest.raises(FileError, match=r"is of another lamp, or lamp\.toml was changed since"):
        read_session(session.folder, other)


def test_a_session_is_read_where_lamp_toml_is_only_written_differently(session: LampSession) -> None:
    assert read_session(session.folder, replace(LAMP, source=LAMP.source + "# a word more\n")).recordings


def test_flights_are_told_by_contact() -> None:
    time = np.arange(0.0, 1.0, 0.02)
    contact = np.ones(50, bool)
    contact[10:20] = False  # a flight
    contact[30:33] = False  # a rebound
    assert flights(contact, time, shortest_flight(LAMP.flight_time, 0.02)) == [
        (pytest.approx(0.19), pytest.approx(0.39))
    ]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_from_end_to_end(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "robolamp", "calibrate", "all", "--emulate", "-o", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "The twin predicts this lamp" in done.stdout
    assert (tmp_path / "report.html").stat().st_size > 500_000
    assert load_calibration(ASSETS, tmp_path / "calibration.toml").name == "calibration"


def gappy(session: LampSession) -> LampSession:
    """Return a session in which half the knee's readings are missing."""
    found = []
    for recording in session.recordings[:3]:
        angle, age = recording.run.angle.copy(), recording.run.angle_age.copy()
        angle[::2, 1] = age[::2, 1] = np.nan
        found.append(replace(recording, run=replace(recording.run, angle=angle, angle_age=age)))
    return replace(session, recordings=tuple(found))


def test_missing_readings_are_left_out_and_named_and_never_an_error_of_zero(session: LampSession) -> None:
    holed = gappy(session)
    told: list[float] = []
    fit = fit_lamp(holed, LAMP, NOMINAL, ASSETS, names=("coulomb",), iterations=1, gears=False, done=told.append)
    twin = build(LAMP, NOMINAL, ASSETS, clamped=True)
    rescale(twin, session.manifest.mass or 0.0)
    for recording in holed.recordings:
        error = np.abs(simulate(recording, [twin]).angle[0] - recording.run.angle[recording.rows])
        assert np.isnan(error[:, 1]).mean() == pytest.approx(0.5, abs=0.02)
        assert fit.mae[recording.name][0] == pytest.approx(np.nanmean(error), rel=0.05)
    assert "Readings are missing: squares " in findings(fit, holed, LAMP, NOMINAL)[0]
    assert told == sorted(told)
    assert 0.5 < told[-1] <= 1.0


def test_covariance_counts_only_what_was_read() -> None:
    rng = np.random.default_rng(3)
    shots = rng.standard_normal((3, 400, 1)) * 0.01
    holed = shots.copy()
    holed[:, 100:300] = np.nan
    cut = np.concatenate([shots[:, :100], shots[:, 300:]], axis=1)
    np.testing.assert_allclose(covariance([holed]), covariance([cut]))


def test_a_joint_that_never_answered_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(tmp_path, [short(PLAN[1], 1.5)])
    whole = session_module.read_run

    def silent(path: Path) -> Run:
        run = whole(path)
        run.angle[:, 2] = np.nan
        return run

    monkeypatch.setattr(session_module, "read_run", silent)
    with pytest.raises(FileError, match="holds no reading of neck; record it again"):
        read_session(tmp_path, LAMP)
