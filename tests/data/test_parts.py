"""The committed parts are those of their sources; without the CAD kernel."""

from __future__ import annotations

import hashlib
import importlib.util
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.twin.actuators.gears import TEETH
from robolamp.twin.variation.spread import load_spread

from .readme import ROOT

CAD = ROOT / "hardware" / "cad"
EXPORTED = CAD / "exported"
MODEL = ROOT / "sim/lamp"
JOINTS = {"ankle": "lower_arm", "knee": "upper_arm", "neck": "head"}


@pytest.fixture(scope="module")
def told() -> dict[str, Any]:
    return tomllib.loads((EXPORTED / "properties.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def shape() -> dict[str, Any]:
    return tomllib.loads((CAD / "shape.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def writer() -> ModuleType:
    """hardware/cad/model.py, which is no package's."""
    found = importlib.util.spec_from_file_location("model", CAD / "model.py")
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def test_the_model_is_written_from_the_properties(told: dict[str, Any], writer: ModuleType) -> None:
    assert (MODEL / "lamp.xml").read_text(encoding="utf-8") == writer.as_mjcf(told), "run `make cad`"


def test_the_model_weighs_what_the_parts_weigh(told: dict[str, Any]) -> None:
    """1 % of mass, 0.5 mm, 5 % of inertia, as MuJoCo reads them."""
    model = mujoco.MjModel.from_xml_path(str(MODEL / "lamp.xml"))
    assert {model.body(i).name for i in range(1, model.nbody)} == set(told["bodies"])
    for name, link in told["bodies"].items():
        body = model.body(name)
        assert body.mass[0] == pytest.approx(link["mass"], rel=0.01)
        np.testing.assert_allclose(body.ipos, link["centre"], atol=0.5e-3)
        xx, yy, zz, xy, xz, yz = link["inertia"]
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        turned = turn.reshape(3, 3) @ np.diag(body.inertia) @ turn.reshape(3, 3).T
        np.testing.assert_allclose(turned, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], atol=0.05 * min(xx, yy, zz))
    assert sum(link["mass"] for link in told["bodies"].values()) == pytest.approx(model.body_mass.sum(), rel=0.01)


def test_the_model_shows_the_parts(told: dict[str, Any], writer: ModuleType) -> None:
    files = {path.stem: path for path in (MODEL / "meshes").iterdir()}
    assert set(files) == set(writer.mesh_names())
    assert sum(path.stat().st_size for path in files.values()) < 1_000_000
    shade, printed = points(files["shade"]) * 1000, told["parts"]["shade"]["size_mm"]
    np.testing.assert_allclose(np.ptp(shade, axis=0), printed, atol=0.3)
    assert shade[:, 2].max() == pytest.approx(1000 * told["shade"]["end"], abs=0.3)
    lowest = min(points(path)[:, 2].min() for name, path in files.items() if name.startswith("base"))
    assert lowest == pytest.approx(0.0, abs=1e-6)
    for arm in ("lower_arm", "upper_arm"):
        tubes = points(files[f"{arm}_steel"])
        low, high = told["tubes"][arm]
        assert tubes[:, 2].min() <= low + 1e-4
        assert tubes[:, 2].max() >= high - 1e-4


def points(path: Path) -> np.ndarray:
    rows = np.frombuffer(path.read_bytes()[84:], dtype=[("v", "<f4", (12,)), ("a", "<u2")])
    return rows["v"].reshape(-1, 4, 3)[:, 1:].reshape(-1, 3).astype(float)


def test_properties_are_of_the_sources_that_are_here(told: dict[str, Any]) -> None:
    digest = hashlib.sha256()
    for name in told["source"]["files"]:
        digest.update(name.encode() + b"\0" + (CAD / name).read_bytes() + b"\0")
    assert digest.hexdigest() == told["source"]["sha256"], "the parts' sources have changed: run `make cad`"


def test_properties_follow_the_shape(told: dict[str, Any], shape: dict[str, Any]) -> None:
    assert told["lengths"]["lower_arm"] == pytest.approx(shape["arms"]["lower"] / 1000)
    assert told["lengths"]["upper_arm"] == pytest.approx(shape["arms"]["upper"] / 1000)
    assert told["lengths"]["axis"] == pytest.approx(shape["foot"]["axis"] / 1000)
    assert told["neutral"] == shape["neutral"]
    for joint, (low, high) in told["stops"].items():
        assert shape["stops"][joint][0] == low
        assert high <= shape["stops"][joint][1]


def test_every_part_has_its_files_and_prints_on_the_bed(told: dict[str, Any], shape: dict[str, Any]) -> None:
    for name, part in told["parts"].items():
        for suffix in ("step", "stl", "3mf"):
            assert (EXPORTED / f"{name}.{suffix}").stat().st_size > 500
        assert max(part["size_mm"]) <= shape["print"]["bed"] <= 180
        assert part["wall_mm"] >= shape["print"]["wall"] - 0.01
        assert part["wall_mm"] >= 1.19
    printed = {path.stem for path in EXPORTED.glob("*.st*")}
    assert printed == set(told["parts"])


def test_links_keep_their_distance_in_every_pose(told: dict[str, Any], shape: dict[str, Any]) -> None:
    assert len(told["checks"]["gaps_mm"]) == 6
    assert min(told["checks"]["gaps_mm"].values()) >= shape["print"]["clearance"] - 1e-3


def test_stiffness_is_said_for_every_joint(told: dict[str, Any]) -> None:
    for joint in (*JOINTS, "gears"):
        nominal, low, high = told["stiffness"][joint]
        assert 5 < low < nominal < high < 200


def test_the_bending_lamp_and_the_spread_are_as_stiff_as_the_parts(told: dict[str, Any]) -> None:
    joints = np.array([told["stiffness"][joint] for joint in JOINTS])
    assert load_calibration(Assets(), "bending").lamp("arm_stiffness") == pytest.approx(joints[:, 0].mean(), rel=0.02)
    law = load_spread(Assets()).laws["stiffness"]
    assert law.low == pytest.approx(joints[:, 0].mean(), rel=0.02)
    within = np.log(joints[:, 2] / joints[:, 1]).mean() / 2
    assert 1.645 * law.high == pytest.approx(within, rel=0.1)  # nine times in ten
    assert told["stiffness"]["gears"][0] == pytest.approx(TEETH, rel=0.02)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("lower = 100.0", "lower = 60.0", "arms.lower = 60; expected 71.4 mm or more"),
        ("mouth_radius = 42.0", "mouth_radius = 19.0", "shade.mouth_radius"),
        ("bulb_mass = 22.0", "bulb_mass = 0.0", "shade.bulb_mass = 0.0; expected 0.1 to 200 g"),
        ("density = 1.24", "density = 0", "print.density = 0; expected 0.1 to 10 g/cm3"),
        ("axis = 32.0", "axis = 'high'", "foot.axis = 'high'; expected"),
        ("[stops]", "[halts]", "table [stops] is missing"),
        ("knee = [-1.05, 0.80]", "knee = [0.1, 0.80]", "stops.knee = [0.1, 0.8]"),
    ],
)
def test_what_cannot_be_built_is_refused_before_the_kernel_loads(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    folder = tmp_path / "hardware" / "cad"
    folder.mkdir(parents=True)
    for path in CAD.glob("*.py"):
        (folder / path.name).write_bytes(path.read_bytes())
    text = (CAD / "shape.toml").read_text(encoding="utf-8")
    assert old in text
    (folder / "shape.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    before = sorted(tmp_path.rglob("*"))
    done = subprocess.run(
        [sys.executable, "-B", str(folder / "build.py")], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 2
    assert message in done.stderr
    assert str(folder / "shape.toml") in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_a_build_replaces_all_its_files_or_none(tmp_path: Path) -> None:
    written, there = tmp_path / "new", tmp_path / "there"
    for folder in (written, there):
        folder.mkdir()
    for name in ("changed", "first", "last"):
        (written / name).write_text("new")
    (there / "changed").write_text("old")
    (there / "file").write_text("in the way of a folder")
    places = {name: there / name for name in ("changed", "first")} | {"last": there / "file" / "last"}
    before = {path: path.read_text() for path in there.iterdir()}
    script = "import sys, build; from pathlib import Path; build._replace(dict(zip(*[map(Path, sys.argv[1:])] * 2)))"
    pairs = [str(path) for name, place in places.items() for path in (written / name, place)]
    command = [sys.executable, "-B", "-c", script, *pairs]
    done = subprocess.run(command, cwd=CAD, capture_output=True, text=True, check=False)
    assert "NotADirectoryError" in done.stderr or "FileExistsError" in done.stderr
    assert {path: path.read_text() for path in there.iterdir()} == before
    done = subprocess.run(command[:-2], cwd=CAD, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (there / "changed").read_text() == (there / "first").read_text() == "new"


def test_limits_come_inside_stops_that_are_closer(tmp_path: Path) -> None:
    """The knee's stop of a lamp with arms of 90 mm; what need not change keeps its bytes."""
    path = tmp_path / "lamp.toml"
    text = (ROOT / "hardware/lamp.toml").read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    stops = "{'ankle': (-0.63, 0.63), 'knee': (-1.05, %s), 'neck': (-1.05, 0.38)}"
    script = "import sys, limits; from pathlib import Path; sys.stdout.write(limits.fitted(Path({!r}), {}))"

    def fitted(knee: float) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-B", "-c", script.format(str(path), stops % knee)]
        return subprocess.run(command, cwd=CAD, capture_output=True, text=True, check=False)

    assert fitted(0.8).stdout == text
    closer = fitted(0.65).stdout
    assert closer == text.replace("upper = 0.78\nrest = 0.76", "upper = 0.63\nrest = 0.61")
    path.write_text("joint = 3\n")
    assert "cannot be read as the description of a lamp" in fitted(0.65).stderr
