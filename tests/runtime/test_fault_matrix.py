"""The fault matrix of benchmarks/faults.py, small: nothing unnoticed, unsafe, or outside the envelope."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from robolamp.dynamixel.servo_state import ServoState
from robolamp.dynamixel.servos import Servos
from robolamp.emulator.faults.script import Event, Faults

FAULTS = Path(__file__).parents[2] / "benchmarks" / "faults.py"


@pytest.fixture(scope="module")
def matrix() -> Iterator[ModuleType]:
    spec = importlib.util.spec_from_file_location("fault_matrix", FAULTS)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.mark.parametrize(
    ("kind", "outcome"),
    [
        ("instruction dropped", "recovered"),
        ("status duplicated", "recovered"),
        ("foot corrupted", "recovered"),
        ("servo loses its id", "stopped"),
        ("servo silent for good", "frozen"),
        ("servo port unplugged", "stopped"),
    ],
)
def test_a_fault_is_noticed_and_ends_well(matrix: ModuleType, kind: str, outcome: str) -> None:
    found = matrix.one((kind, 1))
    assert (found.outcome, found.outside) == (outcome, 0), found
    assert 0.0 <= found.detected < 0.3


def test_a_stuck_foot_is_noticed_once_the_lamp_moves(matrix: ModuleType) -> None:
    """One that is stuck while the lamp rests has no effect, and shows when it moves on: it takes several moments."""
    found = [matrix.one(("foot stuck 1 s", seed)) for seed in range(1, 9)]
    assert {each.outcome for each in found} == {"stopped", "no effect"}, found
    assert not any(each.outside for each in found), found
    seen = [each.detected for each in found if each.outcome == "stopped"]
    assert len(seen) > len(found) / 2
    assert 0.0 <= min(seen) <= np.median(seen) < 0.3


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_matrix(matrix: ModuleType) -> None:
    for kind in matrix.KINDS:
        for seed in range(10, 13):
            found = matrix.one((kind, seed))
            assert found.outcome in {"recovered", "stopped", "frozen", "no effect"}, found
            assert found.outside == 0, found


def test_the_witness_finds_what_is_not_true(matrix: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """The judge itself: without the check of goals by the loop, lost goals are not noticed, and the matrix says so."""
    read = Servos.read

    def blind(servos: Servos) -> ServoState:
        state = read(servos)
        state.goal_lost[:] = False
        state.asked_again[:] = False
        return state

    def dropped(kind: str, seed: int) -> tuple[Faults, bool]:  # readings and goals take turns: one seed hits goals
        return Faults("goals", events=tuple(Event("dropped", packet=400 + seed + 2 * i) for i in range(5))), False

    monkeypatch.setattr(Servos, "read", blind)
    monkeypatch.setattr(matrix, "script", dropped)
    found = [matrix.one(("instruction dropped", seed)) for seed in range(2)]
    assert "NOT NOTICED" in {each.outcome for each in found}, found
