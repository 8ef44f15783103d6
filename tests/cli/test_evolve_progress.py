"""What `robolamp evolve` shows: it fits a terminal of 80 columns, and says which way is better."""

from __future__ import annotations

import io
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from robolamp.cli.main import main
from robolamp.cli.screen.evolve_progress import Board
from robolamp.evolve.progress import Generation

WIDTH = 80
COUNTS = {"hits": 119, "hits_1997": 120, "falls": 100, "cases": 120, "nodes": 1999, "tried": 10**6, "cached": 10**6}


def generation(number: int, fitness: float) -> Generation:
    made = dict.fromkeys(Generation.__dataclass_fields__, 0.0)
    made |= dict.fromkeys(("inherited", "stopped", "individuals", "physics_steps"), 10**7) | COUNTS
    fitnesses = dict.fromkeys(("best_fitness", "best_whole", "champion_fitness"), fitness)
    return Generation(**{**made, **fitnesses, "stage": "evolution", "generation": number, "wall_s": 1e5})  # type: ignore[arg-type]


@pytest.mark.parametrize("terminal", [True, False])
def test_the_largest_numbers_fit_into_80_columns(terminal: bool) -> None:
    shown = io.StringIO()
    board = Board(Console(file=shown, width=WIDTH, force_terminal=terminal))
    board.begin(10_000, 1000)
    with board:
        for number, fitness in enumerate((0.0004, 9999.9994, 123_456.7, 1.5e300)):
            board.show(generation(9990 + number, fitness))
    lines = [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]|\r", "", line) for line in shown.getvalue().split("\n")]
    assert max(map(len, lines)) <= WIDTH
    rows = [line for line in lines if line.startswith("evolution")]
    assert "119/120" in rows[-1]
    assert "1.5e+300" in rows[-1]
    assert len({len(row) for row in rows}) == 1  # columns stand below each other
    assert any("lower is better" in line for line in lines)


def test_a_run_fits_into_80_columns(tmp_path: Path) -> None:
    words = "evolve hop -o run --population 2 --generations 1 --seed-from hop --set duration=0.5"
    command = [sys.executable, "-m", "robolamp", *words.split()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    for stream in (done.stdout, done.stderr):
        assert max(map(len, stream.splitlines())) <= WIDTH
        assert "lower is better" in stream


@pytest.mark.parametrize(("signals", "verb"), [("on-board", "dry-run"), ('["px", "a0"]', "render")])
def test_what_it_proposes_next_is_not_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, signals: str, verb: str
) -> None:
    out = tmp_path / "a run"
    seed = tmp_path / "seed.toml"
    read = "px" if verb == "render" else "a0"
    seed.write_text(f'schema = 1\nname = "s"\n[joints]\nankle = "(* 0.1 {read})"\nknee = "0"\nneck = "0"\n')
    words = ["hop", "-o", str(out), "--population", "1", "--generations", "1", "--seed-from", str(seed)]
    words += ["--set", "duration=0.3", "--set", "cases.count=1", "--set", "cases.lamps=1"]
    words += ["--set", f"signals={signals}"]
    with pytest.raises(SystemExit) as ended:
        main(["evolve", *words])
    assert not ended.value.code
    proposed = [line.removeprefix("Next:").strip() for line in capsys.readouterr().out.splitlines()[-3:]]
    assert [shlex.split(line)[:3] for line in proposed] == [
        ["robolamp", each, str(out / "controller.toml")] for each in ("score", "explain", verb)
    ]
