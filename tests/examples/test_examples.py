"""Every example runs as it stands, and is listed in examples/README.md."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from sleeper import undisturbed

EXAMPLES = Path(__file__).parents[2] / "examples"


REALTIME = {"03_emulator"}


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(script, id=script.stem, marks=[pytest.mark.realtime] if script.stem in REALTIME else [])
        for script in sorted(EXAMPLES.glob("*.py"))
    ],
)
def test_example_runs(script: Path, tmp_path: Path) -> None:
    def attempt() -> None:
        done = subprocess.run(
            [sys.executable, "-W", "error", str(script)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip()

    undisturbed(attempt, 0.01 if script.stem in REALTIME else 120.0)
    assert not list(tmp_path.iterdir()), "an example leaves files behind"


def test_examples_are_listed() -> None:
    readme = (EXAMPLES / "README.md").read_text()
    assert [script.name for script in EXAMPLES.glob("*.py") if f"`{script.name}`" not in readme] == []
