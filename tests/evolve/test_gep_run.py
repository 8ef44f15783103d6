"""Runs of gene expression programming: the same machinery as for trees, and runs of trees as they were."""

from __future__ import annotations

import hashlib
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.controller.controller_file import Controller, load_controller
from robolamp.controller.expression import parse
from robolamp.controller.terminals import all_terminals, on_board_terminals
from robolamp.errors import FileError, RobolampError
from robolamp.evolve.breeding import represent
from robolamp.evolve.evolution import evolve, resume
from robolamp.evolve.progress import Generation, Result
from robolamp.evolve.tasks.task import load_task

from .parts import ASSETS, CALIBRATION, LAMP, walk

TIMES = ("physics_s", "wall_s")
COUNTS = ("tried", "cached", "inherited", "stopped", "physics_steps", "mean_fitness", "normalized_fitness")


class Stop(Exception):
    """What a progress callback raises to end a run."""


def run(folder: Path, *overrides: str, stop_after: int | None = None, workers: int = 1, **options: object) -> Result:
    seen: list[Generation] = []

    def count(entry: Generation) -> None:
        seen.append(entry)
        if len(seen) == stop_after:
            raise Stop

    folder.parent.mkdir(exist_ok=True)
    task = walk(folder.parent, "gp.representation=gep", "gp.population=20", *overrides)
    options = {"seed": 3, "workers": workers, "progress": count} | options
    return evolve(task, LAMP, CALIBRATION, ASSETS, folder, **options)  # type: ignore[arg-type]


def told(folder: Path, *without: str) -> list[dict]:
    lines = [json.loads(line) for line in (folder / "progress.jsonl").read_text().splitlines()]
    return [{key: value for key, value in line.items() if key not in (*TIMES, *without)} for line in lines]


def test_the_same_seed_gives_the_same_run_at_any_number_of_workers(tmp_path: Path) -> None:
    first, second = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    result = run(first)
    run(second, workers=3)
    assert told(first) == told(second)
    texts = [(folder / "controller.toml").read_text() for folder in (first, second)]
    assert texts[0] == texts[1]
    loaded = load_controller(result.controller, LAMP)
    task = load_task(ASSETS, first / "task.toml")
    own = represent(task, task.terminals(LAMP), LAMP.names)
    assert own.decode(own.load(list(loaded.genome.values()), "here")) == loaded.expressions
    assert loaded.scores["fitness"] == result.best_fitness
    assert {entry["best_fitness"] >= entry["champion_fitness"] - 1e9 for entry in told(first)} == {True}


@pytest.mark.parametrize(
    "overrides", [(), ("gp.selection=lexicase",), ("gp.selection=pareto", "cases.lamps=2"), ("cases.fresh=true",)]
)
def test_a_run_that_was_stopped_goes_on_to_the_same_end(tmp_path: Path, overrides: tuple[str, ...]) -> None:
    whole, cut = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    run(whole, "gp.generations=4", *overrides, tuning=1)
    with pytest.raises(Stop):
        run(cut, "gp.generations=4", *overrides, tuning=1, stop_after=2, workers=2)
    resume(cut, workers=1)
    assert (cut / "controller.toml").read_text() == (whole / "controller.toml").read_text()
    assert told(cut) == told(whole)


def test_what_is_known_or_certain_to_lose_changes_no_result(tmp_path: Path) -> None:
    quick, slow = tmp_path / "a" / "walk", tmp_path / "b" / "walk"
    run(quick)
    run(slow, reuse=False)
    assert told(quick, *COUNTS) == told(slow, *COUNTS)
    texts = [tomllib.loads((folder / "controller.toml").read_text()) for folder in (quick, slow)]
    assert texts[0]["genome"] == texts[1]["genome"]
    steps = [told(folder)[-1]["physics_steps"] for folder in (quick, slow)]
    assert steps[0] < 0.9 * steps[1]


def test_the_elite_lives_on(tmp_path: Path) -> None:
    """With nothing phased in the best of a generation is never worse than that of the one before."""
    style = [f"style.{name}=0.0" for name in ("arrival", "travel_after", "posture", "fall")]
    result = run(tmp_path / "run", *style, "gp.generations=6")
    best = [entry.best_fitness for entry in result.generations]
    assert best == sorted(best, reverse=True)
    assert best[-1] < best[0]


def test_fitness_is_told_as_the_paper_has_it(tmp_path: Path) -> None:
    """EMOT, equations 1 and 2; raw fitness is standardized already: 0 is perfect."""
    run(tmp_path / "run", "gp.generations=2", "gp.population=3", "gp.early_stop=false")
    for entry in told(tmp_path / "run"):
        assert entry["adjusted_fitness"] == 1 / (1 + entry["best_fitness"])
        others = entry["adjusted_fitness"] / entry["normalized_fitness"] - entry["adjusted_fitness"]
        assert 0 < others <= 2 * entry["adjusted_fitness"] + 1e-9
        assert 1 / 3 - 1e-9 <= entry["normalized_fitness"] < 1


