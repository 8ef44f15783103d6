"""Saving physics changes no result; what is saved is counted."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robolamp.controller.expression import parse
from robolamp.evolve.evolution import evolve
from robolamp.evolve.progress import Result
from robolamp.evolve.race import Contest, Memory, Race, fitness, key
from robolamp.evolve.representations.tree import Genome
from robolamp.evolve.selection import winner
from robolamp.evolve.tasks.task import Task
from robolamp.evolve.trial import MAIN, MEASURES, STYLE, Case
from robolamp.twin.trace import Trace

from .parts import ASSETS, CALIBRATION, LAMP, walk


@pytest.fixture(scope="module", autouse=True)
def _small_waves() -> Iterator[None]:
    """Let even these small generations go in several waves."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("robolamp.evolve.race._WAVE", 1)
        yield


def run(task: Task, folder: Path, *, seed: int = 2, workers: int = 2, reuse: bool = True) -> Result:
    return evolve(task, LAMP, CALIBRATION, ASSETS, folder, seed=seed, workers=workers, reuse=reuse)


SAME = ("generation", "best_fitness", "best_whole", "champion_fitness", "hits", "hits_1997", "falls", "hops", "nodes")


def told(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "progress.jsonl").read_text().splitlines()]


@pytest.mark.parametrize("selection", ["tournament", "proportionate", "lexicase", "pareto"])
def test_what_is_known_or_lost_need_not_be_simulated_and_changes_nothing(tmp_path: Path, selection: str) -> None:
    task = walk(tmp_path, f"gp.selection={selection}")
    saving, plain = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    run(task, saving)
    run(task, plain, reuse=False)
    assert (saving / "controller.toml").read_text() == (plain / "controller.toml").read_text()
    for with_savings, without in zip(told(saving), told(plain), strict=True):
        assert {name: with_savings[name] for name in SAME} == {name: without[name] for name in SAME}
    last, all_of_it = told(saving)[-1], told(plain)[-1]
    trials = 40 * 5 * 3
    assert all_of_it["tried"] == trials
    assert last["tried"] + last["cached"] + last["inherited"] + last["stopped"] == trials
    assert last["cached"] > 0
    assert last["inherited"] > 0
    assert (last["stopped"] > 0) == (selection == "tournament")
    assert last["physics_steps"] < all_of_it["physics_steps"]


def test_early_stopping_by_itself_changes_nothing(tmp_path: Path) -> None:
    on, off = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    run(walk(tmp_path), on, seed=5)
    run(walk(tmp_path, "gp.early_stop=false"), off, seed=5, workers=1)
    assert (on / "controller.toml").read_text() == (off / "controller.toml").read_text()
    assert told(on)[-1]["stopped"] > told(off)[-1]["stopped"] == 0


def test_screening_tries_the_worst_on_fewer_cases(tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    run(walk(tmp_path, "gp.screening=0.25", "gp.generations=2"), folder)
    entry = told(folder)[0]
    assert entry["tried"] == 40 + 20 + 10  # all on one case, half on another, a quarter on the third
    assert entry["stopped"] == 20 * 2 + 10


class Oracle:
    """Stands in for physics: each program's measures are given, and what is asked for is counted."""

    def __init__(self, table: dict[Genome, np.ndarray]) -> None:
        self.table = table
        self.asked = 0

    def program(self, genome: Genome):
        raise AssertionError("nothing is inherited here")

    def measure(self, genomes, cases, pairs, *, record):
        values = np.array([self.table[genomes[genome]][case] for genome, case in pairs]).reshape(-1, len(MEASURES))
        self.asked += len(pairs)
        yield slice(0, len(pairs)), values, Trace.blank(len(pairs), 1, 1, 3)


NUMBERS = st.floats(0.0, 3.0, allow_subnormal=False).map(lambda value: round(value, 2))


@settings(deadline=None, max_examples=200)
@given(st.data())
def test_the_winners_and_the_champion_are_those_of_a_full_evaluation(data: st.DataObject) -> None:
    individuals = data.draw(st.integers(2, 12))
    cases = data.draw(st.integers(1, 4))
    phase = data.draw(st.sampled_from([0.0, 0.5, 0.9]))
    champion = data.draw(st.sampled_from([float("inf"), 1.0, 2.5]))
    population = [tuple(parse(f"{index % 7 + joint}", ()) for joint in range(3)) for index in range(individuals)]
    table = {}
    for genome in population:
        values = np.zeros((cases, len(MEASURES)))
        for column in (MAIN, STYLE):
            values[:, column] = data.draw(st.lists(NUMBERS, min_size=cases, max_size=cases))
        table[key(genome)] = values
    drawn = st.lists(st.integers(0, individuals - 1), min_size=3, max_size=3)
    tournaments = np.array(data.draw(st.lists(drawn, max_size=8)), np.int64).reshape(-1, 3)
    promise = np.array(data.draw(st.lists(NUMBERS, min_size=individuals, max_size=individuals)))
    oracle = Oracle(table)
    race = Race(
        oracle, [Case(0.1, 0)] * cases, LAMP, 0.02, population, [None] * individuals, Memory()
    )  # type: ignore[arg-type]  # fmt: skip
    race.race(Contest(tournaments, phase, champion), promise)
    full = np.stack([table[key(genome)] for genome in population])
    found = fitness(race.values, phase)
    truth = fitness(full, phase)
    for members in tournaments:
        assert winner(found, members) == winner(truth, members)
    whole = np.where(race.complete, fitness(race.values, 1.0), np.inf)
    if fitness(full, 1.0).min() < champion:
        assert int(np.argmin(whole)) == int(np.argmin(fitness(full, 1.0)))
    best = np.where(race.complete, found, np.inf)
    assert best.min() == truth.min()
    assert race.counts.tried == oracle.asked
    assert race.counts.tried + race.counts.cached + race.counts.stopped == individuals * cases
