"""`robolamp explain`: a controller's expressions, simplified, and which of their branches its runs take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from rich.console import Console
from rich.text import Text

from robolamp.cli.options import DURATION, GOAL_TIME, Setup
from robolamp.cli.scoring.controller_stage import stage_of
from robolamp.cli.screen.output import called, counted, print_json
from robolamp.controller.branch_counts import count_branches
from robolamp.controller.controller_file import BY_HAND, EVOLVED, TUNED, Controller
from robolamp.controller.expression import Expression, subtree_end
from robolamp.controller.expression_layout import lay_out
from robolamp.controller.simplify import simplify
from robolamp.errors import RobolampError

_GOALS = "0.05:0.60:12"  # [m]
_MOST_TICKS = 1e6  # to be recorded: about 170 MB
_WIDTH = 100
_AS = {EVOLVED: "as evolved", TUNED: "as tuned", BY_HAND: "as written", "": "as given"}
_GUTTER = 10  # columns for the share of ticks, left of an expression


def explain(
    controller: str,
    /,
    *,
    goals: str | None = None,
    duration: Annotated[float | None, DURATION] = None,
    goal_time: Annotated[float | None, GOAL_TIME] = None,
    task: str | None = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Show what a controller does: its expressions, simplified, the signals they read, the branches they take.

    Parameters
    ----------
    controller
        A controller file, or the name of a shipped one (hop).
    goals
        Goals that it runs to on the twin, to count its branches: one goal, or LOW:HIGH:COUNT, in metres
        (0.05:0.60:12). For a figure other than the lamp: X,Y, or LOW:HIGH:COUNT, so many points all round, that far
        away; without it, the goals of its task.
    duration
        Length of each run in seconds (8, beyond 64 cm what the furthest goal takes at 8 cm/s; or the time limit of a
        figure's task).
    goal_time
        Time to take for the way in seconds, for a controller that reads goal_time.
    task
        For a figure other than the lamp: the task it is in (file or name); without it, the task.toml beside the
        controller, or the task that it was evolved for.
    calibration
        Calibration, the twin's numbers: a file, or a name in calibration/.
    lamp
        Folder of your own lamp, as `robolamp new` makes it.
    as_json
        Print one JSON object: each joint's expression as evolved and simplified, nodes, signals, and branches with the
        shares of ticks that reached them and that took each side.
    """
    setup = Setup.of(lamp, calibration)
    stage = stage_of(
        setup, controller, task, {"--goal-time": goal_time, "--calibration": calibration != "nominal"},
        goal_time=goal_time,
    )  # fmt: skip
    loaded, terminals = stage.controller, stage.terminals
    jobs = stage.jobs(goals, "--goals", _GOALS)
    each = duration or stage.time(jobs)
    ticks = len(jobs) * each / loaded.control_period
    if ticks > _MOST_TICKS:
        raise RobolampError(
            f"{ticks:,.0f} ticks in all; at most {_MOST_TICKS:,.0f} are recorded", "--goals, --duration"
        )
    trace = stage.fleet().run([stage.program], jobs, each, record=True).trace
    assert trace is not None  # it was asked for
    distances = np.array([job.goal for job in jobs])
    inputs = trace.inputs[np.arange(trace.inputs.shape[1]) < trace.ticks[:, None]]
    if as_json:
        joints = [
            _described(name, expression, terminals, inputs)
            for name, expression in zip(loaded.joints, loaded.expressions, strict=True)
        ]
        print_json(
            {
                "controller": loaded.name,
                "origin": loaded.origin or None,
                "goals_m": distances,
                "ticks": len(inputs),
                "joints": joints,
            }
        )
        return 0
    _print(loaded, terminals, distances, inputs, each)
    return 0


