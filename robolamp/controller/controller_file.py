"""The controller file: TOML that people read and edit, one S-expression for each joint."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit

from robolamp.controller.expression import Expression, parse, parse_list
from robolamp.controller.gene import parse_gene
from robolamp.controller.program import Program, compile_program
from robolamp.controller.terminals import TWIN_ONLY, all_terminals, figure_terminals, terminals_of
from robolamp.errors import ExpressionError, FileError
from robolamp.figure import DRIVES, LAMP, Driven, Figure
from robolamp.files import Table, read_text, read_toml, write_atomic

EVOLVED, TUNED, BY_HAND = "evolved", "tuned", "by hand"
ORIGINS = (EVOLVED, TUNED, BY_HAND)
"""Where a controller's expressions come from: bred; written by hand, their numbers found by a search; all by hand."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,63}")  # it becomes part of a folder's name
_LONGEST = 64
_TIME, _SPEED = 8.0, 0.08  # of a run of the lamp [s], and its least speed to goals beyond that [m/s]


def slug(text: str) -> str:
    """Return a legal controller name: the text if it is one, else the nearest to it.

    Args:
        text: What it should be called.
    """
    if _NAME.fullmatch(text):
        return text
    fitting = re.sub(r"[^A-Za-z0-9 ._-]+", "-", text).lstrip(" ._-")[:_LONGEST].rstrip(" -")
    return fitting or "controller"


def _name(root: Table) -> str:
    name = root.text("name")
    if not _NAME.fullmatch(name):
        shown = name if len(name) <= _LONGEST else f"{name[:_LONGEST]}..."
        raise root.fail("name", f"{shown!r} is not 1 to {_LONGEST} letters, digits, spaces, or . _ - (no such first)")
    return name


def _expressions(table: Table, terminals: Sequence[str], driven: Driven, where: str) -> tuple[Expression, ...]:
    """Read [joints]: a key for each joint."""
    if "expressions" in table:
        raise table.fail("expressions", "belongs above the first [table], not into [joints]")
    if set(table.names()) != set(driven.names):
        have, whose = ", ".join(table.names()) or "none", _whose(driven)
        raise FileError(f"joints: the controller's joints ({have}) are not {whose} ({', '.join(driven.names)})", where)
    texts = [table.text(name) for name in driven.names]
    for name, text in zip(driven.names, texts, strict=True):
        if re.match(r"\s*\(\s*list\b", text):
            raise table.fail(name, "a (list ...) holds all joints: give it as `expressions` in place of [joints]")
    return tuple(
        parse(text, terminals, f"{where}: joints.{name}") for name, text in zip(driven.names, texts, strict=True)
    )


def _whose(driven: Driven) -> str:
    return f"{driven.name}'s" if isinstance(driven, Figure) else "the lamp's"


