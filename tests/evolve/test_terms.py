"""Fitness terms of one's own."""

from __future__ import annotations

from pathlib import Path

import pytest

from robolamp.errors import FileError, RobolampError
from robolamp.evolve.evolution import evolve
from robolamp.evolve.tasks import fitness
from robolamp.evolve.tasks.task import load_task

from .parts import ASSETS, CALIBRATION, LAMP, TINY

OWN = """
from robolamp.evolve.tasks.fitness import term

@term("stretch")
def stretch(outcome):
    return {value}
"""


@pytest.fixture(autouse=True)
def _forget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fitness, "_TERMS", dict(fitness._TERMS))


def own(folder: Path, value: str) -> Path:
    path = folder / "own.py"
    path.write_text(OWN.format(value=value))
    return path


def test_a_term_from_a_file_counts(tmp_path: Path) -> None:
    (tmp_path / "tiny.toml").write_text(TINY)
    fitness.load_terms(own(tmp_path, "10.0 + abs(outcome.angles[:, 1])"))
    task = load_task(ASSETS, tmp_path / "tiny.toml", overrides=["main.stretch=2.0"])
    result = evolve(task, LAMP, CALIBRATION, ASSETS, tmp_path / "run", seed=1, terms=tmp_path / "own.py")
    assert result.best_fitness > 20.0


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("-1.0 + 0 * outcome.x", "fitness term 'stretch': gave -1; expected nothing below 0"),
        ("3.0", "gave shape ()"),
        ("outcome.nose", "fitness term 'stretch': fails at line 6: AttributeError: 'Outcome' object has no"),
        ("outcome.x.astype(str)", "TypeError: gave <U32; expected numbers"),
        ("outcome.x + 1j", "TypeError: gave complex128; expected numbers"),
    ],
)
def test_a_term_that_gives_what_it_may_not_is_named(tmp_path: Path, value: str, words: str) -> None:
    (tmp_path / "tiny.toml").write_text(TINY)
    fitness.load_terms(own(tmp_path, value))
    task = load_task(ASSETS, tmp_path / "tiny.toml", overrides=["main.stretch=2.0"])
    with pytest.raises(RobolampError) as caught:
        evolve(task, LAMP, CALIBRATION, ASSETS, tmp_path / "run", seed=1)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1 / 0", "fails at line 1: ZeroDivisionError: division by zero"),
        ("def", "fails at line 1: SyntaxError"),
        ("x = 1", "registers no fitness term"),
        ("raise SystemExit(3)", "fails at line 1: SystemExit: 3"),
        (OWN.replace("stretch", "fall").format(value=1), "fall': is a term of robolamp's own; choose another name"),
    ],
)
def test_a_file_that_is_no_good_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(RobolampError) as caught:
        fitness.load_terms(tmp_path / "own.py")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(FileError, match="cannot be read"):
        fitness.load_terms(tmp_path / "none.py")
