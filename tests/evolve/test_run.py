from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from robolamp.controller.controller_file import Controller, load_controller
from robolamp.controller.expression import parse
from robolamp.controller.terminals import on_board_terminals
from robolamp.errors import FileError, RobolampError
from robolamp.evolve.evolution import evolve
from robolamp.evolve.progress import Generation, Result
from robolamp.evolve.race import fitness
from robolamp.evolve.representations.tree import Genome, constants
from robolamp.evolve.tasks.task import Task
from robolamp.evolve.trial import Trials, draw_cases
from robolamp.evolve.tune import tune
from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.fleet import Fleet

from .parts import ASSETS, CALIBRATION, LAMP, task

TERMINALS = on_board_terminals(3)
TIMES = ("physics_s", "wall_s")


def run(task: Task, folder: Path, **options: object) -> Result:
    return evolve(task, LAMP, CALIBRATION, ASSETS, folder, **({"seed": 5, "workers": 1} | options))  # type: ignore[arg-type]


def told(folder: Path) -> list[dict]:
    """The run's progress without its times."""
    lines = [json.loads(line) for line in (folder / "progress.jsonl").read_text().splitlines()]
    return [{key: value for key, value in line.items() if key not in TIMES} for line in lines]


def genome(*texts: str) -> Genome:
    return tuple(parse(text, TERMINALS) for text in texts)


def test_the_same_seed_gives_the_same_run_at_any_number_of_workers(tmp_path: Path) -> None:
    tiny = task(tmp_path, ("lamps = 1", "lamps = 2"))
    first, second = tmp_path / "a" / "tiny", tmp_path / "b" / "tiny"
    results = [run(tiny, first), run(tiny, second, workers=2)]
    assert results[0].best_fitness == results[1].best_fitness
    assert (first / "controller.toml").read_text() == (second / "controller.toml").read_text()
    assert told(first) == told(second)
    other = tmp_path / "other"
    run(tiny, other, seed=6)
    assert told(other) != told(first)


