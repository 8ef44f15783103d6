"""The controller file: TOML that people read and edit, one S-expression for each joint."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit

from robolamp.controller.expression import Expression, parse, parse_list
from robolamp.controller.program import Program, compile_program
from robolamp.controller.terminals import OPTIONAL, all_terminals, on_board_terminals
from robolamp.errors import ExpressionError, FileError
from robolamp.files import Table, read_text, read_toml, write_atomic
from robolamp.lamp import Lamp

DRIVES = ("position",)
"""What a controller's outputs may mean: goal angles [rad]."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,63}")  # it becomes part of a folder's name
_LONGEST = 64


def slug(text: str) -> str:
    """Return a name that a controller may have: the text where it is one, else the nearest to it.

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


def _expressions(table: Table, terminals: Sequence[str], lamp: Lamp, where: str) -> tuple[Expression, ...]:
    """Read [joints]: a key for each joint."""
    if "expressions" in table:
        raise table.fail("expressions", "belongs above the first [table], not into [joints]")
    if set(table.names()) != set(lamp.names):
        have = ", ".join(table.names()) or "none"
        raise FileError(f"joints: the controller's joints ({have}) are not the lamp's ({', '.join(lamp.names)})", where)
    texts = [table.text(name) for name in lamp.names]
    for name, text in zip(lamp.names, texts, strict=True):
        if re.match(r"\s*\(\s*list\b", text):
            raise table.fail(name, "a (list ...) holds all joints: give it as `expressions` in place of [joints]")
    return tuple(
        parse(text, terminals, f"{where}: joints.{name}") for name, text in zip(lamp.names, texts, strict=True)
    )


@dataclass(frozen=True)
class Controller:
    """A controller as its file holds it.

    Attributes:
        name: Its name.
        task: The task it was evolved for; empty for one written by hand.
        drive: What its outputs are, one of `DRIVES`.
        control_period: Time between evaluations [s].
        expressions: One a joint, in the lamp's order.
        joints: The joints' names, from the foot up.
        provenance: Seed, generation, command, calibration hash and versions it came from.
        scores: What it reached, as written by whoever scored it.
        source: The file's text; empty for one that was never in a file.
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

    @property
    def terminals(self) -> tuple[str, ...]:
        """Names of the terminals it reads, in the order of `all_terminals`."""
        read = frozenset().union(*(expression.terminals for expression in self.expressions))
        return tuple(name for name in all_terminals(len(self.joints)) if name in read)

    def compile(self, supplied: Sequence[str]) -> Program:
        """Flatten it for the interpreters.

        Args:
            supplied: Names of the terminals that will be supplied, in order.

        Raises:
            ExpressionError: It reads a terminal that is not supplied.
        """
        return compile_program(self.expressions, supplied)


def check_terminals(controller: Controller, supplied: Sequence[str], where: str) -> None:
    """Refuse a controller that needs a signal which is not there.

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


def check_goal_time(controller: Controller, goal_time: float | None) -> None:
    """Refuse a controller that reads goal_time where none was commanded.

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


def load_controller(path: Path, lamp: Lamp, *, on_board: bool = False) -> Controller:
    """Read a controller file.

    Args:
        path: The file.
        lamp: The lamp it will drive.
        on_board: Refuse terminals that only the twin knows.

    Raises:
        FileError: The file is missing or malformed, or its joints are not the lamp's.
        ExpressionError: An expression does not parse, or needs a terminal that is not to be had.
    """
    where = str(path)
    root = Table(read_toml(path), where)
    root.integer("schema", 1, 1)
    terminals = all_terminals(len(lamp.joints))
    # `expressions = "(list ...)"`, as papers print controllers, or a table with a key for each joint.
    if "expressions" in root:
        text = root.text("expressions")
        expressions = parse_list(text, terminals, f"{where}: expressions")
        if len(expressions) != len(lamp.names):
            raise root.fail("expressions", f"holds {len(expressions)}; expected one a joint ({', '.join(lamp.names)})")
    else:
        expressions = _expressions(root.table("joints"), terminals, lamp, where)
    declared = root.array("terminals", default=[])
    controller = Controller(
        name=_name(root),
        task=root.text("task", default=""),
        drive=root.text("drive", DRIVES, default="position"),
        control_period=root.number("control_period", 0.002, 0.1, "s", default=0.02),
        expressions=expressions,
        joints=lamp.names,
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
    supplied = on_board_terminals(len(lamp.joints)) + OPTIONAL if on_board else terminals
    check_terminals(controller, supplied, where)
    return controller


def format_controller(controller: Controller) -> str:
    """Return a controller as the text of its file."""
    document = tomlkit.document()
    document.add(tomlkit.comment(f"A controller for robolamp: goal angles [rad] of {', '.join(controller.joints)}."))
    document.add(tomlkit.nl())
    document["schema"] = 1
    document["name"] = controller.name
    document["task"] = controller.task
    document["drive"] = controller.drive
    document["control_period"] = tomlkit.item(controller.control_period).comment("s")
    document["terminals"] = list(controller.terminals)
    joints = tomlkit.table()
    for name, expression in zip(controller.joints, controller.expressions, strict=True):
        joints[name] = tomlkit.string(_wrapped(str(expression)), multiline=True)
    document["joints"] = joints
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
