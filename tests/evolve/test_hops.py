"""The shipped hops: made with the calibration that is shipped, and made again by `make hops`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robolamp.assets import Assets, shipped
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import load_controller
from robolamp.lamp import load_lamp

CONTROLLERS = shipped() / "sim/lamp/controllers"
SCRIPT = Path(__file__).parents[2] / "benchmarks/hops.py"
SMALL = "--seed-from cycle --population 1 --generations 1 --seed 1 --set cases.count=1 --set cases.lamps=1"
COMMAND = f"robolamp evolve hop -o runs/small {SMALL}"


@pytest.mark.parametrize("path", sorted(CONTROLLERS.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_controllers_were_made_with_the_shipped_calibration(path: Path) -> None:
    provenance = load_controller(path, load_lamp(Assets())).provenance
    if provenance:  # those written by hand have none
        name = provenance["calibration"]
        told = f"{path.name} was evolved on another {name}.toml: `make hops`, or evolve it again by its command"
        assert provenance["calibration_sha256"] == load_calibration(Assets(), name).hash, told


def again(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    arguments = ("small", "--folder", folder, "--runs", folder / "runs", "--goals", "0.1:0.3:3", "--lamps", "2", *words)
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_hops_are_made_again_and_shipped_only_if_they_score(tmp_path: Path) -> None:
    there = tmp_path / "small.toml"
    lines = [f'command = "{COMMAND}"', 'calibration_sha256 = "0"']
    nothing = 'schema = 1\nname = "small"\n[joints]\nankle = "0"\nknee = "0"\nneck = "0"\n[provenance]\n'
    there.write_text(nothing + "\n".join(lines) + "\n")
    done = again(tmp_path)
    assert done.returncode == 0, done.stderr
    assert "small: shipped: " in done.stdout
    made = load_controller(there, load_lamp(Assets()))
    assert made.name == "small"
    assert made.provenance["calibration_sha256"] == load_calibration(Assets()).hash
    assert made.provenance["command"] == COMMAND
    assert made.scores["cases"] == 1
    assert made.origin == "by hand"  # so small a run finds nothing better than its seed, which was written

    # One that hits more than the small run finds is not replaced.
    good = (CONTROLLERS / "hop-counting.toml").read_text()
    kept = "\n".join(line if not line.startswith("command") else lines[0] for line in good.splitlines()) + "\n"
    there.write_text(kept)
    done = again(tmp_path)
    assert done.returncode == 1, done.stderr
    assert "small: not shipped: " in done.stdout
    assert "--resume" in done.stdout
    assert there.read_text() == kept

    there.write_text(nothing + 'command = "rm -r runs"\n')
    done = again(tmp_path)
    assert done.returncode == 1
    assert "is not `robolamp evolve TASK -o RUN ...`" in done.stderr
    assert "Traceback" not in done.stderr
