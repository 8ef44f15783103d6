from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robolamp.controller.controller_file import Controller, load_controller, save_controller, slug
from robolamp.controller.expression import Expression, parse
from robolamp.errors import ExpressionError, FileError, RobolampError

from .parts import LAMP, TERMINALS, expressions
from .test_expression import FIGURE_3

GOOD = """
schema = 1
name = "by hand"
control_period = 0.02
terminals = ["t", "a0"]
[joints]
ankle = "(* 0.3 t)"
knee = "(ifltz a0 t 0)  ; lift"
neck = "0"
[scores]
hits = 3
[provenance]
seed = 4
"""


names = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,63}", fullmatch=True)


def written(folder: Path, text: str) -> Path:
    path = folder / "c.toml"
    path.write_text(text)
    return path


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
@given(st.lists(expressions, min_size=3, max_size=3), st.floats(0.002, 0.1), names)
def test_what_is_saved_is_loaded(tmp_path: Path, parts: list[Expression], period: float, name: str) -> None:
    made = Controller(
        name, "hop", "position", period, tuple(parts), LAMP.names,
        {"seed": 3, "versions": {"numpy": "2"}}, {"fitness": 0.25},
    )  # fmt: skip
    path = tmp_path / "c.toml"
    save_controller(made, path)
    loaded = load_controller(path, LAMP)
    assert replace(loaded, source="") == made
    assert [str(part) for part in loaded.expressions] == [str(part) for part in made.expressions]
    assert loaded.source == path.read_text()
    assert max(map(len, loaded.source.splitlines())) <= 160


def test_a_file_by_hand_with_defaults(tmp_path: Path) -> None:
    loaded = load_controller(written(tmp_path, GOOD), LAMP, on_board=True)
    assert (loaded.name, loaded.task, loaded.drive, loaded.control_period) == ("by hand", "", "position", 0.02)
    assert loaded.terminals == ("t", "a0")
    assert loaded.compile(TERMINALS).run([0.5] + [-1.0] * 19) == [0.15, 0.5, 0.0]


def test_the_papers_list_is_accepted_for_the_table(tmp_path: Path) -> None:
    path = written(tmp_path, f'schema = 1\nname = "figure 3"\nexpressions = """{FIGURE_3}"""\n')
    loaded = load_controller(path, LAMP)
    assert loaded.terminals == ("t", "a0", "a1", "a2", "s0", "px", "pz", "vx", "vz")
    with pytest.raises(ExpressionError, match=r"c\.toml: joints\.ankle: needs pz, which this lamp cannot supply; it"):
        load_controller(path, LAMP, on_board=True)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("schema = 1", "schema = 2", "schema: 2 is not a whole number from 1 to 1"),
        ("schema = 1", "", "schema: missing"),
        ('name = "by hand"', "name = 3", "name: 3 is not a text"),
        ("control_period = 0.02", "control_period = 0", "control_period: 0 is not a number from 0.002 to 0.1 s"),
        ("control_period = 0.02", "control_period = nan", "control_period: nan is not a number"),
        ("control_period = 0.02", 'control_period = "fast"', "control_period: 'fast' is not a number"),
        ("control_period = 0.02", "control_periode = 0.02", "control_periode: unknown; expected one of"),
        ("control_period = 0.02", 'origin = "bred"', "origin: 'bred' is not one of evolved, tuned, by hand"),
        ("control_period = 0.02", 'drive = "velocity"', "drive: 'velocity' is not one of position"),
        ("control_period = 0.02", "scores = 1", "not valid TOML"),
        ('"t", "a0"', '"t", "q7"', "terminals: unknown 'q7'; expected some of t a0"),
        ('"t", "a0"', '"t", ["a0"]', "terminals: unknown ['a0']"),
        ('"t", "a0"', '"t"', "terminals: declares ['t'], but the expressions read ['t', 'a0']"),
        ('name = "by hand"', 'name = "../up"', "name: '../up' is not 1 to 64 letters, digits, spaces, or . _ -"),
        ('name = "by hand"', 'name = "[/b]"', "name: '[/b]' is not 1 to 64 letters"),
        ('name = "by hand"', 'name = ""', "name: '' is not 1 to 64 letters"),
        ('name = "by hand"', 'name = "' + "x" * 300 + '"', "name: '" + "x" * 64 + "...' is not 1 to 64 letters"),
        (
            'ankle = "(* 0.3 t)"',
            "",
            "joints: the controller's joints (knee, neck) are not the lamp's (ankle, knee, neck)",
        ),
        (
            'neck = "0"',
            'neck = "0"\nelbow = "0"',
            "joints (ankle, knee, neck, elbow) are not the lamp's (ankle, knee, neck)",
        ),
        ('neck = "0"', 'neck = "(list 0 0 0)"', "joints.neck: a (list ...) holds all joints: give it as `expressions`"),
        ("[joints]", '[joints]\nexpressions = "(list 0 0 0)"', "joints.expressions: belongs above the first [table]"),
        ('neck = "0"', "neck = 0", "joints.neck: 0 is not a text"),
        ('neck = "0"', 'neck = "(+ 0"', "joints.neck: found the end at line 1, column 5"),
        ('neck = "0"', 'neck = "(+ 0 q7)"', "joints.neck: found 'q7' at line 1, column 6"),
        ("[joints]", "[joint", "not valid TOML"),
        ("schema = 1", "schema = 1\nx = " + "[" * 5000, "not valid TOML"),
        ("schema = 1", "schema = " + "1" * 5000, "not valid TOML"),
        ("schema = 1", 'schema = 1\nexpressions = "(list 1 2)"', "expressions: holds 2; expected one a joint (ankle,"),
        ("schema = 1", 'schema = 1\nexpressions = "(list 1 2 3)"', "joints: unknown; expected one of"),
    ],
)
def test_a_bad_file_is_refused_by_file_key_and_legal_values(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises((FileError, ExpressionError)) as caught:
        load_controller(path, LAMP)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_missing_or_not_text(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="No such file"):
        load_controller(tmp_path / "none.toml", LAMP)
    with pytest.raises(FileError, match="cannot be read"):
        load_controller(tmp_path, LAMP)
    path = tmp_path / "c.toml"
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(FileError, match="not UTF-8 text"):
        load_controller(path, LAMP)


@given(st.text(max_size=60))
def test_no_text_at_all_is_met_with_anything_but_one_line(text: str) -> None:
    with pytest.raises(RobolampError) as caught:
        parse(f"(+ {text}", TERMINALS)
    assert "\n" not in str(caught.value)


def test_nothing_is_written_where_a_file_cannot_be(tmp_path: Path) -> None:
    made = Controller("c", "", "position", 0.02, (parse("0", TERMINALS),) * 3, LAMP.names)
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be written"):
        save_controller(made, tmp_path / "file" / "c.toml")
    assert [item.name for item in tmp_path.iterdir()] == ["file"]


@given(st.text(max_size=80))
def test_any_folder_gives_a_name_that_loads(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "slug.toml"
    path.write_text(GOOD.replace("by hand", slug(text)))
    assert load_controller(path, LAMP).name == slug(text)
    assert slug(slug(text)) == slug(text)


def test_a_name_that_fits_is_kept() -> None:
    assert slug("run 3.b_-") == "run 3.b_-"
    assert slug("run [a]/é") == "run -a"
