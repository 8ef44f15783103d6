"""Studies: which runs each asks for.

The convergence studies of Gritz & Hahn (1997), section 4; those of EMOT (Kwasnicka & Wozniak), section 5.1; and trees
against genes on the hop. A study varies one parameter of the search over the points of a figure of its paper; every
point is run with the same seeds, and a seed draws the same fitness cases at every point. Studies of one task that meet
in a point share its runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from robolamp.assets import Assets
from robolamp.errors import RobolampError
from robolamp.evolve.tasks.task import Task, load_task

TASK = "luxo-1997"
"""The task of the 1997 paper's studies: its tableau."""
JUMPER = "jumper"
"""The task of EMOT's studies: its Table 2."""
HOP = "hop"
"""The task on which trees and genes meet."""
HERE = {TASK: "this lamp", JUMPER: "this Jumper", HOP: "this lamp"}
"""What verdicts are about, by task."""
OWN_GOAL = 0.30
"""The specific action's one goal [m]: "hopping forward 30 cm" (section 3.3)."""
_KEYS = {
    "population": "gp.population",
    "generations": "gp.generations",
    "selection": "gp.selection",
    "tournament": "gp.tournament",
    "crossover": "gp.crossover",
    "cases": "cases.count",
    "representation": "gp.representation",
    "head": "gp.gep.head",
}


@dataclass(frozen=True)
class Point:
    """One setting of genetic programming; the defaults are the paper's where a study does not vary them (section 4).

    Attributes:
        population: Individuals a generation, M.
        generations: Generations, G.
        selection: "tournament" or "proportionate".
        tournament: Individuals of a tournament; 6 where the paper does not say.
        crossover: Share of a new generation made by crossover, Pc; the rest is reproduction.
        cases: Number of goals, Nfc.
        goal: The one goal of a specific action [m]; None: goals are drawn from the task's range.
        representation: "tree" or "gep"; None: the task's.
        head: Length of a gene's head; None: the task's.
    """

    population: int = 300
    generations: int = 30
    selection: str = "tournament"
    tournament: int = 6
    crossover: float = 0.9
    cases: int = 3
    goal: float | None = None
    representation: str | None = None
    head: int | None = None

    @property
    def name(self) -> str:
        """What its runs' folders are called, but for the seed."""
        chosen = f"tournament{self.tournament}" if self.selection == "tournament" else self.selection
        action = "" if self.goal is None else f"-at{self.goal * 100:g}cm"
        way = "" if self.representation is None else f"-{self.representation}"
        bred = f"{way}-head{self.head}" if self.head else way or f"-pc{self.crossover * 100:g}"
        return f"m{self.population}-g{self.generations}-{chosen}{bred}-nfc{self.cases}{action}"

    def overrides(self) -> list[str]:
        """Return what it changes of the task, each as KEY=VALUE."""
        words = [f"{key}={value}" for name, key in _KEYS.items() if (value := getattr(self, name)) is not None]
        return words if self.goal is None else [*words, f"cases.low={self.goal}", f"cases.high={self.goal}"]


@dataclass(frozen=True)
class Study:
    """A figure or claim of the paper, and what is run for it.

    Attributes:
        name: As typed.
        title: What it is about.
        source: Where in the paper.
        axis: What its points are, for legends and tables.
        points: Its settings, by the value as typed, in the paper's order.
        small: The values that a small scale runs.
        varied: Keys of the task that are the study's own: `--set` may not change them.
        task: Whose runs they are.
        equal_steps: Whether runs are compared after as many physics steps, those of the shortest, not at their ends.
    """

    name: str
    title: str
    source: str
    axis: str
    points: Mapping[str, Point]
    small: tuple[str, ...]
    varied: frozenset[str] = field(default=frozenset())
    task: str = TASK
    equal_steps: bool = False