def _described(
    name: str, expression: Expression, terminals: tuple[str, ...], inputs: NDArray[np.float64]
) -> dict[str, Any]:
    simple = simplify(expression)
    return {
        "joint": name,
        "evolved": str(expression),
        "simplified": str(simple),
        "nodes": len(expression.tokens),
        "nodes_simplified": len(simple.tokens),
        "signals": _signals(simple, terminals),
        "signals_idle": _signals(expression, terminals, without=simple),
        "branches": _branches(expression, terminals, inputs),
        "branches_simplified": _branches(simple, terminals, inputs),
    }


def _signals(expression: Expression, terminals: tuple[str, ...], without: Expression | None = None) -> list[str]:
    """Return what an expression reads and another does not, in the order of the terminals."""
    read = expression.terminals - (without.terminals if without else frozenset())
    return [name for name in terminals if name in read]


def _branches(
    expression: Expression, terminals: tuple[str, ...], inputs: NDArray[np.float64]
) -> list[dict[str, str | float]]:
    ticks, tokens, found = max(len(inputs), 1), expression.tokens, []
    for branch in count_branches(expression, terminals, inputs):
        start = branch.index + 1
        found.append(
            {
                "condition": str(Expression(tokens[start : subtree_end(tokens, start)])),
                "reached_share": (branch.negative + branch.otherwise) / ticks,
                "negative_share": branch.negative / ticks,
                "otherwise_share": branch.otherwise / ticks,
            }
        )
    return found


def _print(
    controller: Controller,
    terminals: tuple[str, ...],
    goals: NDArray[np.float64],
    inputs: NDArray[np.float64],
    duration: float,
) -> None:
    console = Console(highlight=False, soft_wrap=True)
    low, high = goals.min() * 100, goals.max() * 100
    reach = f"{low:g} cm" if len(goals) == 1 else f"{low:g} to {high:g} cm"
    meant = "angles in rad" if controller.drive == "position" else "velocities in rad/s"
    console.print(Text(called(controller), "italic"), end="")
    console.print(
        f": goal {meant}. Left of each branch: at which share of {counted(len(inputs), 'tick')} it was taken,"
        f"\nin {counted(len(goals), 'run')} on the twin, {reach}, {duration:g} s each."
        " (ifltz c a b) is a where c is below 0, else b."
    )
    for name, expression in zip(controller.joints, controller.expressions, strict=True):
        simple = simplify(expression)
        before, after = len(expression.tokens), len(simple.tokens)
        console.print()
        console.print(Text(name, "bold"), end="")
        console.print(f": reads {', '.join(_signals(simple, terminals)) or 'nothing'}", end="")
        idle = _signals(expression, terminals, without=simple)
        console.print(f"; {', '.join(idle)} changes nothing" if idle else "")
        evolved = _annotated(expression, terminals, inputs)
        if before == after:  # as many nodes, differently written at most
            console.print(Text(f"  {counted(before, 'node')}, as simple as it gets", "dim"), evolved, sep="\n")
            continue
        console.print(Text(f"  {_AS[controller.origin]}, {counted(before, 'node')}", "dim"), evolved, sep="\n")
        title = Text(f"  simplified, {counted(after, 'node')}", "dim")
        console.print(title, _annotated(simple, terminals, inputs), sep="\n")


def _annotated(expression: Expression, terminals: tuple[str, ...], inputs: NDArray[np.float64]) -> Text:
    """Return an expression over lines, with the share of ticks left of each branch; dead ones are marked."""
    counts = {branch.index: branch for branch in count_branches(expression, terminals, inputs)}
    text = Text()
    for number, line in enumerate(lay_out(expression, _WIDTH - _GUTTER)):
        share, style = "", ""
        if line.begins is not None:
            index, argument = line.begins
            taken = counts[index].negative if argument == 1 else counts[index].otherwise
            share, style = _share(taken, len(inputs)), "" if taken else "dim red"
        text.append("\n" if number else "").append(f"{share:>{_GUTTER - 2}}  ", style or "cyan")
        text.append(line.text, style)
    return text


def _share(taken: int, ticks: int) -> str:
    if not taken:
        return "never"
    percent = 100.0 * taken / ticks
    return f"{percent:.0f} %" if percent >= 1.0 else "< 1 %"
