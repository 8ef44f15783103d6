"""The studies of gene expression programming: what they run, and their rules on results of one's choice."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from robolamp.cli.main import main
from robolamp.evolve.study.claims import AGREES, DISAGREES, UNKNOWN
from robolamp.evolve.study.claims_gep import head, population, representation, success
from robolamp.evolve.study.plan import HOP, JUMPER, STUDIES, Order, settled
from robolamp.evolve.study.study_runs import Curve

from .parts import ASSETS


def seeds(value: float, spread: float = 0.01) -> list[float]:
    return [value - spread, value, value + spread]


def test_the_studies_are_the_papers() -> None:
    """EMOT, section 5.1."""
    assert [int(name) for name in STUDIES["head"].points] == [3, 5, 10, 15, 20, 30, 50]
    sizes = [10, 30, 50, 70, 100, 200, 300, 500, 1000, 2000]
    assert [int(name) for name in STUDIES["gep-population"].points] == sizes
    for name, value in (("head", "gp.gep.head"), ("gep-population", "gp.population"), ("jumper", "gp.gep.head")):
        study = STUDIES[name]
        assert (study.task, value in study.varied) == (JUMPER, True)
        for text in study.points:
            point = settled(study, text, ASSETS, ())
            gp = Order(point, 1).task(ASSETS, (), study.task).gp
            assert (gp.representation, gp.generations, gp.tournament) == ("gep", 50, 6)
            assert gp.gep.head == (int(text) if name == "head" else 10)
            assert gp.population == (int(text) if name == "gep-population" else 100)
    # What the three have in common is run once.
    shared = {settled(STUDIES[name], point, ASSETS, ()) for name, point in
              (("jumper", "10"), ("head", "10"), ("gep-population", "100"))}  # fmt: skip
    assert [Order(point, 4).name for point in shared] == ["m100-g50-tournament6-gep-head10-nfc1-s4"]


def test_trees_and_genes_meet_on_the_same_task() -> None:
    study = STUDIES["representation"]
    tasks = {name: Order(settled(study, name, ASSETS, ()), 1).task(ASSETS, (), HOP) for name in study.points}
    assert {name: task.gp.representation for name, task in tasks.items()} == {"tree": "tree", "gep": "gep"}
    assert len({(task.cases, task.seeds, task.gp.population, task.signals) for task in tasks.values()}) == 1


@pytest.mark.parametrize(
    ("medians", "verdicts"),
    [
        ({"3": 1.4, "10": 0.2, "15": 0.2, "50": 1.3}, (AGREES, AGREES)),
        ({"3": 0.2, "10": 0.2, "15": 0.2, "50": 0.2}, (DISAGREES, DISAGREES)),
        ({"3": 1.4, "10": 0.4, "20": 0.1, "50": 1.3}, (DISAGREES, AGREES)),
        ({"3": 1.4, "10": 0.4, "50": 0.4}, (AGREES, DISAGREES)),
        ({"3": 1.4, "50": 0.4}, (UNKNOWN, UNKNOWN)),
        ({}, (UNKNOWN, UNKNOWN)),
    ],
)
def test_the_rule_for_heads(medians: dict[str, float], verdicts: tuple[str, str]) -> None:
    found = head({name: seeds(value) for name, value in medians.items()})
    assert tuple(each.verdict for each in found) == verdicts


@pytest.mark.parametrize(
    ("medians", "verdicts"),
    [
        ({"10": 1.0, "50": 0.9, "100": 0.2, "300": 0.2, "2000": 0.22}, (AGREES, AGREES)),
        ({"10": 1.0, "50": 0.2, "100": 0.2, "300": 0.2}, (DISAGREES, AGREES)),
        ({"10": 1.0, "100": 0.6, "300": 0.2}, (AGREES, DISAGREES)),
        ({"70": 1.0, "300": 0.2}, (UNKNOWN, UNKNOWN)),
    ],
)
def test_the_rule_for_populations(medians: dict[str, float], verdicts: tuple[str, str]) -> None:
    found = population({name: seeds(value) for name, value in medians.items()})
    assert tuple(each.verdict for each in found) == verdicts


def test_one_seed_tells_nothing_of_fitness() -> None:
    for rule, points in ((head, ("3", "10", "50")), (population, ("50", "100")), (representation, ("tree", "gep"))):
        assert {each.verdict for each in rule({name: [0.1] for name in points})} == {UNKNOWN}


@pytest.mark.parametrize(("gep", "verdict"), [(0.5, AGREES), (0.2, AGREES), (0.9, DISAGREES)])
def test_the_rule_for_representations(gep: float, verdict: str) -> None:
    assert representation({"tree": seeds(0.5), "gep": seeds(gep)})[0].verdict == verdict


@pytest.mark.parametrize(
    ("runs", "verdict"), [([True] * 10, AGREES), ([True] * 9, UNKNOWN), ([True] * 11 + [False], DISAGREES)]
)
def test_the_rule_for_success(runs: Sequence[bool], verdict: str) -> None:
    found = success({"10": runs})[0]
    assert (found.verdict, found.figures) == (verdict, f"{sum(runs)} of {len(runs)} runs succeeded.")


def test_a_run_after_some_physics_steps_is_what_it_was_then() -> None:
    fitness = np.array([3.0, 2.0, 1.0])
    curve = Curve(np.array([10, 20, 30]), fitness, fitness, fitness, np.array([100, 150, 400]))
    assert curve.after(np.array([100, 149, 150, 399, 400])).champion.tolist() == [3.0, 3.0, 2.0, 2.0, 1.0]
    assert curve.after(np.array([100, 399])).final == 2.0


def test_a_study_of_jumper_and_one_of_the_hop_are_run_and_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quick = ["--set", "duration=0.2", "--set", "gp.generations=2", "--set", "gp.population=4", "--workers", "1"]
    hop = ["--set", "cases.count=1", "--set", "cases.lamps=1"]
    for words, picture in (
        (["head", "--points", "3,10", "--seeds", "2", *quick], "head.png"),
        (["representation", "--seeds", "1", *quick, *hop], "representation.png"),
    ):
        with pytest.raises(SystemExit, match="0"):
            main(["study", *words, "-o", str(tmp_path), "--json"])
        told = json.loads(capsys.readouterr().out)
        assert (told["runs"], told["finished"]) == ((4, 4) if "head" in words else (2, 2))
        assert [Path(path).name for path in told["pictures"]] == [picture]
        page = Path(told["report"]).read_text()
        assert all(each["claim"] in page for each in told["verdicts"])
        assert "Rule: " in page
    runs = sorted(path.name for path in (tmp_path / JUMPER).iterdir() if path.is_dir())
    assert runs[0] == "m4-g2-tournament6-gep-head10-nfc1-s1"
