"""What is told of a run, whatever fails after it, and what is left behind when there was none."""

from __future__ import annotations

import contextlib
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.text import Text

from robolamp.cli.run.drive import Drive
from robolamp.cli.screen.output import print_json
from robolamp.compare.verdicts.task_verdict import NOT_DONE
from robolamp.compare.verdicts.tolerances import Tolerances
from robolamp.errors import RobolampError, on_one_line
from robolamp.log.reader import read_run
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import SIGNALS

T = TypeVar("T")

_INTERRUPTED = 130  # as a shell reports a process that Ctrl-C ended


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
        "way_m": None if result.way is None else result.way.length,
        "way_stderr_m": None if result.way is None else result.way.stderr,
        "unlike_steps": None if result.way is None else result.way.unlike,
        "fell": None,
        "ended": result.ended,
        "reason": result.reason,
        "ticks": result.ticks,
        "missed_ticks": result.missed_ticks,
        "faults": result.faults,
        "interventions": vars(result.interventions),
        "lockstep": plan.host.lockstep,
        "host_late_ms": None if plan.host.busy is None else plan.host.busy.late * 1e3,
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


def busy(plan: Drive, result: RunResult) -> str:
    """Return a line about this computer where it had to do with how a run went; else nothing.

    Args:
        plan: What was asked for.
        result: How it went.
    """
    host = plan.host
    if host.busy is None:
        return ""
    if host.lockstep:
        kept = f" (its log: {host.cut})" if host.cut else ""
        return f"{host.busy}. That spoilt the run in real time{kept}; this is the run in lockstep, in virtual time.\n"
    if host.busy.ended_it:
        return f"{host.busy}. That spoilt the run, not the lamp.\n"
    if host.busy.late > host.patience and (result.faults or result.missed_ticks):
        return f"{host.busy}. Faults and missed ticks may come of that.\n"
    return ""


def tell(headline: str, rest: str) -> None:
    """Print a bold headline and what follows it, each character as it is: names and paths may hold brackets."""
    Console(highlight=False).print(Text.assemble((headline, "bold"), rest), soft_wrap=True)


@dataclass(frozen=True)
class Failure:
    """What went wrong after a run, which is told all the same.

    Attributes:
        message: One line.
        where: The file that it is about.
        code: The exit code that comes of it.
    """

    message: str
    where: str
    code: int = 2


def attempt(make: Callable[[], T], failures: list[Failure], where: Path, hint: str) -> T | None:
    """Make something of runs that are over; what fails is taken note of, so that the runs can still be told.

    Args:
        make: Makes it.
        failures: What went wrong so far; nothing is made any more where it was interrupted.
        where: The file or folder of the runs.
        hint: How to make it again after an interruption.

    Returns:
        What was made; None where it could not be.
    """
    if any(failure.code == _INTERRUPTED for failure in failures):
        return None
    try:
        with _interruptible():
            return make()
    except KeyboardInterrupt:
        failures.append(Failure(hint, "", _INTERRUPTED))
    except RobolampError as error:
        failures.append(Failure(error.message, error.where))
    except OSError as error:  # one that nothing below has put into words of its own
        failures.append(Failure(error.strerror or str(error), str(error.filename2 or error.filename or where)))
    except Exception as error:  # whatever it is: what the lamp did is known, and is not to be lost over a drawing
        failures.append(Failure(f"{type(error).__name__}: {error}", str(where)))
    return None


def reported(make: Callable[[], T], failures: list[Failure], log: Path) -> T | None:
    """Make something of a run that is over, as `attempt`.

    Args:
        make: Makes it.
        failures: What went wrong so far.
        log: The log of the run.
    """
    again = shlex.join(["robolamp", "compare", str(log)])
    return attempt(make, failures, log, f"no report; the log is at {log}; `{again}` makes the report")


@dataclass(frozen=True)
class Compared:
    """What a run's comparison with its twin says.

    Attributes:
        parts: The verdict's three parts, as in `--json`.
        word: The first of them, in a word or two.
        text: All that follows it, for people.
        report: The page.
    """

    parts: dict[str, Any]
    word: str
    text: str
    report: Path


