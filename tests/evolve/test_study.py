"""Which runs the studies ask for, the folder that keeps them, and the report made from it."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from robolamp.controller.controller_file import Controller
from robolamp.controller.expression import parse
from robolamp.errors import FileError, RobolampError
from robolamp.evolve.study.plan import STUDIES, TASK, Order, Point, chosen_points, orders, settled
from robolamp.evolve.study.study_report import Reporter
from robolamp.evolve.study.study_runs import Scale, Shelf
from robolamp.evolve.study.unseen_goals import BEYOND, WITHIN, Tried, try_goals

from . import made_up
from .parts import ASSETS, CALIBRATION, LAMP


def all_points(name: str) -> dict[str, Point]:
    return {point: settled(STUDIES[name], point, ASSETS, ()) for point in STUDIES[name].points}


def test_the_studies_are_the_papers() -> None:
    """Gritz & Hahn 1997, section 4."""
    assert [int(name) for name in STUDIES["population"].points] == [10, 50, 100, 150, 200, 300, 400, 500, 600, 700]
    assert [int(name) for name in STUDIES["generations"].points] == [10, 20, 30, 40, 50, 75, 100]
    assert list(STUDIES["selection"].points) == ["proportionate", "2", "4", "6", "10", "20"]
    assert [int(name) for name in STUDIES["crossover"].points] == [0, 10, 50, 70, 80, 90, 100]
    for name, point in all_points("population").items():
        assert point == Point(int(name), 35, "tournament", 6, 0.9, 3)
    for name, point in all_points("generations").items():
        assert point == Point(300, int(name), "tournament", 6, 0.9, 3)
    for name, point in all_points("crossover").items():
        assert point == Point(300, 30, "tournament", 6, int(name) / 100, 3)
    selection = all_points("selection")
    assert selection.pop("proportionate") == Point(300, 30, "proportionate", 6, 0.9, 3)
    assert {name: point.tournament for name, point in selection.items()} == {str(n): n for n in (2, 4, 6, 10, 20)}
    assert {replace(point, tournament=6) for point in selection.values()} == {Point(300, 30, "tournament", 6, 0.9, 3)}
    first, tuned = all_points("tuned").values()
    assert (first, tuned) == (Point(400, 50, crossover=0.9, cases=6), Point(250, 30, crossover=0.8, cases=6))
    assert tuned.population * tuned.generations == 0.375 * first.population * first.generations


def test_runs_that_studies_share_are_made_once_and_have_the_same_seeds() -> None:
    points = [point for name in STUDIES if STUDIES[name].task == TASK for point in all_points(name).values()]
    found = orders(points, 3)
    assert len({order.name for order in found}) == len(found) == 3 * len(set(points))
    # M = 300, G = 30, tournament 6, 90 % is in three figures; the tuned run in three claims.
    assert len(set(points)) == len(points) - 2 - 2
    assert [order.seed for order in found] == sorted(order.seed for order in found)
    assert {order.point for order in found if order.seed == 3} == set(points)
    assert Order(Point(selection="proportionate"), 2).name == "m300-g30-proportionate-pc90-nfc3-s2"


def test_a_task_is_the_papers_with_the_points_settings() -> None:
    order = Order(STUDIES["specific"].points["specific"], 1)
    task = order.task(ASSETS, ["timestep=0.004"])
    assert (task.name, task.timestep, task.cases.count, task.cases.low, task.cases.high) == (
        "luxo-1997",
        0.004,
        1,
        0.3,
        0.3,
    )
    assert (task.gp.population, task.gp.generations, task.gp.crossover) == (250, 30, 0.8)
    assert (task.gp.subtree_mutation, task.gp.point_mutation, task.gp.constant_mutation) == (0, 0, 0)
    assert Order(Point(crossover=1.0, selection="proportionate"), 1).task(ASSETS, ()).gp.selection == "proportionate"


def test_points_are_picked_in_the_papers_order() -> None:
    study = STUDIES["population"]
    assert chosen_points(study, " 400,50 ") == ("50", "400")
    assert chosen_points(study, "paper") == tuple(study.points)
    for each in STUDIES.values():
        small = chosen_points(each, "small")
        assert set(small) <= set(each.points)
        assert len(small) >= min(3, len(each.points))
    for wrong in ("", "25", "50;100", "50,"):
        with pytest.raises(RobolampError, match=r"--points: .* is not a point of population: 10, 50, .*700"):
            chosen_points(study, wrong)


def test_what_a_study_does_not_vary_may_be_set() -> None:
    tiny = settled(STUDIES["selection"], "2", ASSETS, ["gp.population=5", "cases.count=1", "duration=0.3"])
    assert tiny == Point(5, 30, "tournament", 2, 0.9, 1)
    for name, word in (
        ("selection", "gp.tournament=3"),
        ("crossover", "gp.crossover=0.5"),
        ("tuned", "gp.population=9"),
    ):
        study = STUDIES[name]
        with pytest.raises(RobolampError, match=f"is what the study {name} varies; --points picks its values"):
            settled(study, next(iter(study.points)), ASSETS, [word])
    for word in ("gp.population=zero", "gp.popul=5", "gp.population", "duration=1e9"):
        with pytest.raises(RobolampError):
            settled(STUDIES["selection"], "2", ASSETS, [word])


def test_a_folder_holds_runs_of_one_scale(tmp_path: Path) -> None:
    shelf = made_up.shelf(tmp_path, "timestep=0.004", "duration=3")
    again = Shelf(tmp_path)
    again.claim(Scale.of(ASSETS, LAMP, CALIBRATION, ("duration=3", "timestep=0.004")))  # in any order
    assert again.scale() == shelf.scale()
    before = (tmp_path / "luxo-1997" / "scale.json").read_bytes()
    with pytest.raises(FileError, match=r"made with --set duration=3 timestep=0\.004, not \(nothing\): .* another -o"):
        again.claim(Scale.of(ASSETS, LAMP, CALIBRATION, ()))
    other = replace(CALIBRATION, hash="0" * 64)
    with pytest.raises(FileError, match=r"another luxo-1997\.toml, calibration or lamp"):
        again.claim(Scale.of(ASSETS, LAMP, other, ("duration=3", "timestep=0.004")))
    assert (tmp_path / "luxo-1997" / "scale.json").read_bytes() == before
    for damage in ("", "[]", "{}", "not JSON"):
        (tmp_path / "luxo-1997" / "scale.json").write_text(damage)
        with pytest.raises(FileError, match="is not the note of settings"):
            again.scale()


def test_only_finished_runs_have_a_curve(tmp_path: Path) -> None:
    shelf, point = made_up.shelf(tmp_path), Point(population=5, generations=4)
    assert shelf.curve(Order(point, 1)) is None
    made_up.run(shelf, point, 1, final=0.4)
    curve = shelf.curve(Order(point, 1))
    assert curve is not None
    assert curve.individuals.tolist() == [5, 10, 15, 20]
    assert curve.final == pytest.approx(0.4)
    np.testing.assert_allclose(curve.as_run, 0.9 * curve.whole)
    # Killed in various places.
    folder = made_up.run(shelf, point, 2, stage="evolution")
    assert shelf.curve(Order(point, 2)) is None
    made_up.run(shelf, point, 12)
    lines = (folder / "progress.jsonl").read_text().splitlines(keepends=True)
    (folder / "checkpoint.json").write_text('{"stage": "done"}')
    (folder / "progress.jsonl").write_text("".join(lines[:3]))
    assert shelf.curve(Order(point, 2)) is None
    assert shelf.generations(Order(point, 2)) == 3
    assert list(shelf.curves(point)) == [1, 12]
    assert list(shelf.curves(replace(point, population=55))) == []


@pytest.mark.parametrize("line", ["", "nonsense", "[]", "{}", '{"individuals": "many"}'])
def test_a_damaged_course_is_named_with_its_line(tmp_path: Path, line: str) -> None:
    shelf, point = made_up.shelf(tmp_path), Point(population=5, generations=2)
    path = made_up.run(shelf, point, 1) / "progress.jsonl"
    path.write_text(path.read_text().splitlines()[0] + "\n" + line + "\n")
    with pytest.raises(FileError, match=r"progress\.jsonl: line 2 is no generation of a run"):
        shelf.curve(Order(point, 1))


def reporter(shelf: Shelf) -> Reporter:
    scale = shelf.scale()
    assert scale is not None
    return Reporter(shelf, scale, LAMP, CALIBRATION, ASSETS, 1)


def test_a_report_of_made_up_runs(tmp_path: Path) -> None:
    shelf = made_up.shelf(tmp_path / "runs")
    points = all_points("population")
    for name, final in (("50", 1.2), ("150", 1.1), ("300", 0.5), ("700", 0.48)):
        for seed in (1, 2, 3):
            made_up.run(shelf, points[name], seed, final + 0.01 * seed)
    page = tmp_path / "docs" / "report.md"
    report = reporter(shelf).write(page, {"population": points}, ["robolamp study population --seeds 3"])
    assert [verdict.verdict for verdict in report.verdicts] == ["agrees", "agrees"]
    [picture] = report.pictures
    with Image.open(picture) as image:
        assert (image.format, image.size) == ("PNG", (1200, 520))
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 20)}
    assert {(68, 1, 84)} < colours  # the first of viridis: a curve is drawn
    rows = list(csv.DictReader(io.StringIO((tmp_path / "docs" / "report" / "population.csv").read_text())))
    assert len(rows) == 4 * 3 * 35
    last = rows[34]
    assert (last["point"], last["seed"], last["individuals"], float(last["champion"])) == ("50", "1", "1750", 1.21)
    text = page.read_text()
    assert "![Population size](report/population.png)" in text
    assert "| 50 | 3 | 1.220 | 1.210 | 1.230 | 1.098 | 1,750 | 0.0 |" in text
    assert "Not run here: M 10, 100, 200, 400, 500, 600." in text
    assert "| Populations under 200 do not converge to good fitness. (Figure 5) | agrees |" in text
    assert "Rule: each population below 200 is clearly worse" in text
    assert "`duration=0.5`, `timestep=0.004`" in text
    assert "robolamp study population --seeds 3\n" in text
    again = (page.read_bytes(), picture.read_bytes())
    reporter(shelf).write(page, {"population": points}, ["robolamp study population --seeds 3"])
    assert (page.read_bytes(), picture.read_bytes()) == again


def test_a_report_without_runs_says_so(tmp_path: Path) -> None:
    shelf = made_up.shelf(tmp_path / "runs")
    report = reporter(shelf).write(
        tmp_path / "r.md", {name: all_points(name) for name in STUDIES}, ["robolamp study all"]
    )
    assert report.pictures == ()
    assert {verdict.verdict for verdict in report.verdicts} == {"cannot tell"}
    assert {verdict.study for verdict in report.verdicts} == set(STUDIES)
    text = report.path.read_text()
    assert "Not run here: G 10, 20, 30, 40, 50, 75, 100." in text
    assert "png" not in text


def test_a_report_tries_champions_on_other_goals(tmp_path: Path) -> None:
    shelf = made_up.shelf(tmp_path / "runs")
    points = {name: all_points(name) for name in ("specific", "distance")}
    for point in points["specific"].values():
        for seed in (1, 2):
            made_up.run(shelf, point, seed)
    report = reporter(shelf).write(tmp_path / "r.md", points, ["robolamp study specific"])
    assert [path.name for path in report.pictures] == ["specific.png", "distance.png"]
    rows = list(csv.DictReader(io.StringIO((tmp_path / "r" / "distance.csv").read_text())))
    assert len(rows) == 2 * (56 + 12)
    assert {(row["goal_m"], row["time_s"]) for row in rows} >= {("0.6", "0.5"), ("1.2", "1")}
    assert all(abs(float(row["error_m"]) + float(row["goal_m"])) < 0.01 for row in rows)  # they stand still
    assert "| robust | 1 | 65 to 120 | 0 of 12 | 0 of 12 | 0 of 12 | 0 | 1.00 |" in report.path.read_text()


def test_goals_are_tried_in_the_time_that_their_distance_deserves() -> None:
    task = Order(Point(), 1).task(ASSETS, ["duration=0.6", "timestep=0.004"])
    still = Controller("still", "", "position", 0.02, tuple(parse("0", ()) for _ in range(3)), LAMP.names)
    fallen = replace(still, expressions=tuple(parse(text, ()) for text in ("0.6", "(- 0 1)", "0")))
    first, second = try_goals([still, fallen], task, LAMP, CALIBRATION, ASSETS, beyond=True, workers=1)
    np.testing.assert_allclose(first.goal, np.concatenate([WITHIN, BEYOND]))
    np.testing.assert_allclose(first.time, 0.6 * np.maximum(first.goal, 0.6) / 0.6)
    np.testing.assert_allclose(first.error, -first.goal, atol=0.01)
    assert not first.fell.any()
    assert second.fell.all()


def test_arriving_means_ending_there_upright() -> None:
    goal = np.array([0.05, 0.10, 0.30, 0.60, 0.60, 1.0])
    error = np.array([0.014, 0.016, -0.029, 0.061, 0.0, 0.09])
    fell = np.array([False, False, False, False, True, False])
    hits = np.ones(6, bool)  # a lamp that passes through came within 1.5 cm, and did not arrive
    tried = Tried(goal, np.ones(6), error, fell, hits, hits)
    assert tried.arrives.tolist() == [True, False, True, False, False, True]
    shares = tried.shares()
    assert (shares.within, shares.beyond, shares.own) == (0.4, 1.0, True)
    assert np.isnan(Tried(*(values[:5] for values in vars(tried).values())).shares().beyond)
