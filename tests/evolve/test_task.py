from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robolamp.controller.terminals import all_terminals, on_board_terminals
from robolamp.errors import FileError, RobolampError
from robolamp.evolve.tasks.task import load_task
from robolamp.evolve.tasks.task_twins import compiled
from robolamp.twin.actuators.gears import RIGID
from robolamp.twin.lamp_model import Pole, TwinModel
from robolamp.twin.lanes.fleet import Fleet

from .parts import ASSETS, CALIBRATION, LAMP, TINY, task


def test_every_shipped_task_loads() -> None:
    names = [path.stem for path in ASSETS.all("sim/tasks") if not path.stem.startswith("spread")]
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
    assert loaded.terminals(LAMP) == on_board_terminals(3)
    seen = task(tmp_path, ('"on-board"', '"all"')).terminals(LAMP)
    assert seen == tuple(name for name in all_terminals(3) if name != "goal_time")
    assert task(tmp_path, ('"on-board"', '["a0", "px"]')).terminals(LAMP) == ("a0", "px")
    timed = task(tmp_path, ('"on-board"', '"all"'), ("lamps = 1", "lamps = 1\ngoal_time = [1, 3]"))
    assert timed.terminals(LAMP) == all_terminals(3)


def test_the_tableau_of_the_paper() -> None:
    """Gritz & Hahn (1997), Table 1, and section 4's best parameters."""
    loaded = load_task(ASSETS, "luxo-1997")
    assert loaded.signals == ("t", "a0", "a1", "a2", "s0", "px", "py", "pz", "vx", "vy", "vz", "goal_met", "goal_dist")
    assert (loaded.constants, loaded.cases.count, loaded.duration) == ((-30.0, 30.0), 6, 5.0)
    gp, tuned = loaded.gp, load_task(ASSETS, "luxo-1997-tuned").gp
    assert (gp.population, gp.generations, gp.tournament, gp.crossover) == (400, 50, 6, 0.9)
    assert (tuned.population, tuned.generations, tuned.tournament, tuned.crossover) == (250, 30, 6, 0.8)
    assert loaded.main == {"distance": 1.0}
    assert loaded.style == {"arrival": 0.33, "travel_after": 0.33, "posture": 0.33, "fall": 1.0}


def test_overrides_change_the_task_and_its_text(tmp_path: Path) -> None:
    changes = (
        "gp.population=7",
        "gp.selection=lexicase",
        'signals=["t"]',
        "style.fall = 1.5",
        "pole.height=0.2",
        "pole.x=0.2",
    )
    loaded = load_task(ASSETS, "luxo-1997", overrides=changes)
    assert (loaded.gp.population, loaded.gp.selection, loaded.signals) == (7, "lexicase", ("t",))
    assert (loaded.style["fall"], loaded.pole) == (1.5, Pole(0.2, 0.2))
    assert "# the ephemeral random constant" in loaded.source
    again = tmp_path / "again.toml"
    again.write_text(loaded.source)
    assert load_task(ASSETS, again) == loaded


@pytest.mark.parametrize(
    "text", ["", "=", "gp.population", "gp.population=", ".=1", "gp..x=1", "name.x=1", "gp.depth=[1"]
)
def test_an_override_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(RobolampError, match="--set"):
        load_task(ASSETS, "luxo-1997", overrides=[text])


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
        (
            "distance = 1.0\nfall = 2.0\n\n[style]\nposture = 0.33",
            "[style]",
            "main: no term of [main]",
        ),
        ("posture = 0.33", "elegance = 1", "style.elegance: unknown fitness term; expected one of distance,"),
        ("posture = 0.33", "posture = -1", "style.posture: -1 is not a number from 0 to 1000"),
        ("_mutation = 0.2", "_mutation = 0.4", "gp.constant_mutation: 0.4 is not a number from 0 to 0.3"),
        ('"on-board"', '["t", "telepathy"]', "signals: unknown 'telepathy'; expected some of t a0"),
        ('"on-board"', "[]", "signals: [] is not a list of different terminals"),
        ('"on-board"', '["t", "goal_time"]', "signals: goal_time needs cases.goal_time, which the task does not give"),
        ('"on-board"', "3", "signals: 3 is not one of on-board, all"),
        ("posture = 0.33", "pole = 1", "style.pole: needs [pole], which the task does not give"),
        ("posture = 0.33", "pose = 1", "style.pose: needs [[poses]], which the task does not give"),
        ("posture = 0.33", "timing = 1", "style.timing: needs cases.goal_time, which the task does not give"),
        ("[main]", "[pole]\nheight = 9\nx = 0.2\n[main]", "pole.height: 9 is not a number from 0.02 to 1 m"),
        ("[main]", "[[poses]]\ntime = 0.1\nangles = [1]\n[main]", "poses[0].angles: [1] is not 3 angles"),
        (
            "[main]",
            "[[poses]]\ntime = 9\nangles = [0, 0, 0]\n[main]",
            "poses[0].time: 9 is not a number from 0 to 0.6 s",
        ),
        ("lamps = 1", "lamps = 1\ngoal_time = [3, 1]", "cases.goal_time: [3, 1] is not two rising numbers"),
        (
            "tournament = 3",
            'selection = "nepotism"',
            "gp.selection: 'nepotism' is not one of tournament, proportionate",
        ),
        ('name = "tiny"', 'name = "tiny"\nfigure = "cat"', "figure: 'cat' is not one of lamp"),
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


def test_a_task_names_its_spread(tmp_path: Path) -> None:
    """On the wide one drawn lamps bend, and the calibrated one, which is rigid, stands beside them all the same."""
    for own, bends in (("", True), ('\nspread = "spread-narrow"', False)):
        asked = task(tmp_path, ("lamps = 1", f"lamps = 3{own}"))
        lamps = compiled(asked, LAMP, CALIBRATION, ASSETS, np.random.default_rng(1))
        stiffness = np.array([lamp.gears.table[:, 1] for lamp in lamps if isinstance(lamp, TwinModel)])
        assert len(stiffness) == len(lamps)
        assert (stiffness[0] == (RIGID if bends else 0.0)).all()
        assert bool((stiffness[1:] > 5.0).all() and (stiffness[1:] < 60.0).all()) is bends
        Fleet(lamps, asked.control_period)
    unknown = task(tmp_path, ("lamps = 1", 'lamps = 2\nspread = "wide"'))
    with pytest.raises(FileError, match="wide: no such spread; give a file, or one of: spread, spread-narrow"):
        compiled(unknown, LAMP, CALIBRATION, ASSETS, np.random.default_rng(1))
