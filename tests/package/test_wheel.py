"""The built wheel carries its data and works from an empty folder."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel's content, and nothing of the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "-w",
        str(folder),
        str(ROOT),
    ]
    subprocess.run(build, check=True, capture_output=True, timeout=300)
    (wheel,) = folder.glob("*.whl")
    target = folder / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(target)
    return target


def robolamp(installed: Path, cwd: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, "-m", "robolamp", *words]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=180, check=False)


def test_imports_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    script = "import robolamp, robolamp.assets; print(robolamp.__file__); print(robolamp.assets.shipped())"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    package, assets = done.stdout.split()
    assert Path(package).is_relative_to(installed)
    assert Path(assets) == installed / "robolamp" / "_assets"


def test_help(installed: Path, tmp_path: Path) -> None:
    done = robolamp(installed, tmp_path, "--help")
    assert done.returncode == 0, done.stderr
    assert "dry-run" in done.stdout


def test_score_from_an_empty_folder(installed: Path, tmp_path: Path) -> None:
    done = robolamp(installed, tmp_path, "score", "hop", "--goals", "0.1:0.5:3", "--json")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["goals_m"] == pytest.approx([0.1, 0.3, 0.5])
    assert said["falls"] == 0
    assert not list(tmp_path.iterdir())


def test_every_data_file_is_in_the_wheel(installed: Path) -> None:
    assets = installed / "robolamp" / "_assets"
    for folder in ("sim", "calibration", "hardware"):
        here = {path.relative_to(ROOT) for path in (ROOT / folder).rglob("*") if path.is_file()}
        there = {path.relative_to(assets) for path in (assets / folder).rglob("*") if path.is_file()}
        assert here == there
