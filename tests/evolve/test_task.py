from __future__ import annotations

from pathlib import Path

import pytest

from robolamp.controller.terminals import all_terminals, on_board_terminals
from robolamp.errors import FileError
from robolamp.evolve.task import load_task

from .parts import ASSETS, TINY, task


def test_every_shipped_task_loads() -> None:
    names = [path.stem for path in ASSETS.all("sim/tasks") if path.stem != "spread"]
    assert "hop" in names
    for name in names:
        loaded = load_task(ASSETS, name)
        assert loaded.name == name
        assert loaded.main


def test_what_a_task_says(tmp_path: Path) -> None:
    loaded = task(tmp_path)
    assert loaded.source == TINY
    assert loaded.main == {"distance": 1.0, "fall": 2.0}
    assert loaded.gp.depth_at_birth == (2, 4)
    assert loaded.terminals(3) == on_board_terminals(3)
    assert task(tmp_path, ('"on-board"', '"all"')).terminals(3) == all_terminals(3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "tiny"', "", "name: missing; expected a text"),
        ("control_period = 0.02", "control_period = 0", "control_period: 0 is not a number from 0.002 to 0.1 s"),
        ('"on-board"', '"telepathy"', "signals: 'telepathy' is not one of on-board, all"),
        ("[-1.5, 1.5]", "[1.5, -1.5]", "constants: [1.5, -1.5] is not two rising numbers"),
        ("[-1.5, 1.5]", "[1.5]", "constants: [1.5] is not two rising numbers"),
        ("[-1.5, 1.5]", '["a", "b"]', "constants: ['a', 'b'] is not two rising numbers"),
        ("[-1.5, 1.5]", "[nan, nan]", "constants: [nan, nan] is not two rising numbers"),
        ("high = 0.60", "high = 0.01", "cases.high: 0.01 is not a number from 0.05 to 100 m"),
        ("count = 1", "count = 1.5", "cases.count: 1.5 is not a whole number from 1 to 1000"),
        ("count = 1", "counts = 1", "cases.count: missing"),
        ("posture = 0.33", "elegance = 1", "style.elegance: unknown fitness term; expected one of distance,"),
        ("posture = 0.33", "posture = -1", "style.posture: -1 is not a number from 0 to 1000"),
        ("mutation = 0.2", "mutation = 0.4", "gp.mutation: 0.4 is not a number from 0 to 0.3"),
        ("tournament = 3", "tournament = 0", "gp.tournament: 0 is not a whole number from 1 to 1000"),
        (
            "depth_at_birth = [2, 4]",
            "depth_at_birth = [2.5, 4]",
            "gp.depth_at_birth: [2.5, 4] is not two whole numbers",
        ),
        ("depth = 6", "depth = 3", "gp.depth: 3 is not a whole number from 4 to 100"),
        ("depth = 6", "depth = 6\nelitism = 1", "gp.elitism: unknown; expected one of"),
    ],
)
def test_a_bad_task_is_refused_by_file_key_and_legal_values(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(FileError) as caught:
        task(tmp_path, (old, new))
    assert str(caught.value).startswith(str(tmp_path / "tiny.toml"))
    assert words in str(caught.value)


def test_an_unknown_task_lists_the_known_ones() -> None:
    with pytest.raises(FileError, match=r"juggle: no such task; give a file, or one of: hop"):
        load_task(ASSETS, "juggle")