_ROBUST = Point(population=250, generations=30, crossover=0.8, cases=6)
_JUMPER = Point(population=100, generations=50, cases=1, representation="gep", head=10)
_HOP = Point(population=250, generations=30, crossover=0.8, cases=8)
_RUN = frozenset({"gp.population", "gp.generations", "gp.crossover", "cases.count", "cases.low", "cases.high"})
STUDIES: dict[str, Study] = {
    study.name: study
    for study in (
        Study(
            "population", "Population size", "Figure 5", "M",
            {str(m): Point(population=m, generations=35) for m in (10, 50, 100, 150, 200, 300, 400, 500, 600, 700)},
            ("50", "150", "200", "400"), frozenset({"gp.population"}),
        ),
        Study(
            "generations", "Number of generations", "Figure 6", "G",
            {str(g): Point(generations=g) for g in (10, 20, 30, 40, 50, 75, 100)},
            ("10", "30", "50"), frozenset({"gp.generations"}),
        ),
        Study(
            "selection", "Type of selection", "Figure 7", "selection",
            {"proportionate": Point(selection="proportionate")}
            | {str(size): Point(tournament=size) for size in (2, 4, 6, 10, 20)},
            ("proportionate", "2", "6", "20"), frozenset({"gp.selection", "gp.tournament"}),
        ),
        Study(
            "crossover", "Crossover rate", "Figure 8", "Pc [%]",
            {str(rate): Point(crossover=rate / 100) for rate in (0, 10, 50, 70, 80, 90, 100)},
            ("0", "10", "50", "90"), frozenset({"gp.crossover"}),
        ),
        Study(
            "tuned", "The tuned run against the first", "section 4, summary", "run",
            {"first": Point(population=400, generations=50, cases=6), "tuned": _ROBUST},
            ("first", "tuned"), _RUN,
        ),
        Study(
            "specific", "A controller for one action, on other distances", "section 3.3", "evolved for",
            {"specific": replace(_ROBUST, cases=1, goal=OWN_GOAL), "robust": _ROBUST},
            ("specific", "robust"), _RUN,
        ),
        Study(
            "distance", "The robust skill, beyond the distances it was evolved on", "section 3.6", "evolved for",
            {"robust": _ROBUST},
            ("robust",), _RUN,
        ),
        Study(
            "jumper", "Runs with the paper's parameters", "Figure 5", "h", {"10": _JUMPER}, ("10",),
            frozenset({"gp.gep.head", "gp.representation"}), JUMPER,
        ),
        Study(
            "head", "Length of the head", "section 5.1", "h",
            {str(head): replace(_JUMPER, head=head) for head in (3, 5, 10, 15, 20, 30, 50)},
            ("3", "10", "50"), frozenset({"gp.gep.head", "gp.representation"}), JUMPER,
        ),
        Study(
            "gep-population", "Population size", "section 5.1", "population",
            {str(m): replace(_JUMPER, population=m) for m in (10, 30, 50, 70, 100, 200, 300, 500, 1000, 2000)},
            ("10", "30", "100", "300"), frozenset({"gp.population", "gp.representation"}), JUMPER,
        ),
        Study(
            "representation", "Trees against genes", "own question", "written as",
            {name: replace(_HOP, representation=name) for name in ("tree", "gep")},
            ("tree", "gep"), frozenset({"gp.representation"}), HOP, equal_steps=True,
        ),
    )
}  # fmt: skip
"""Every study by name."""


def chosen_points(study: Study, text: str) -> tuple[str, ...]:
    """Return the points that `--points` picks: "paper" (all), "small", or values with commas between.

    Args:
        study: Of which study.
        text: What was typed.

    Raises:
        RobolampError: The study has no such point; the message lists those it has.
    """
    if text == "paper":
        return tuple(study.points)
    if text == "small":
        return study.small
    wanted = [word.strip() for word in text.split(",")]
    for word in wanted:
        if word not in study.points:
            known = ", ".join(study.points)
            raise RobolampError(f"{word!r} is not a point of {study.name}: {known} (or paper, small)", "--points")
    return tuple(name for name in study.points if name in wanted)


def settled(study: Study, name: str, assets: Assets, words: Sequence[str]) -> Point:
    """Return a study's point as it will be run: `--set` may change everything but what the study varies.

    Args:
        study: The study.
        name: Which of its points.
        assets: Where the task is.
        words: What `--set` changes of the task, each as KEY=VALUE.

    Raises:
        RobolampError: A word changes what the study varies, or no task comes of it.
    """
    for word in words:
        key = word.partition("=")[0].strip()
        if key in study.varied:
            raise RobolampError(f"{key} is what the study {study.name} varies; --points picks its values", "--set")
    point = study.points[name]
    fixed = [word for word in point.overrides() if word.partition("=")[0] in study.varied]
    task = load_task(assets, study.task, overrides=[*point.overrides(), *words, *fixed])
    gp = task.gp
    return Point(
        gp.population, gp.generations, gp.selection, gp.tournament, gp.crossover, task.cases.count, point.goal,
        point.representation and gp.representation, point.head and gp.gep.head,
    )  # fmt: skip


@dataclass(frozen=True)
class Order:
    """A run to be made.

    Attributes:
        point: Of which setting.
        seed: From which seed.
    """

    point: Point
    seed: int

    @property
    def name(self) -> str:
        """What its folder is called."""
        return f"{self.point.name}-s{self.seed}"

    def task(self, assets: Assets, words: Sequence[str], name: str = TASK) -> Task:
        """Return its task.

        Args:
            assets: Where tasks are.
            words: What `--set` changes of it.
            name: The task of its study.
        """
        return load_task(assets, name, overrides=[*words, *self.point.overrides()])


def orders(points: Iterable[Point], seeds: int) -> list[Order]:
    """Return the runs that points ask for, each once; all of one seed come before the next seed's.

    Args:
        points: Of any number of studies.
        seeds: How many seeds, from 1.
    """
    once = list(dict.fromkeys(points))
    return [Order(point, seed) for seed in range(1, seeds + 1) for point in once]