def test_seeds_are_put_into_genes_or_refused_in_one_line(tmp_path: Path) -> None:
    shipped = load_controller(ASSETS.path("sim/lamp/controllers/cycle.toml"), LAMP)
    alone = ("gp.population=1", "gp.generations=1")
    with pytest.raises(
        RobolampError, match=r"seed cycle: joints\.ankle: needs a head of \d+ symbols; .* gp\.gep\.head"
    ):
        run(tmp_path / "a" / "run", *alone, seeds=[shipped])
    assert not (tmp_path / "a" / "run").exists()
    result = run(tmp_path / "b" / "run", *alone, "gp.gep.head=60", "gp.gep.constants=16", seeds=[shipped])
    assert load_controller(result.controller, LAMP).expressions == shipped.expressions


def test_every_shipped_task_takes_either_representation() -> None:
    """Its seeds fit into the genes that it asks for."""
    for path in Assets().all("sim/tasks"):
        if 'figure = "lamp"' not in path.read_text():
            continue
        task = load_task(ASSETS, path, overrides=["gp.representation=gep"])
        own = represent(task, all_terminals(3), LAMP.names)
        for name in task.seeds:
            seed = load_controller(ASSETS.path(f"sim/lamp/controllers/{name}.toml"), LAMP)
            assert own.decode(own.seeded(np.random.default_rng(1), seed.expressions, name)) == seed.expressions
        trees = load_task(ASSETS, path, overrides=["gp.representation=tree"])
        assert len(represent(trees, all_terminals(3), LAMP.names).population(np.random.default_rng(1), 3)) == 3


def test_runs_of_trees_are_bred_as_before_there_were_genes() -> None:
    """The digest is of what the breeding of trees gave before it became one of two representations."""
    words = ["gp.population=40", "gp.subtree_mutation=0.1", "gp.crossover=0.6"]
    trees = represent(load_task(ASSETS, "travel", overrides=words), on_board_terminals(3, odometer=False), LAMP.names)
    rng = np.random.default_rng(11)
    population, digest = trees.population(rng, 40), hashlib.sha256()
    for _ in range(5):
        plan = trees.plan(rng)
        assert plan.tournaments is not None
        assert (plan.elites, plan.parents) == (0, len(plan.tournaments))
        parents = [population[row[0]] for row in plan.tournaments]
        population, mothers = trees.breed(rng, plan, parents, 40)
        digest.update(repr(([trees.dump(tree) for tree in population], mothers)).encode())
    assert digest.hexdigest()[:16] == "ae92979a563083d9"


def test_genes_in_a_checkpoint_that_are_none_are_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with pytest.raises(Stop):
        run(folder, stop_after=2)
    text = (folder / "checkpoint.json").read_text()
    found = json.loads(text)
    for damage in (lambda genes: genes[:2], lambda genes: [gene.replace("|", "", 1) for gene in genes]):
        found["population"][0] = damage(json.loads(text)["population"][0])
        (folder / "checkpoint.json").write_text(json.dumps(found))
        with pytest.raises(FileError, match=r"checkpoint\.json: is damaged: ExpressionError: "):
            resume(folder)


def test_tuning_writes_genes_that_express_what_was_tuned(tmp_path: Path) -> None:
    stand = tuple(parse(text, ()) for text in ("(+ 0.5 0.25)", "(* 0.5 0.5)", "0.75"))
    task = walk(tmp_path, "gp.representation=gep", "gp.population=1", "gp.generations=1", "main.distance=0.0")
    own = represent(task, task.terminals(LAMP), LAMP.names)
    genotype = own.seeded(np.random.default_rng(1), stand, "stand")
    tuned = tuple(parse(text, ()) for text in ("(+ 0.01 0.02)", "(* 0.01 0.01)", "0.03"))
    assert own.decode(own.carrying(genotype, tuned)) == tuned
    seeded = Controller("s", "", "position", 0.02, stand, LAMP.names)
    result = evolve(task, LAMP, CALIBRATION, ASSETS, tmp_path / "run", seed=1, workers=1, seeds=[seeded], tuning=8)
    loaded = load_controller(result.controller, LAMP)  # which holds genes and expressions against each other
    assert loaded.provenance["tuning"] == 8
    assert loaded.genome
    assert loaded.expressions != stand
    assert [len(part.tokens) for part in loaded.expressions] == [3, 3, 1]
