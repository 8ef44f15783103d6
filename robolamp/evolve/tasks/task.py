"""Tasks: what to evolve, one TOML file each in sim/tasks/."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from robolamp.assets import Assets
from robolamp.controller.terminals import OPTIONAL, TWIN_ONLY, all_terminals, figure_terminals, terminals_of
from robolamp.errors import FileError, RobolampError
from robolamp.evolve.tasks.fitness import NEEDS, terms, terms_of
from robolamp.evolve.tasks.gep_settings import GepSettings, read_gep
from robolamp.figure import DRIVES, LAMP, POINT, Driven, Figure, figures, load_figure
from robolamp.files import MOST_TOML, Table, parse_toml, read_text, shown
from robolamp.twin.figure_model import World
from robolamp.twin.judges.key_poses import KeyPose
from robolamp.twin.lamp_model import Pole

REPRESENTATIONS = ("tree", "gep")
"""Ways to write an individual down: trees (Koza), or genes (Ferreira); see `robolamp.evolve.representations`."""
SELECTIONS = ("tournament", "proportionate", "lexicase", "pareto")
"""Ways to choose parents; see `robolamp.evolve.selection`."""
TUNED = ("mean", "best")
"""What tuning may choose from; see `robolamp.evolve.tune`."""
_CROSSOVER, _DEPTH_AT_BIRTH, _DEPTH = 0.9, (2.0, 6.0), 17  # of trees, unless given (Koza 1992, Table 27.1)
_SIGNALS = ("on-board", "all")


@dataclass(frozen=True)
class Cases:
    """Which goals a controller is tried on.

    Attributes:
        count: Number of goals.
        low: Smallest [m].
        high: Largest [m].
        spacing: Smallest distance between two [m].
        lamps: How many lamps each is tried on: the calibrated one, and others drawn from the spread.
        spread: Which spread, a file or the name of one in sim/tasks/.
        fresh: Drawn anew each generation, instead of once a run.
        goal_time: Smallest and largest time commanded for the way [s]; None: none is.
        direction: Smallest and largest direction of a figure's goals, from x towards y [rad]; the lamp's are ahead.
    """

    count: int
    low: float
    high: float
    spacing: float
    lamps: int
    spread: str
    fresh: bool
    goal_time: tuple[float, float] | None
    direction: tuple[float, float]


@dataclass(frozen=True)
class Settings:
    """Parameters of genetic programming (Koza 1992, Table 27.1; Gritz & Hahn 1997, Table 1).

    Attributes:
        representation: One of `REPRESENTATIONS`; shares, depths and nodes are for trees, `gep` is for genes.
        population: Individuals a generation (M).
        generations: Generations (G).
        selection: How parents are chosen, one of `SELECTIONS`.
        tournament: Individuals of a tournament.
        crossover: Share of a new generation made by crossover ...
        subtree_mutation: ... by growing a new subtree ...
        point_mutation: ... by replacing single nodes ...
        constant_mutation: ... by moving constants; the rest is reproduction.
        depth_at_birth: Smallest and largest depth of trees in the first generation.
        depth: Largest depth of any tree.
        nodes: Largest number of nodes of an individual, all joints together.
        early_stop: Whether individuals that are certain to lose every tournament they are in are stopped.
        screening: Share of the individuals that is tried on all cases; the others are the worst on a sixth of them, or
            on a third (in each generation other ones). 1: all are.
        tuned: What tuning of constants chooses from: the "mean" of its search, or also the "best" it tried.
        gep: Parameters of gene expression programming.
    """

    representation: str
    population: int
    generations: int
    selection: str
    tournament: int
    crossover: float
    subtree_mutation: float
    point_mutation: float
    constant_mutation: float
    depth_at_birth: tuple[int, int]
    depth: int
    nodes: int
    early_stop: bool
    screening: float
    tuned: str
    gep: GepSettings


@dataclass(frozen=True)
class Task:
    """What to evolve.

    Attributes:
        name: The task's name.
        figure: What is evolved: "lamp", or the description of another figure, driven as the task asks.
        control_period: Time between evaluations of a controller [s].
        timestep: Physics step [s]; None: the model's own.
        duration: Length of a trial [s].
        signals: "on-board", "all", or the names of terminals.
        constants: Range that constants are drawn from.
        seeds: Controllers (files or shipped names) that the first generation begins with.
        cases: Which goals.
        pole: A limbo pole on the way, or None.
        poses: Poses to be in at given times, for the term `pose`.
        world: What the task changes of a figure and of the body at its goal.
        main: Weights of the main fitness terms.
        style: Weights of the style terms, phased in over the run.
        gp: Parameters of genetic programming.
        source: The file's text.
    """

    name: str
    figure: str | Figure
    control_period: float
    timestep: float | None
    duration: float
    signals: str | tuple[str, ...]
    constants: tuple[float, float]
    seeds: tuple[str, ...]
    cases: Cases
    pole: Pole | None
    poses: tuple[KeyPose, ...]
    world: World
    main: Mapping[str, float]
    style: Mapping[str, float]
    gp: Settings
    source: str

    def terminals(self, driven: Driven) -> tuple[str, ...]:
        """Return the terminals a controller for this task may read.

        Args:
            driven: What it drives: the lamp at hand, or the figure.
        """
        if isinstance(self.signals, tuple):
            return self.signals
        if isinstance(self.figure, Figure):
            return figure_terminals(self.figure)
        left_out = {*(TWIN_ONLY if self.signals == "on-board" else ()), *(() if self.cases.goal_time else OPTIONAL)}
        return tuple(name for name in terminals_of(driven) if name not in left_out)


def _weights(table: Table, figure: str | Figure, present: Mapping[str, bool]) -> dict[str, float]:
    known, own = terms(), terms_of(LAMP if isinstance(figure, str) else figure.name)
    weights = {}
    for name in table.names():
        if name not in own:
            kind = "unknown fitness term"
            if name in known:
                kind = f"is no term of {figure if isinstance(figure, str) else figure.name}'s"
            raise table.fail(name, f"{kind}; expected one of {', '.join(own)}")
        if not present.get(NEEDS.get(name, ""), True):
            raise table.fail(name, f"needs {NEEDS[name]}, which the task does not give")
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


def _signals(root: Table, value: object, figure: str | Figure, joints: int) -> str | tuple[str, ...]:
    words = _SIGNALS if isinstance(figure, str) else ("all",)
    if not isinstance(value, list):
        return root.text("signals", words)
    value = root.array("signals")
    known = all_terminals(joints) if isinstance(figure, str) else figure_terminals(figure)
    for name in value:
        if isinstance(figure, Figure) and isinstance(name, str) and re.fullmatch(r"k\d+", name) and name not in known:
            have = f"{len(figure.names)} joints, k0 to k{len(figure.names) - 1} ({', '.join(figure.names)})"
            raise root.fail("signals", f"{name!r}: {figure.name} has {have}")
        if name not in known:
            expected = f"some of {' '.join(known)}, or {', or '.join(words)}"
            raise root.fail("signals", f"unknown {name!r}; expected {expected}")
    if not value or len(set(value)) < len(value):
        raise root.fail("signals", f"{value!r} is not a list of different terminals")
    return tuple(value)


def _poses(root: Table, joints: int, duration: float) -> tuple[KeyPose, ...]:
    poses = []
    for table in root.tables("poses") if "poses" in root else ():
        angles = table.array("angles")
        numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in angles)
        if len(angles) != joints or not numbers or not all(abs(value) <= 4.0 for value in angles):
            raise table.fail("angles", f"{angles!r} is not {joints} angles from -4 to 4 rad")
        poses.append(KeyPose(table.number("time", 0.0, duration, "s"), tuple(float(value) for value in angles)))
        table.done()
    return tuple(poses)


def _directions(table: Table) -> tuple[float, float]:
    values = table.array("direction", default=[0.0, 0.0])
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if len(values) != 2 or not numbers or not -math.pi - 1e-3 <= values[0] <= values[1] <= math.pi + 1e-3:
        raise table.fail("direction", f"{values!r} is not two directions from -pi to pi, the smaller first")
    return float(values[0]), float(values[1])


def _world(root: Table, figure: Figure) -> World:
    if "world" not in root:
        return World()
    table = root.table("world")
    if "goal_mass" in table and figure.goal == POINT:
        raise table.fail("goal_mass", f"no body stands at the goal of {figure.name}: it is a point")
    world = World(
        strength=table.number("strength", 0.01, 100.0, default=1.0),
        mass=table.number("mass", 0.01, 100.0, default=1.0),
        goal_mass=table.number("goal_mass", 0.001, 10_000.0, "kg", default=None),
    )
    table.done()
    return world


def _figure(root: Table, assets: Assets) -> str | Figure:
    name = root.text("figure", (LAMP, *figures(assets)), default=LAMP)
    if name == LAMP:
        root.text("drive", ("position",), default="position")
        return name
    figure = load_figure(assets, name, root.text("drive", DRIVES, default=None))
    for key in ("pole", "poses"):
        if key in root:
            raise root.fail(key, f"is for the lamp alone; the task's figure is {name}")
    return figure


def _cases(table: Table, figure: str | Figure) -> Cases:
    if isinstance(figure, str) and "direction" in table:
        raise table.fail("direction", "is for other figures; the lamp's goals are ahead")
    if isinstance(figure, Figure) and "goal_time" in table:
        raise table.fail("goal_time", f"is for the lamp alone; the task's figure is {figure.name}")
    low = table.number("low", 0.001, 100.0, "m")
    cases = Cases(
        count=table.integer("count", 1, 1000),
        low=low,
        high=table.number("high", low, 100.0, "m"),
        spacing=table.number("spacing", 0.0, 100.0, "m"),
        lamps=table.integer("lamps", 1, 1000) if isinstance(figure, str) else table.integer("lamps", 1, 1, default=1),
        spread=table.text("spread", default="spread") if isinstance(figure, str) else "",
        fresh=table.flag("fresh", default=False),
        goal_time=_pair(table, "goal_time", 0.1, 600.0) if "goal_time" in table else None,
        direction=_directions(table),
    )
    table.done()
    return cases


def _settings(table: Table) -> Settings:
    shares: dict[str, float] = {}
    for name in ("crossover", "subtree_mutation", "point_mutation", "constant_mutation"):
        left = round(1.0 - sum(shares.values()), 12)
        shares[name] = table.number(name, 0.0, left, default=_CROSSOVER if name == "crossover" else 0.0)
    shortest, tallest = _pair(table, "depth_at_birth", 1, 17) if "depth_at_birth" in table else _DEPTH_AT_BIRTH
    if not float(shortest).is_integer() or not float(tallest).is_integer():
        raise table.fail("depth_at_birth", f"[{shortest:g}, {tallest:g}] is not two whole numbers")
    settings = Settings(
        representation=table.text("representation", REPRESENTATIONS, default="tree"),
        population=table.integer("population", 1, 100_000),
        generations=table.integer("generations", 1, 100_000),
        selection=table.text("selection", SELECTIONS, default="tournament"),
        tournament=table.integer("tournament", 1, 1000, default=6),
        depth_at_birth=(int(shortest), int(tallest)),
        depth=table.integer("depth", int(tallest), 100, default=max(_DEPTH, int(tallest))),
        nodes=table.integer("nodes", 10, 100_000, default=1000),
        early_stop=table.flag("early_stop", default=True),
        screening=table.number("screening", 0.01, 1.0, default=1.0),
        tuned=table.text("tuned", TUNED, default="mean"),
        gep=read_gep(table.table("gep", default={})),
        **shares,
    )
    table.done()
    return settings


_SHOWN = 80  # characters of what was typed, in a message
_PARTS = 4  # of a key: more than any key of a task has


def _override(document: Any, text: str) -> None:
    """Set one key, given as KEY=VALUE, in a parsed file."""
    where = f"--set {text[:_SHOWN]}"
    key, equals, value = text.partition("=")
    try:
        parsed = parse_toml(f"value = {value}", where)["value"] if equals and value.strip() else None
    except FileError:
        parsed = value.strip()  # a text without its quotes, as gp.selection=lexicase
        if not parsed.replace("-", "").replace("_", "").isalnum():
            raise RobolampError(f"{shown(value)} is not a TOML value", where) from None
    names = key.strip().split(".")
    if parsed is None or not all(names) or len(names) > _PARTS:
        raise RobolampError("is not KEY=VALUE, as gp.population=100", where)
    table = document
    for name in names[:-1]:
        if name not in table:
            table[name] = tomlkit.table()
        table = table[name]
        if not isinstance(table, MutableMapping):
            raise RobolampError(f"{name!r} is not a table of the task", where)
    table[names[-1]] = parsed


def load_task(assets: Assets, name: str | Path, joints: int = 3, overrides: Sequence[str] = ()) -> Task:
    """Read a task file.

    Args:
        assets: Where to look.
        name: A path, or the name of a file in sim/tasks/.
        joints: Joints of the lamp.
        overrides: Keys to set, each as KEY=VALUE (`gp.population=100`), before the file is checked.

    Raises:
        FileError: The file is missing or malformed; the message names the key and what was expected.
        RobolampError: An override is no KEY=VALUE.
    """
    path = assets.named(name, "sim/tasks", "task", exclude=("spread", "spread-narrow"))
    source = read_text(path, MOST_TOML)
    parse_toml(source, str(path))
    try:
        if overrides:
            document = tomlkit.parse(source)
            for override in overrides:
                _override(document, override)
            source = tomlkit.dumps(document)
    except (ValueError, RecursionError, TOMLKitError) as error:
        raise FileError(f"not valid TOML: {error}", str(path)) from None
    return parse_task(source, joints, str(path), assets)


def parse_task(source: str, joints: int, where: str, assets: Assets) -> Task:
    """Read the text of a task file; see `load_task`."""
    data = parse_toml(source, where)
    root = Table(data, where)
    root.integer("schema", 1, 1)
    duration = root.number("duration", 0.1, 600.0, "s")
    figure = _figure(root, assets)
    cases = _cases(root.table("cases"), figure)
    pole = None
    if "pole" in root:
        table = root.table("pole")
        pole = Pole(table.number("height", 0.02, 1.0, "m"), table.number("x", 0.05, 100.0, "m"))
        table.done()
    poses = _poses(root, joints, duration)
    present = {"[pole]": pole is not None, "[[poses]]": bool(poses), "cases.goal_time": cases.goal_time is not None}
    task = Task(
        name=root.text("name"),
        figure=figure,
        control_period=root.number("control_period", 0.002, 0.1, "s"),
        timestep=root.number("timestep", 0.0005, 0.01, "s", default=None),
        duration=duration,
        signals=_signals(root, data.get("signals"), figure, joints),
        constants=_pair(root, "constants", -1e6, 1e6),
        seeds=_names(root, "seeds"),
        cases=cases,
        pole=pole,
        poses=poses,
        world=World() if isinstance(figure, str) else _world(root, figure),
        main=_weights(root.table("main"), figure, present),
        style=_weights(root.table("style"), figure, present),
        gp=_settings(root.table("gp")),
        source=source,
    )
    if not any((*task.main.values(), *task.style.values())):
        raise root.fail("main", "no term of [main] or [style] weighs more than 0: every controller would be as good")
    if isinstance(task.signals, tuple) and "goal_time" in task.signals and cases.goal_time is None:
        raise root.fail("signals", "goal_time needs cases.goal_time, which the task does not give")
    root.done()
    return task
