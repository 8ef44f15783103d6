"""Play and bending of a lamp: found through the wire where they are, and left out where they are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robolamp.calibrate.lamp.calibration_file import lamp_file
from robolamp.calibrate.lamp.findings import findings
from robolamp.calibrate.lamp.lamp_fit import LampFit, fit_lamp
from robolamp.calibrate.lamp.session import LampSession, read_session
from robolamp.calibrate.lamp.simulation import simulate
from robolamp.calibrate.lamp.unknowns import GEARS, gears_of
from robolamp.calibration import Calibration, Parameter, load_calibration
from robolamp.cli.calibrate.lamp import fit_session
from robolamp.twin.lamp_model import build
from robolamp.twin.variation.random_lamps import LampLaw
from tests.calibrate.sessions import ASSETS, LAMP, NOMINAL, SETUP, recorded, short, steps

LOOSE = """
name = "loose"
seed = 3
[joint.ankle]
backlash = 0.009
[joint.knee]
backlash = 0.0
[joint.neck]
backlash = 0.0
[lamp]
stiffness = 22.0
"""
RIGID = LOOSE.replace("0.009", "0.0").replace("22.0", "1e4")
PLAN = [
    short(steps("chirp-ankle")[0], 6.0),
    *(short(step, 3.0) for step in steps("squares", "steps-soft")),
    short(steps("steps-firm")[0], 2.0),
]
ASKED = ("coulomb", "link_mass")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> LampSession:
    folder = tmp_path_factory.mktemp("loose")
    file = folder / "loose.toml"
    file.write_text(LOOSE)
    recorded(folder / "session", PLAN, str(file))
    return read_session(folder / "session", LAMP)


@pytest.fixture(scope="module")
def fit(session: LampSession) -> LampFit:
    return fit_lamp(session, LAMP, NOMINAL, ASSETS, names=ASKED)


def value(fit: LampFit, label: str) -> float:
    at = [unknown.label for unknown in fit.asked].index(label)
    return fit.asked[at].value(float(fit.z[at]))


def with_gears(play: float, stiffness: float) -> Calibration:
    """Return nominal with play in the ankle and an arm that bends."""
    groups = {name: dict(parameters) for name, parameters in NOMINAL.groups.items()}
    groups["joint ankle"] = {"backlash": Parameter(play, "rad", None, "")}
    groups["lamp"]["arm_stiffness"] = Parameter(stiffness, "Nm/rad", None, "")
    return replace(NOMINAL, groups=groups)


def test_a_replay_begins_with_gears_pushed_and_links_bent_as_the_load_has_them(session: LampSession) -> None:
    soft = session.named("steps-soft")[0]
    shot = simulate(soft, [build(LAMP, with_gears(0.009, 22.0), ASSETS, clamped=True)])
    error = np.abs(shot.angle[0] - soft.run.angle[soft.rows])
    assert error[:20].max() < 0.002  # in the middle of its play the ankle would fall by half of 9 mrad


def test_play_and_stiffness_are_found_and_make_the_twin_better(fit: LampFit, session: LampSession) -> None:
    rigid, bent = fit.left_out
    assert bent < 0.6 * rigid
    assert fit.mae["steps-firm"][1] == pytest.approx(bent)
    assert value(fit, "ankle.backlash") == pytest.approx(0.009, abs=0.002)
    assert value(fit, "lamp.arm_stiffness") == pytest.approx(22.0, rel=0.10)
    assert not {"knee.backlash", "neck.backlash"} & {unknown.label for unknown in fit.asked}
    assert "Play and bending of the arm are in the twin (ankle.backlash" in " ".join(
        findings(fit, session, LAMP, NOMINAL)
    )


def test_the_file_holds_them_and_lamps_drawn_from_it_keep_them(
    fit: LampFit, session: LampSession, tmp_path: Path
) -> None:
    file = tmp_path / "loose.toml"
    file.write_text(lamp_file("loose", fit, session, LAMP, NOMINAL))
    calibration = load_calibration(ASSETS, file)
    stiffness = calibration.groups["lamp"]["arm_stiffness"]
    assert stiffness.value == pytest.approx(value(fit, "lamp.arm_stiffness"), rel=1e-4)
    assert stiffness.stderr
    assert calibration.joint("ankle", "backlash") == pytest.approx(value(fit, "ankle.backlash"), rel=1e-4)
    drawn, _ = LampLaw(LAMP, calibration, ASSETS).draw(np.random.default_rng(1))
    assert drawn.joint("ankle", "backlash") == calibration.joint("ankle", "backlash")
    assert drawn.lamp("arm_stiffness") == stiffness.value
    assert gears_of(LAMP, calibration) == ()  # a fit from this base does not look for them again


def test_a_lamp_without_them_is_left_rigid(tmp_path: Path) -> None:
    file = tmp_path / "rigid.toml"
    file.write_text(RIGID)
    recorded(tmp_path / "session", [short(PLAN[1], 2.0), PLAN[-1]], str(file))
    session = read_session(tmp_path / "session", LAMP)
    fit = fit_lamp(session, LAMP, NOMINAL, ASSETS, names=ASKED)
    assert not {unknown.name for unknown in fit.asked} & set(GEARS)
    assert "arm_stiffness" not in fit.lamp
    left_out = "Play and bending of the arm are left out of the twin"
    assert any(text.startswith(left_out) for text in findings(fit, session, LAMP, NOMINAL))
    _, facts = fit_session(SETUP, tmp_path / "session", tmp_path / "fitted.toml", quiet=True, rigid=True)
    assert not any(text.startswith("Play and bending") for text in facts["findings"])  # nobody looked