def compared(plan: Drive, report: Path, allowed: Tolerances, truth: Path | None = None) -> Compared:
    """Compare a run with its twin, and write the report.

    Args:
        plan: What was asked for.
        report: The page to write.
        allowed: What is allowed.
        truth: The truth log of an emulated lamp, where there is a whole one.

    Raises:
        RobolampError: It cannot be compared, or the report not be written.
    """
    from robolamp.cli.screen.verdict import told  # here: should a library not load, the run is over and can be told
    from robolamp.compare.compare_logs import compare_log

    setup = plan.setup
    found = compare_log(
        plan.log, assets=setup.assets, calibration=setup.calibration, out=report, truth=truth, tolerances=allowed
    )
    return Compared(found.parts(), *told(found), report)


def noted(failures: Sequence[Failure]) -> dict[str, str]:
    """Return what `--json` says of the first failure after a run; nothing where there was none."""
    return {"error": failures[0].message, "where": failures[0].where} if failures else {}


def concluded(code: int, failures: Sequence[Failure]) -> int:
    """Say on stderr what failed after a run, and return the exit code.

    Args:
        code: The exit code of the run itself.
        failures: What went wrong after it.
    """
    for failure in failures:
        with contextlib.suppress(OSError, ValueError):
            where = f"{failure.where}: " if failure.where else ""
            print(on_one_line(f"robolamp: {where}{failure.message}"), file=sys.stderr, flush=True)
    return max([code, *(failure.code for failure in failures)])


def tell_of_none(plan: Drive, result: RunResult, as_json: bool, failures: Sequence[Failure] = ()) -> int:
    """Tell of a run that ended before the controller drove: nothing landed, and there is nothing to compare.

    Args:
        plan: What was asked for.
        result: How it went.
        as_json: Print one JSON object.
        failures: What went wrong besides.

    Returns:
        The exit code.
    """
    if as_json:
        why = f"the controller never drove ({ended(result)})"
        print_json({**facts(plan, result), "task": NOT_DONE, "task_why": [why], **noted(failures)})
    else:
        said = "Not done: the controller never drove. There is nothing to compare: no report."
        tell(ended(result), f"\n{said}\n{account(result)}\n{busy(plan, result)}log     {plan.log}")
    return concluded(1, failures)


def tell_of_shadow(plan: Drive, result: RunResult, as_json: bool) -> int:
    """Tell of a run that only watched: what it would have commanded. The twin has nothing to be compared with.

    Args:
        plan: What was asked for.
        result: How it went.
        as_json: Print one JSON object.

    Returns:
        The exit code.
    """
    failures: list[Failure] = []
    commanded = reported(lambda: _commanded(plan), failures, plan.log) or []
    if as_json:
        print_json({**facts(plan, result), "stage": "shadow", "commanded": commanded, **noted(failures)})
    else:
        lines = [
            f"{row['joint']:8} {row['lowest_rad']:+.2f} to {row['highest_rad']:+.2f} rad (limits {joint.lower:+.2f} to "
            f"{joint.upper:+.2f}), at most {row['fastest_rad_s']:.1f} of {joint.slew:g} rad/s"
            for row, joint in zip(commanded, plan.setup.lamp.joints, strict=False)
        ]
        after = f"next    the same with --stage gentle --after {shlex.quote(str(plan.log))}"
        head = "; torque stayed off." + (" It would have commanded" if lines else "")
        said = "\n".join([head, *lines, account(result)])
        tell(ended(result), f"{said}\n{busy(plan, result)}log     {plan.log}\n{after}")
    return concluded(0 if result.ended == "finished" else 1, failures)


def _commanded(plan: Drive) -> list[dict[str, Any]]:
    """Return the range and greatest speed of what a run would have commanded, by joint."""
    run = read_run(plan.log)
    goals = run.goal[run.phase == "run"]
    speed = np.abs(np.diff(goals, axis=0)).max(axis=0, initial=0.0) / np.median(np.diff(run.scheduled))
    return [
        {
            "joint": joint.name,
            "lowest_rad": low,
            "highest_rad": high,
            "fastest_rad_s": fastest,
        }
        for joint, low, high, fastest in zip(
            plan.setup.lamp.joints, goals.min(axis=0), goals.max(axis=0), speed, strict=True
        )
    ]


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Let Ctrl-C, SIGTERM and SIGHUP raise KeyboardInterrupt."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in SIGNALS}
    try:
        yield
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