@dataclass(frozen=True)
class Controller:
    """A controller as its file holds it.

    Attributes:
        name: Its name.
        task: The task it was evolved for; empty for one written by hand.
        drive: What its outputs are, one of `robolamp.figure.DRIVES`.
        control_period: Time between evaluations [s].
        expressions: One a joint, in the lamp's order.
        joints: The joints' names, from the foot up.
        provenance: Seed, generation, command, calibration hash and versions it came from.
        scores: What it reached, as written by whoever scored it.
        source: The file's text; empty for one that was never in a file.
        figure: What it drives.
        genome: The gene of each joint that the expressions were decoded from, by joint; empty where they were not.
        origin: Where the expressions come from, one of ORIGINS; empty where the file does not say, as in 0.1.0.
    """

    name: str
    task: str
    drive: str
    control_period: float
    expressions: tuple[Expression, ...]
    joints: tuple[str, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    scores: Mapping[str, Any] = field(default_factory=dict)
    source: str = field(default="", repr=False)
    figure: str = LAMP
    genome: Mapping[str, str] = field(default_factory=dict)
    origin: str = ""

    @property
    def terminals(self) -> tuple[str, ...]:
        """Names of the terminals it reads: those of the lamp in the order of `all_terminals`, others sorted."""
        read = frozenset().union(*(expression.terminals for expression in self.expressions))
        known = tuple(name for name in all_terminals(len(self.joints)) if name in read)
        return (*known, *sorted(read.difference(known)))

    def compile(self, supplied: Sequence[str]) -> Program:
        """Flatten it for the interpreters.

        Args:
            supplied: Names of the terminals that will be supplied, in order.

        Raises:
            ExpressionError: It reads a terminal that is not supplied.
        """
        return compile_program(self.expressions, supplied)


def check_terminals(controller: Controller, supplied: Sequence[str], where: str) -> None:
    """Refuse a controller that needs a signal that the lamp does not have.

    Args:
        controller: The controller.
        supplied: Names of the terminals to be had.
        where: What it came from, for the message.

    Raises:
        ExpressionError: Names the joints, the terminals and what is to be had.
    """
    for joint, expression in zip(controller.joints, controller.expressions, strict=True):
        missing = [name for name in controller.terminals if name in expression.terminals and name not in supplied]
        if missing:
            raise ExpressionError(
                f"joints.{joint}: needs {' '.join(missing)}, which this lamp cannot supply;"
                f" it supplies {' '.join(supplied)}",
                where,
            )


def time_for(goal: float) -> float:
    """Return how long a controller may drive to a goal [m], if nothing else was said: 8 s, and from 64 cm on longer."""
    return max(_TIME, goal / _SPEED)


def check_goal_time(controller: Controller, goal_time: float | None) -> None:
    """Refuse a controller that reads goal_time if no time was given.

    Args:
        controller: The controller.
        goal_time: Commanded time to take for the way [s]; None: none was commanded.

    Raises:
        ExpressionError: Names the joints and the option that gives one.
    """
    reading = [
        joint
        for joint, expression in zip(controller.joints, controller.expressions, strict=True)
        if "goal_time" in expression.terminals
    ]
    if reading and goal_time is None:
        raise ExpressionError(
            f"joints.{reading[0]}: reads goal_time, the time to take; give it by --goal-time SECONDS", controller.name
        )


def _genome(root: Table, terminals: Sequence[str], expressions: Sequence[Expression], driven: Driven) -> dict[str, str]:
    """Read [genome]: the gene of each joint, which must express what [joints] says."""
    if "genome" not in root:
        return {}
    table = root.table("genome")
    genes = {name: " ".join(table.text(name).split()) for name in driven.names}
    table.done()
    for (name, text), expression in zip(genes.items(), expressions, strict=True):
        try:
            gene = parse_gene(text, terminals)
        except ExpressionError as error:
            raise table.fail(name, str(error)) from None
        if gene.expression != expression:
            raise table.fail(
                name, f"expresses {gene.expression}, not what [joints] says; remove [genome] if you edited"
            )
    return genes


def read_figure(path: Path) -> str:
    """Return the figure that a controller file names: "lamp" unless it says otherwise.

    Raises:
        FileError: The file is missing or not TOML.
    """
    return Table(read_toml(path), str(path)).text("figure", default=LAMP)


def load_controller(path: Path, driven: Driven, *, on_board: bool = False) -> Controller:
    """Read a controller file.

    Args:
        path: The file.
        driven: The lamp, or the figure, that it will drive.
        on_board: Refuse terminals that only the twin knows.

    Raises:
        FileError: The file is missing or malformed, or its figure, its joints or its drive are not those.
        ExpressionError: An expression does not parse, or needs a terminal that is not to be had.
    """
    where = str(path)
    root = Table(read_toml(path), where)
    root.integer("schema", 1, 1)
    figure, own = root.text("figure", default=LAMP), driven.name if isinstance(driven, Figure) else LAMP
    if figure != own:
        raise root.fail("figure", f"drives {figure!r}; expected a controller for {own!r}")
    terminals = figure_terminals(driven) if isinstance(driven, Figure) else all_terminals(len(driven.joints))
    # `expressions = "(list ...)"`, as papers print controllers, or a table with a key for each joint.
    if "expressions" in root:
        text = root.text("expressions")
        expressions = parse_list(text, terminals, f"{where}: expressions")
        if len(expressions) != len(driven.names):
            raise root.fail(
                "expressions", f"holds {len(expressions)}; expected one a joint ({', '.join(driven.names)})"
            )
    else:
        expressions = _expressions(root.table("joints"), terminals, driven, where)
    declared = root.array("terminals", default=[])
    controller = Controller(
        name=_name(root),
        task=root.text("task", default=""),
        origin=root.text("origin", ORIGINS, default=""),
        drive=root.text("drive", DRIVES if own != LAMP else ("position",), default="position"),
        control_period=root.number("control_period", 0.002, 0.1, "s", default=0.02),
        expressions=expressions,
        joints=driven.names,
        figure=figure,
        genome=_genome(root, terminals, expressions, driven),
        provenance=root.table("provenance", default={}).raw(),
        scores=root.table("scores", default={}).raw(),
        source=read_text(path),
    )
    root.done()
    unknown = [name for name in declared if name not in terminals]
    if unknown:
        raise FileError(f"terminals: unknown {unknown[0]!r}; expected some of {' '.join(terminals)}", where)
    if declared and set(declared) != set(controller.terminals):
        raise FileError(f"terminals: declares {declared}, but the expressions read {list(controller.terminals)}", where)
    supplied = set(terminals_of(driven)) - (set(TWIN_ONLY) if on_board else set())
    check_terminals(controller, [name for name in terminals if name in supplied], where)
    return controller


def format_controller(controller: Controller) -> str:
    """Return a controller as the text of its file."""
    document = tomlkit.document()
    what = "goal angles [rad]" if controller.drive == "position" else "goal angular velocities [rad/s]"
    document.add(tomlkit.comment(f"A controller for robolamp: {what} of {', '.join(controller.joints)}."))
    document.add(tomlkit.nl())
    document["schema"] = 1
    document["name"] = controller.name
    document["task"] = controller.task
    if controller.origin:
        document["origin"] = controller.origin
    if controller.figure != LAMP:
        document["figure"] = controller.figure
    document["drive"] = controller.drive
    document["control_period"] = tomlkit.item(controller.control_period).comment("s")
    document["terminals"] = list(controller.terminals)
    joints = tomlkit.table()
    for name, expression in zip(controller.joints, controller.expressions, strict=True):
        joints[name] = tomlkit.string(_wrapped(str(expression)), multiline=True)
    document["joints"] = joints
    if controller.genome:
        genome = tomlkit.table()
        genome.add(tomlkit.comment("The genes that [joints] was decoded from: head | tail | domain | constants."))
        for name, text in controller.genome.items():
            genome[name] = tomlkit.string(_wrapped(text), multiline=True)
        document["genome"] = genome
    for key, content in (("scores", controller.scores), ("provenance", controller.provenance)):
        if content:
            document[key] = dict(content)
    return tomlkit.dumps(document)


def _wrapped(text: str, width: int = 100) -> str:
    lines, line = [], ""
    for word in text.split(" "):
        if line and len(line) + 1 + len(word) > width:
            lines.append(line)
            line = "  "
        line = word if not line else f"{line} {word}" if line.strip() else f"{line}{word}"
    return "\n".join([*lines, line]) + "\n"


def save_controller(controller: Controller, path: Path) -> None:
    """Write a controller file, atomically.

    Args:
        controller: The controller.
        path: Where to.

    Raises:
        FileError: It cannot be written.
    """
    write_atomic(path, format_controller(controller))
