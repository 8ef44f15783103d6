from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robolamp.controller.controller_file import load_controller
from robolamp.errors import FileError, RobolampError
from robolamp.evolve.evolution import evolve, resume
from robolamp.evolve.tasks.fitness import HOPELESS, terms, weighted
from robolamp.evolve.tasks.fitness_cases import poisson_disk_plane
from robolamp.evolve.tasks.task import Task, load_task
from robolamp.figure import Figure, load_figure
from robolamp.twin.judges.figure_judge import FigureOutcome

from .parts import ASSETS, CALIBRATION, LAMP

LANES = 2
SHORT = ("duration=0.3", "gp.population=6", "gp.generations=3", "gp.representation=tree")


def jumper(*overrides: str) -> Task:
    return load_task(ASSETS, "jumper", overrides=(*SHORT, *overrides))


def outcome(**changed: object) -> FigureOutcome:
    """Two lanes that stand at their goals."""
    zero, never = np.zeros(LANES), np.full(LANES, np.nan)
    still = FigureOutcome(
        goal=np.ones(LANES), direction=zero, duration=np.full(LANES, 20.0), error=zero, nearest=zero, arrival=zero,
        idle=zero, collision=never, tilt=zero, angles=np.zeros((LANES, 4)), velocities=np.zeros((LANES, 4)), hops=zero,
        aloft=zero, flight_gain=zero, goal_moved=zero, goal_pulled=zero,
        unstable=np.zeros(LANES, bool), within=np.full(LANES, 0.05), upright_tilt=np.full(LANES, 0.26),
        interventions=np.zeros(LANES, np.int64),
    )  # fmt: skip
    return replace(still, **{name: np.array(value) for name, value in changed.items()})


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, [0.0, 0.0]),
        ({"error": [0.25, 2.0]}, [0.25, 2.0]),
        ({"idle": [5.0, 20.0]}, [0.33 * 0.25, 0.33]),
        ({"angles": [[0.1, -0.2, 0.0, 0.1], [2.0, 0.0, 0.0, 0.0]]}, [0.33 * 0.4, 0.33]),
        ({"velocities": [[-0.5, 0.0, 0.0, 0.1], [0.0, 0.0, 9.0, 0.0]]}, [0.33 * 0.6, 0.33]),
        ({"collision": [0.5, np.nan], "idle": [20.0, 20.0], "angles": np.ones((2, 4))}, [1.0, 0.66]),
        ({"error": [np.nan, 0.0], "unstable": [True, False]}, [HOPELESS, 0.0]),
    ],
)
def test_fitness_is_the_papers_pseudocode(changed: dict[str, object], expected: list[float]) -> None:
    """Pseudocode 3 at full phase: distance + style, where a collision is 1 instead of timing, angles and velocities."""
    task = jumper()
    found = weighted(outcome(**changed), {**task.main, **task.style})
    assert found == pytest.approx(expected)


def test_madzia_is_judged_by_distance_and_trunk_alone() -> None:
    for name, more in (("madzia", {}), ("madzia-heavy-box", {}), ("madzia-light", {"tilt": 1.0})):
        task = load_task(ASSETS, name)
        assert dict(task.main) == {"distance": 1.0, "collision": 1.0, **more}
        assert not task.style


def test_tilt_is_a_share_of_upside_down() -> None:
    assert weighted(outcome(tilt=[np.pi / 2, np.pi]), {"tilt": 2.0}) == pytest.approx([1.0, 2.0])


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("figure=cat", r"figure: 'cat' is not one of lamp, jumper, spider"),
        ("figure=lamp", r"drive: 'velocity' is not one of position"),
        (
            'signals=["t", "k4"]',
            r"signals: 'k4': jumper has 4 joints, k0 to k3 \(bearing, lower_leg, upper_leg, head\)",
        ),
        ('signals=["a0"]', r"signals: unknown 'a0'; expected some of t k0 k1 k2 k3 Obase.px"),
        ("signals=on-board", r"signals: 'on-board' is not one of all"),
        ("drive=force", r"drive: 'force' is not one of position, velocity"),
        ("main.shuffle=1", r"main.shuffle: is no term of jumper's; expected one of distance"),
        ("main.nonsense=1", r"main.nonsense: unknown fitness term"),
        ("cases.direction=[1, 0]", r"cases.direction: \[1, 0\] is not two directions from -pi to pi"),
        ("cases.lamps=3", r"cases.lamps: 3 is not a whole number from 1 to 1"),
        ("cases.goal_time=[1, 2]", r"cases.goal_time: is for the lamp alone; the task's figure is jumper"),
        ("pole={height=0.2, x=0.2}", r"pole: is for the lamp alone; the task's figure is jumper"),
        ("world.goal_mass=1", r"world.goal_mass: no body stands at the goal of jumper"),
        ("world.strength=-1", r"world.strength: -1 is not a number from 0.01 to 100"),
    ],
)
def test_task_that_asks_a_figure_for_what_it_has_not_is_refused(override: str, message: str) -> None:
    with pytest.raises(FileError, match=message) as caught:
        jumper(override)
    assert "jumper.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("override", ["cases.direction=[0, 1]", "world.mass=2", "drive=velocity"])
