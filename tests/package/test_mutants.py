"""benchmarks/mutants.py: what it changes, that a mutant is its content and not its place, and that it is really run."""

from __future__ import annotations

import ast
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = '''
"""Words."""
from robolamp.jit import njit

MOST: float = 2.5


@njit(nogil=True, error_model="numpy")
def kernel(a: int | None, flag: bool = True) -> float:
    """More words."""
    assert a == 1, "never"
    if a < 3 and flag:
        raise ValueError(f"{a + 1} is too much" + "indeed")
    return max(a * 2, -a)
'''
CHANGES = [
    "2.5 -> 5.0", "True -> False", "a < 3 and flag -> not (a < 3 and flag)", "a < 3 and flag -> a < 3 or flag",
    "a < 3 -> a <= 3", "a < 3 -> a >= 3", "3 -> 4", "raise ValueError(f'{a + 1} is too much' + 'indeed') -> pass",
    "max(a * 2, -a) -> min(a * 2, -a)", "a * 2 -> a / 2", "2 -> 3", "-a -> a",
]  # fmt: skip
RUN = """
import numpy as np
from robolamp.controller.expression import parse
from robolamp.controller.program import ProgramSet, compile_program
made = ProgramSet([compile_program([parse("(+ t 3)", ("t",))], ("t",))])
print(made.run(np.array([0]), np.array([[4.0]]), np.zeros((1, 1)))[0, 0])
"""


@pytest.fixture(scope="module")
def mutants() -> ModuleType:
    spec = importlib.util.spec_from_file_location("mutants", ROOT / "benchmarks/mutants.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules["mutants"] = module  # where dataclasses look for it
    spec.loader.exec_module(module)
    return module


def test_what_is_changed(mutants: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    path = tmp_path / "x.py"
    path.write_text(SOURCE)
    found = mutants.mutants_of("room", path)
    assert sorted(each.change for each in found) == sorted(CHANGES)
    raw = path.read_bytes()
    for each in found:
        ast.parse(raw[: each.at[0]] + each.code.encode() + raw[each.at[1] :])
    assert {each.change for each in found if not each.runs} == {"2.5 -> 5.0", "True -> False"}
    path.write_text('"""Other words."""\n\nimport math\n' + SOURCE)
    assert [each.key for each in mutants.mutants_of("room", path)] == [each.key for each in found]


def test_a_sample_has_every_room_and_is_that_of_its_seed(mutants: ModuleType) -> None:
    every = mutants.all_mutants()
    sample = mutants.sample(every, 200, 1)
    assert len({each.key for each in sample}) == len(sample) == 200
    assert {each.room for each in sample} == {each.room for each in sample[:20]} == set(mutants.ROOMS)
    assert sample == mutants.sample(every, 200, 1) != mutants.sample(every, 200, 2)


def test_a_compiled_mutant_is_run_and_gone(mutants: ModuleType, tmp_path: Path) -> None:
    copy = mutants.Copy(tmp_path / "copy")
    (adds,) = (
        each
        for each in mutants.mutants_of("controller", ROOT / "robolamp/controller/kernels.py")
        if (each.scope, each.change) == ("run_lanes", "a + b -> a - b")
    )

    def told() -> str:
        surroundings = os.environ | {"PYTHONPATH": str(copy.folder)}
        done = subprocess.run(
            [sys.executable, "-c", RUN], cwd=copy.folder, env=surroundings, capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    assert told() == "7.0"
    with copy.mutated(adds):
        assert told() in ("1.0", "-1.0")
    assert told() == "7.0"
    assert (ROOT / adds.path).read_bytes() == (copy.folder / adds.path).read_bytes()
