"""Compiled code that is kept is that of the sources as they are."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import robolamp

SCRIPT = """
import numpy as np
from robolamp.controller.kernels import bound_lanes
goal, lane = np.zeros((1, 1)), np.zeros(1, np.int64)
bound_lanes(lane, np.ones((1, 1)), goal, -np.ones(1), np.ones(1), np.full(1, 9.0), np.zeros(1, np.int64))
print(goal[0, 0])
"""


def test_a_kernel_is_compiled_anew_when_what_it_calls_in_another_file_has_changed(tmp_path: Path) -> None:
    package = tmp_path / "robolamp"
    shutil.copytree(Path(robolamp.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)

    def goal() -> float:
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT], env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return float(done.stdout)

    assert goal() == 1.0
    assert list(package.rglob("*.nbc"))  # it was kept
    envelope = package / "controller" / "envelope.py"
    text = envelope.read_text()
    assert text.count("return slow + 0.0") == 1
    envelope.write_text(text.replace("return slow + 0.0", "return 0.5 * slow"))
    assert goal() == 0.5