def test_what_a_run_leaves_behind(tmp_path: Path) -> None:
    tiny = task(tmp_path, ("generations = 2", "generations = 3"))
    folder = tmp_path / "deep" / "run"
    seen: list[Generation] = []
    result = run(tiny, folder, progress=seen.append, command="robolamp evolve tiny -o run")
    names = [".lock", "checkpoint.json", "controller.toml", "progress.jsonl", "run.toml", "task.toml"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert [entry["generation"] for entry in told(folder)] == [0, 1, 2]
    assert told(folder)[-1]["individuals"] == 36
    assert tuple(seen) == result.generations
    loaded = load_controller(result.controller, LAMP, on_board=True)
    assert (loaded.name, loaded.task, loaded.control_period) == ("run", "tiny", 0.02)
    assert loaded.provenance["seed"] == 5
    assert loaded.provenance["command"] == "robolamp evolve tiny -o run"
    assert loaded.provenance["calibration_sha256"] == CALIBRATION.hash
    assert loaded.scores["fitness"] == result.best_fitness
    # Scored again from its file, the champion is what the run said it is.
    score = score_of(tiny, [loaded.expressions])
    assert (score.main + score.style)[0] == pytest.approx(result.best_fitness, abs=1e-12)


def score_of(tiny: Task, genomes: list[Genome]):
    drawn = np.random.SeedSequence(5).spawn(5)[2]
    fleet = Fleet([build(LAMP, CALIBRATION, ASSETS)], tiny.control_period, 1)
    return Trials(fleet, tiny, TERMINALS).score(genomes, draw_cases(np.random.default_rng(drawn), tiny, 1))


def test_a_folder_that_holds_a_run_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    tiny = task(tmp_path)
    for name in ("progress.jsonl", "controller.toml", "checkpoint.json", "task.toml"):
        folder = tmp_path / name.split(".")[0]
        folder.mkdir()
        (folder / name).write_text("mine")
        with pytest.raises(FileError, match=r"holds a run already \(.+\); go on with --resume, or give another"):
            run(tiny, folder)
        assert [path.read_text() for path in folder.iterdir()] == ["mine"]


def test_what_was_stopped_before_its_first_checkpoint_may_be_begun_again(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run(task(tmp_path), folder)
    for name in ("checkpoint.json", "controller.toml"):
        (folder / name).unlink()
    assert run(task(tmp_path), folder).controller.exists()


def test_a_seed_of_another_control_period_is_refused(tmp_path: Path) -> None:
    slow = Controller("slow", "", "position", 0.04, genome("0", "0", "0"), LAMP.names)
    with pytest.raises(RobolampError, match=r"seed slow: has a control period of 0\.04 s; the task's is 0\.02 s"):
        run(task(tmp_path), tmp_path / "run", seeds=[slow])


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be made"):
        run(task(tmp_path), tmp_path / "file" / "run")


def test_a_period_the_physics_cannot_keep_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(RobolampError, match=r"control_period: 0\.003 s is not a whole number of physics steps"):
        run(task(tmp_path, ("control_period = 0.02", "control_period = 0.003")), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_seeded_controller_is_tried_in_generation_0(tmp_path: Path) -> None:
    tiny = task(tmp_path, ("generations = 2", "generations = 1"), ("duration = 0.6", "duration = 1.0"))
    shipped = load_controller(ASSETS.path("sim/lamp/controllers/hop-counting.toml"), LAMP)
    alone = score_of(tiny, [shipped.expressions])
    result = run(tiny, tmp_path / "run", seeds=[shipped])
    assert result.generations[0].best_fitness <= alone.main[0]
    assert result.best_fitness <= (alone.main + alone.style)[0]
    best = Controller("b", "", "position", 0.02, load_controller(result.controller, LAMP).expressions, LAMP.names)
    only = run(tiny, tmp_path / "again", seeds=[best] * 12)
    assert {entry.mean_fitness == pytest.approx(entry.best_fitness) for entry in only.generations} == {True}
    assert load_controller(only.controller, LAMP).expressions == best.expressions


def test_generations_get_no_worse_when_the_phase_is_taken_out(tmp_path: Path) -> None:
    tiny = task(tmp_path, ("posture = 0.33", "posture = 0.0"), ("generations = 2", "generations = 5"))
    result = run(tiny, tmp_path / "run")
    assert result.best_fitness == min(entry.best_fitness for entry in result.generations)
    assert [entry.champion_fitness for entry in result.generations] == sorted(
        (entry.champion_fitness for entry in result.generations), reverse=True
    )


def test_identical_genomes_are_simulated_once(tmp_path: Path) -> None:
    tiny = task(tmp_path)
    fleet = Fleet([build(LAMP, CALIBRATION, ASSETS)], 0.02, 1)
    cases = draw_cases(np.random.default_rng(1), tiny, 1)
    stand, nod = genome("0", "0", "0"), genome("0", "0", "0.1")
    score = Trials(fleet, tiny, TERMINALS).score([stand, nod, stand, stand, nod], cases)
    assert fleet.steps == 2 * 300
    assert score.main[[0, 2, 3]].tolist() == [score.main[0]] * 3
    assert score.style[1] == score.style[4] != score.style[0]


def test_more_lanes_than_fit_at_once_give_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny = task(tmp_path, ("count = 1", "count = 3"))
    genomes = [genome("0", "0", str(value / 10)) for value in range(5)]
    whole = score_of(tiny, genomes)
    monkeypatch.setattr("robolamp.twin.lanes.fleet._LANES_AT_ONCE", 4)
    parts = score_of(tiny, genomes)
    assert whole.main.tolist() == parts.main.tolist()
    assert whole.style.tolist() == parts.style.tolist()


def test_tuning_is_deterministic_and_moves_only_constants(tmp_path: Path) -> None:
    tiny = task(tmp_path, ("fall = 2.0", "fall = 0.0"), ("posture = 0.33", "posture = 5.0"))
    start = genome("(* 0.5 1)", "(+ 0.4 (* 0 t))", "0.3")

    def tuned(genome: Genome, iterations: int) -> Genome:
        fleet = Fleet([build(LAMP, CALIBRATION, ASSETS)], 0.02, 2)
        (mean,) = tune(genome, Trials(fleet, tiny, TERMINALS), tiny, 1, iterations, 3, (), lambda *_: None)
        return mean

    once, twice = tuned(start, 12), tuned(start, 12)
    assert once == twice != start
    assert [str(part).count("(") for part in once] == [1, 2, 0]
    before, after = score_of(tiny, [start]), score_of(tiny, [once])
    assert after.style[0] < before.style[0]
    assert tuned(start, 0) == start
    assert tuned(genome("t", "t", "t"), 3) == genome("t", "t", "t")
    assert len(constants(once)) == len(constants(start))


def test_tuning_can_choose_from_the_best_it_tried_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    tiny = task(tmp_path, ("posture = 0.33", "posture = 5.0"), ("depth = 6", 'depth = 6\ntuned = "best"'))
    start = genome("0.5", "0.4", "0.3")
    seen: list[tuple[Genome, float]] = []
    told: list[list[float]] = []

    def note(_: int, genomes: Sequence[Genome], values: NDArray[np.float64]) -> None:
        told.append(fitness(values, 1.0).tolist())
        seen.extend(zip(genomes, told[-1], strict=True))

    def tuned(told: Sequence[Sequence[float]]) -> list[Genome]:
        fleet = Fleet([build(LAMP, CALIBRATION, ASSETS)], 0.02, 2)
        return tune(start, Trials(fleet, tiny, TERMINALS), tiny, 1, 4, 3, told, note)

    finalists = tuned(())
    best = sorted(seen, key=lambda each: each[1])[:12]
    assert finalists[1:] == [genome for genome, _ in best]
    assert finalists[0] not in finalists[1:]
    assert tuned(told[:3]) == finalists


def test_a_run_with_tuning_reports_each_iteration(tmp_path: Path) -> None:
    seen: list[Generation] = []
    result = run(task(tmp_path), tmp_path / "run", tuning=2, seed=6, progress=seen.append)
    stages = [("evolution", 0), ("evolution", 1), ("tuning", 0), ("tuning", 1)]
    assert [(entry.stage, entry.generation) for entry in seen] == stages
    assert [(line["stage"], line["generation"]) for line in told(tmp_path / "run")] == stages
    loaded = load_controller(result.controller, LAMP)
    assert loaded.provenance["tuning"] in (0, 2)  # kept only where it is better on cases that neither has seen
    assert loaded.scores["fitness"] == pytest.approx(result.best_fitness, abs=1e-6)


@pytest.mark.parametrize("wild", ["(* 1e300 1e300)", "(- (* 1e300 1e300) (* 1e300 1e300))", "1e300", "(% 1 (- t t))"])
def test_a_controller_that_returns_no_number_is_survived_and_scored(tmp_path: Path, wild: str) -> None:
    tiny = task(tmp_path, ("count = 1", "count = 2"))
    score = score_of(tiny, [genome(wild, wild, wild), genome("0", "0", "0")])
    assert np.isfinite(score.main).all()
    assert np.isfinite(score.style).all()
    seeded = [Controller("w", "", "position", 0.02, genome(wild, wild, wild), LAMP.names)]
    assert np.isfinite(run(tiny, tmp_path / "run", seeds=seeded).best_fitness)


def test_a_simulation_that_diverges_is_a_fall_and_not_a_lamp_that_stands(tmp_path: Path) -> None:
    tiny = task(tmp_path)
    fleet = Fleet([build(LAMP, CALIBRATION, ASSETS, Bend(strength=1e9))], 0.02, 1)
    trials = Trials(fleet, tiny, TERMINALS)
    score = trials.score([genome("(- 0.2 a0)", "0", "0")], draw_cases(np.random.default_rng(1), tiny, 1))
    assert fleet.steps < 300  # it ended where it diverged
    assert score.falls.tolist() == [1]
    assert score.main[0] >= 2.0  # what a fall costs in this task
    assert np.isfinite(score.style).all()


def test_a_population_of_one_is_its_seed(tmp_path: Path) -> None:
    alone = task(tmp_path, ("population = 12", "population = 1"), ("generations = 2", "generations = 1"))
    seeded = [Controller("s", "", "position", 0.02, genome("0.1", "0.1", "0.1"), LAMP.names)]
    result = run(alone, tmp_path / "run", seeds=seeded)
    assert load_controller(result.controller, LAMP).expressions == seeded[0].expressions
    assert result.generations[-1].individuals == 1
