"""What dry-run and deploy tell of a run, and what they leave behind when there was none."""

from __future__ import annotations

import contextlib
import shlex
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from robolamp.cli.drive import Drive
from robolamp.cli.output import print_json
from robolamp.compare.task import NOT_DONE
from robolamp.log.reader import read_run
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import SIGNALS


def facts(plan: Drive, result: RunResult) -> dict[str, Any]:
    """Return what `--json` says of any run; what only some runs have is null.

    Args:
        plan: What was asked for.
        result: How it went.
    """
    return {
        "goal_m": plan.goal,
        "landed_m": None,
        "error_m": None,
        "hops": result.hops,
        "fell": None,
        "ended": result.ended,
        "reason": result.reason,
        "ticks": result.ticks,
        "missed_ticks": result.missed_ticks,
        "faults": result.faults,
        "interventions": vars(result.interventions),
        "task": None,
        "task_why": [],
        "verdict": None,
        "verdict_why": [],
        "twin_alone_m": None,
        "log": plan.log,
        "report": None,
    }


def ended(result: RunResult) -> str:
    """Return how a run ended and, where there is one, why."""
    return f"{result.ended}: {result.reason}" if result.reason else result.ended


def account(result: RunResult) -> str:
    """Return a line of ticks, interventions and faults."""
    faults = ", ".join(f"{text} (x{count})" for text, count in result.faults.items()) or "none"
    return (
        f"Ticks {result.ticks}, missed {result.missed_ticks}, envelope interventions"
        f" {result.interventions.total}, faults: {faults}."
    )


def tell(headline: str, rest: str) -> None:
    """Print a bold headline and what follows it, each character as it is: names and paths may hold brackets."""
    Console(highlight=False).print(Text.assemble((headline, "bold"), rest), soft_wrap=True)


def tell_of_none(plan: Drive, result: RunResult, as_json: bool) -> int:
    """Tell of a run that ended before the controller drove: nothing landed, and there is nothing to compare.

    Args:
        plan: What was asked for.
        result: How it went.
        as_json: Print one JSON object.

    Returns:
        The exit code.
    """
    if as_json:
        why = f"the controller never drove ({ended(result)})"
        print_json({**facts(plan, result), "task": NOT_DONE, "task_why": [why]})
    else:
        said = "Not done: the controller never drove. There is nothing to compare: no report."
        tell(ended(result), f"\n{said}\n{account(result)}\nlog     {plan.log}")
    return 1


def tell_of_shadow(plan: Drive, result: RunResult, as_json: bool) -> int:
    """Tell of a run that only watched: what it would have commanded. The twin has nothing to be compared with.

    Args:
        plan: What was asked for.
        result: How it went.
        as_json: Print one JSON object.

    Returns:
        The exit code.
    """
    run = read_run(plan.log)
    rows = run.phase == "run"
    lamp = plan.setup.lamp
    goals = run.goal[rows]
    speed = np.abs(np.diff(goals, axis=0)).max(axis=0, initial=0.0) / np.median(np.diff(run.scheduled))
    commanded = [
        {
            "joint": joint.name,
            "lowest_rad": low,
            "highest_rad": high,
            "fastest_rad_s": fastest,
        }
        for joint, low, high, fastest in zip(lamp.joints, goals.min(axis=0), goals.max(axis=0), speed, strict=True)
    ]
    if as_json:
        print_json({**facts(plan, result), "stage": "shadow", "commanded": commanded})
    else:
        lines = [
            f"{row['joint']:8} {row['lowest_rad']:+.2f} to {row['highest_rad']:+.2f} rad (limits {joint.lower:+.2f} to "
            f"{joint.upper:+.2f}), at most {row['fastest_rad_s']:.1f} of {joint.slew:g} rad/s"
            for row, joint in zip(commanded, lamp.joints, strict=True)
        ]
        after = f"next    robolamp deploy ... --stage gentle --after {shlex.quote(str(plan.log))}"
        said = "\n".join(["; torque stayed off. It would have commanded", *lines, account(result)])
        tell(ended(result), f"{said}\nlog     {plan.log}\n{after}")
    return 0 if result.ended == "finished" else 1


@contextlib.contextmanager
def reporting(log: Path) -> Iterator[None]:
    """While a report is made: Ctrl-C or SIGTERM says where the log is, and ends the process with 130.

    Args:
        log: The log of the run.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in SIGNALS}
    try:
        yield
    except KeyboardInterrupt:
        again = shlex.join(["robolamp", "compare", str(log)])
        print(f"robolamp: no report; the log is at {log}; `{again}` makes the report", file=sys.stderr, flush=True)
        sys.exit(130)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def tidying(plan: Drive, *files: Path) -> Iterator[None]:
    """Remove what this run made when it is refused before its first tick.

    Args:
        plan: Counts the ticks.
        *files: What it may have made, besides their folder; what is there already stays.
    """
    folder = plan.log.parent
    made = [path for path in (plan.log, *files) if not path.exists()]
    folders = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        yield
    except BaseException:
        if not plan.phases:
            for path in made:
                with contextlib.suppress(OSError):
                    path.unlink()
            for path in folders:  # innermost first; one that holds something else stays
                with contextlib.suppress(OSError):
                    path.rmdir()
        raise