def test_lamp_is_not_asked_for_what_figures_have(override: str) -> None:
    with pytest.raises(FileError, match=override.split("=", maxsplit=1)[0].split(".", maxsplit=1)[0]):
        load_task(ASSETS, "hop", overrides=[override])


def test_tasks_ask_for_their_worlds() -> None:
    light, heavy = (load_task(ASSETS, name).world for name in ("madzia-light", "madzia-heavy-box"))
    assert (light.mass, light.goal_mass) == (0.35, 20.0)
    assert (heavy.mass, heavy.goal_mass) == (1.0, 20.0)


def test_points_lie_in_their_ring_apart() -> None:
    points = poisson_disk_plane(np.random.default_rng(1), 12, (0.5, 1.5), (-1.0, 2.0), 0.3)
    assert points.shape == (12, 2)
    assert (points[:, 0] >= 0.5).all()
    assert (points[:, 0] <= 1.5).all()
    assert (points[:, 1] >= -1.0).all()
    assert (points[:, 1] <= 2.0).all()
    places = points[:, 0] * np.exp(1j * points[:, 1])
    gaps = np.abs(places[:, None] - places) + np.eye(12)
    assert gaps.min() >= 0.3
    np.testing.assert_array_equal(
        points, poisson_disk_plane(np.random.default_rng(1), 12, (0.5, 1.5), (-1.0, 2.0), 0.3)
    )


def test_points_that_do_not_fit_are_refused() -> None:
    with pytest.raises(RobolampError, match=r"2 goals 1 m apart do not fit 0.1 to 0.2 m away, from 0 to 1 rad"):
        poisson_disk_plane(np.random.default_rng(1), 2, (0.1, 0.2), (0.0, 1.0), 1.0)


def test_run_writes_a_controller_for_its_figure_and_goes_on_after_a_stop(tmp_path: Path) -> None:
    class Stopped(Exception):
        pass

    def stop(entry: object) -> None:
        if getattr(entry, "generation", 0) == 1:
            raise Stopped

    task = jumper("cases.count=2", "cases.direction=[-3, 3]")
    whole = evolve(task, LAMP, CALIBRATION, ASSETS, tmp_path / "whole", seed=5, workers=1)
    with pytest.raises(Stopped):
        evolve(task, LAMP, CALIBRATION, ASSETS, tmp_path / "cut", seed=5, workers=2, progress=stop)
    again = resume(tmp_path / "cut", workers=2)
    assert again.best_fitness == whole.best_fitness
    figure = load_figure(ASSETS, "jumper")
    first, second = (load_controller(result.controller, figure) for result in (whole, again))
    assert first.expressions == second.expressions
    assert (first.figure, first.drive, first.task) == ("jumper", "velocity", "jumper")
    assert "figure_sha256" in first.provenance
    assert not [key for key in first.provenance if key.startswith("calibration")]  # which is the lamp's
    assert "calibration" not in (tmp_path / "cut" / "run.toml").read_text()
    with pytest.raises(FileError, match=r"figure: drives 'jumper'; expected a controller for 'lamp'"):
        load_controller(whole.controller, LAMP)


def test_what_is_reused_changes_no_result(tmp_path: Path) -> None:
    task = jumper("duration=0.2", "gp.population=12")
    both = [
        evolve(task, LAMP, CALIBRATION, ASSETS, tmp_path / str(reuse), seed=2, workers=1, reuse=reuse)
        for reuse in (True, False)
    ]
    assert both[0].best_fitness == both[1].best_fitness
    assert isinstance(task.figure, Figure)
    first, second = (load_controller(result.controller, task.figure).expressions for result in both)
    assert first == second


def test_every_term_of_a_figure_is_known() -> None:
    assert {"collision", "idle", "angles", "velocities", "tilt"} <= set(terms())
