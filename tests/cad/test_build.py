"""The parts are built again from their sources: `make cad-test`. Needs the CAD kernel, and minutes."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(importlib.util.find_spec("build123d") is None, reason="needs build123d: `make cad-test`"),
]


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-B", str(folder / "hardware/cad/build.py"), *words]
    return subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False)


def new_lamp(folder: Path) -> Path:
    done = subprocess.run(
        [sys.executable, "-m", "robolamp", "new", str(folder)],
        env=ENVIRONMENT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder


def change(folder: Path, *pairs: tuple[str, str]) -> None:
    path = folder / "hardware/cad/shape.toml"
    text = path.read_text(encoding="utf-8")
    for old, new in pairs:
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_committed_files_are_what_the_sources_give() -> None:
    done = run(ROOT, "--check")
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_build_gives_the_committed_meshes(tmp_path: Path) -> None:
    """By volume and extent: kernels differ in triangles."""
    folder = new_lamp(tmp_path / "mine")
    done = run(folder, "--no-pictures")
    assert done.returncode == 0, done.stderr
    place = "hardware/cad/exported"
    names = sorted(path.name for path in (ROOT / place).glob("*.stl"))
    assert names == sorted(path.name for path in (folder / place).glob("*.stl"))
    for name in names:
        ours, theirs = (triangles(root / place / name) for root in (ROOT, folder))
        np.testing.assert_allclose(ours.min((0, 1)), theirs.min((0, 1)), atol=1e-3 * np.abs(ours).max())
        np.testing.assert_allclose(ours.max((0, 1)), theirs.max((0, 1)), atol=1e-3 * np.abs(ours).max())
        assert volume(ours) == pytest.approx(volume(theirs), rel=1e-3)


def triangles(path: Path) -> np.ndarray:
    rows = np.frombuffer(path.read_bytes()[84:], dtype=[("v", "<f4", (12,)), ("a", "<u2")])
    return rows["v"].reshape(-1, 4, 3)[:, 1:].astype(float)


def volume(of: np.ndarray) -> float:
    return float(np.einsum("nd,nd->n", of[:, 0], np.cross(of[:, 1], of[:, 2])).sum() / 6)


@pytest.mark.parametrize("length", [90.0, 120.0])
def test_lamps_with_other_arms_build_stand_and_can_be_evolved(tmp_path: Path, length: float) -> None:
    folder = new_lamp(tmp_path / "mine")
    change(folder, ("lower = 100.0", f"lower = {length}"), ("upper = 100.0", f"upper = {length}"))
    done = run(folder, "--no-pictures")
    assert done.returncode == 0, done.stderr
    built = tomllib.loads((folder / "hardware/cad/exported/properties.toml").read_text(encoding="utf-8"))
    ours = tomllib.loads((ROOT / "hardware/cad/exported/properties.toml").read_text(encoding="utf-8"))
    longer = built["bodies"]["lower_arm"]["mass"] - ours["bodies"]["lower_arm"]["mass"]
    assert (longer > 0) == (length > 100.0)

    model = mujoco.MjModel.from_xml_path(str(folder / "sim/lamp/scene.xml"))  # it follows, and stands
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 1000)
    assert data.body("base").xmat[8] > np.cos(np.radians(2))
    assert np.linalg.norm(data.body("upper_arm").xpos - data.body("lower_arm").xpos) == pytest.approx(length / 1000)
    assert model.joint("knee").range[1] == built["stops"]["knee"][1]
    words = ["evolve", "hop", "--population", "4", "--generations", "1", "--seed", "1"]
    command = [sys.executable, "-m", "robolamp", *words, "--lamp", str(folder), "-o", str(tmp_path / "run")]
    evolved = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert evolved.returncode == 0, evolved.stderr


def test_a_shade_that_meets_the_arm_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    folder = new_lamp(tmp_path / "mine")
    change(folder, ("mouth_radius = 42.0", "mouth_radius = 70.0"))
    before = contents(folder)
    done = run(folder, "--no-pictures")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "shade" in done.stderr
    assert "mm apart" in done.stderr
    assert contents(folder) == before
    shutil.rmtree(folder)
