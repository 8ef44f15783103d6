"""Tasks: what to evolve, one TOML file each in sim/tasks/."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from robolamp.assets import Assets
from robolamp.controller.terminals import all_terminals, on_board_terminals
from robolamp.evolve.fitness import terms
from robolamp.files import Table, read_text, read_toml


@dataclass(frozen=True)
class Cases:
    """Which goals a controller is tried on.

    Attributes:
        count: Number of goals.
        low: Smallest [m].
        high: Largest [m].
        spacing: Smallest distance between two [m].
        lamps: How many lamps each is tried on: the calibrated one, and others drawn from the spread.
    """

    count: int
    low: float
    high: float
    spacing: float
    lamps: int


@dataclass(frozen=True)
class Settings:
    """Parameters of genetic programming (Koza 1992, Table 27.1; Gritz & Hahn 1997, Table 1).

    Attributes:
        population: Individuals a generation (M).
        generations: Generations (G).
        tournament: Individuals of a tournament.
        crossover: Share of a new generation made by crossover.
        mutation: Share made by mutating constants; the rest is reproduction.
        depth_at_birth: Smallest and largest depth of trees in the first generation.
        depth: Largest depth of any tree.
    """

    population: int
    generations: int
    tournament: int
    crossover: float
    mutation: float
    depth_at_birth: tuple[int, int]
    depth: int


@dataclass(frozen=True)
class Task:
    """What to evolve.

    Attributes:
        name: The task's name.
        control_period: Time between evaluations of a controller [s].
        duration: Length of a trial [s].
        signals: "on-board" or "all".
        constants: Range that constants are drawn from.
        seeds: Controllers (files or shipped names) that the first generation begins with.
        cases: Which goals.
        main: Weights of the main fitness terms.
        style: Weights of the style terms, phased in over the run.
        gp: Parameters of genetic programming.
        source: The file's text.
    """

    name: str
    control_period: float
    duration: float
    signals: str
    constants: tuple[float, float]
    seeds: tuple[str, ...]
    cases: Cases
    main: Mapping[str, float]
    style: Mapping[str, float]
    gp: Settings
    source: str

    def terminals(self, joints: int) -> tuple[str, ...]:
        """Return the terminals a controller for this task may read."""
        return on_board_terminals(joints) if self.signals == "on-board" else all_terminals(joints)


def _weights(table: Table) -> dict[str, float]:
    known = terms()
    weights = {}
    for name in table.names():
        if name not in known:
            raise table.fail(name, f"unknown fitness term; expected one of {', '.join(known)}")
        weights[name] = table.number(name, 0.0, 1000.0)
    return weights


def _pair(table: Table, key: str, low: float, high: float) -> tuple[float, float]:
    values = table.array(key)
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if len(values) != 2 or not numbers or not low <= values[0] < values[1] <= high:
        raise table.fail(key, f"{values!r} is not two rising numbers from {low:g} to {high:g}")
    return float(values[0]), float(values[1])


def _names(table: Table, key: str) -> tuple[str, ...]:
    names = table.array(key, default=[])
    if not all(isinstance(name, str) for name in names):
        raise table.fail(key, f"{names!r} is not an array of controllers' names or files")
    return tuple(names)


def load_task(assets: Assets, name: str | Path) -> Task:
    """Read a task file.

    Args:
        assets: Where to look.
        name: A path, or the name of a file in sim/tasks/.

    Raises:
        FileError: The file is missing or malformed; the message names the key and what was expected.
    """
    path = assets.named(name, "sim/tasks", "task", exclude=("spread",))
    root = Table(read_toml(path), str(path))
    root.integer("schema", 1, 1)
    cases, gp = root.table("cases"), root.table("gp")
    crossover = gp.number("crossover", 0.0, 1.0)
    shortest, tallest = _pair(gp, "depth_at_birth", 1, 17)
    if not shortest.is_integer() or not tallest.is_integer():
        raise gp.fail("depth_at_birth", f"[{shortest:g}, {tallest:g}] is not two whole numbers")
    low = cases.number("low", 0.001, 100.0, "m")
    task = Task(
        name=root.text("name"),
        control_period=root.number("control_period", 0.002, 0.1, "s"),
        duration=root.number("duration", 0.1, 600.0, "s"),
        signals=root.text("signals", ("on-board", "all")),
        constants=_pair(root, "constants", -1e6, 1e6),
        seeds=_names(root, "seeds"),
        cases=Cases(
            count=cases.integer("count", 1, 1000),
            low=low,
            high=cases.number("high", low, 100.0, "m"),
            spacing=cases.number("spacing", 0.0, 100.0, "m"),
            lamps=cases.integer("lamps", 1, 1000),
        ),
        main=_weights(root.table("main")),
        style=_weights(root.table("style")),
        gp=Settings(
            population=gp.integer("population", 2, 100_000),
            generations=gp.integer("generations", 1, 100_000),
            tournament=gp.integer("tournament", 1, 1000),
            crossover=crossover,
            mutation=gp.number("mutation", 0.0, 1.0 - crossover, default=0.0),
            depth_at_birth=(int(shortest), int(tallest)),
            depth=gp.integer("depth", int(tallest), 100),
        ),
        source=read_text(path),
    )
    for table in (root, cases, gp):
        table.done()
    return task
