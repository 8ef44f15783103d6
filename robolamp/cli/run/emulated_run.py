"""A run on the emulated lamp, from the ports to the report: what dry-run, `gesture play` and `play` do."""

from __future__ import annotations

import contextlib
import math
import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Act, Drive, drive, run_folder
from robolamp.cli.run.emulator_process import EmulatorProcess
from robolamp.cli.run.followed import followed
from robolamp.cli.run.lockstep import LockstepLamp
from robolamp.cli.run.outcome import (
    Failure,
    account,
    busy,
    compared,
    concluded,
    ended,
    facts,
    noted,
    reported,
    tell,
    tell_of_none,
    tidying,
)
from robolamp.cli.run.witness import judged
from robolamp.cli.screen.output import print_json
from robolamp.compare.verdicts.tolerances import load_tolerances
from robolamp.controller.controller_file import Controller
from robolamp.emulator.faults.script import Faults, load_faults
from robolamp.emulator.reality.file import Reality, load_reality
from robolamp.errors import RobolampError
from robolamp.log.reader import read_run, read_truth
from robolamp.robot.connection import Connection
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import StopRequest

_CUT = ".cut"  # suffix of what a run leaves behind that this computer cut: no log of the lamp any more


@dataclass(frozen=True)
class EmulatedRun:
    """On which emulated lamp, and how.

    Attributes:
        setup: The lamp and its twin's numbers.
        reality: How the emulated lamp differs from its twin, as `--reality` takes it.
        faults: Script of faults on the emulated bus; None: there are none.
        lockstep: Whether lamp and loop run by turns, in virtual time.
    """

    setup: Setup
    reality: str
    faults: Path | None = None
    lockstep: bool = False


def run_emulated(
    how: EmulatedRun,
    act: Controller | Act,
    goal: float,
    duration: float,
    goal_time: float | None = None,
    *,
    output: Path | None,
    browse: bool,
    as_json: bool,
) -> int:
    """Run a controller or another act on the emulated lamp, compare the run with the twin, and tell of it.

    Args:
        how: On which lamp.
        act: What drives.
        goal: Commanded distance [m]; NaN: none is.
        duration: How long it drives [s].
        goal_time: Commanded time to take for the way [s].
        output: Folder of the run; None: a new one in runs/.
        browse: Play the run in the browser at the end.
        as_json: Print one JSON object.

    Returns:
        The exit code.

    Raises:
        RobolampError: It cannot be run.
    """
    setup, faults = how.setup, how.faults
    bent = load_reality(how.reality, setup.lamp, setup.assets)  # refused here in one line, not by the emulator
    script = load_faults(faults, tuple(joint.id for joint in setup.lamp.joints)) if faults else Faults("none")
    allowed = load_tolerances(setup.assets)
    folder = run_folder(output, act.name, goal)
    log, truth_log, injections = folder / "log.mcap", folder / "truth.mcap", folder / "injections.jsonl"
    console = Console(quiet=as_json, highlight=False, soft_wrap=True)
    plan = Drive(setup, act, goal, duration, "emulator", log, goal_time)
    lamps = _Lamps(plan, console, how.reality, bent, script, truth_log, injections if faults else None)
    failures: list[Failure] = []
    with tidying(plan, truth_log, injections), StopRequest() as stop:
        if how.lockstep:
            result = lamps.in_lockstep(stop)
        else:
            options = ["--reality", how.reality, "--truth", str(truth_log), *setup.words]
            if faults is not None:
                folder.mkdir(parents=True, exist_ok=True)
                options += ["--faults", str(faults), "--injections", str(injections), "--ports", str(folder)]
            result = lamps.in_real_time(options, stop)
    if lamps.failed:
        failures.append(Failure(lamps.failed.message, lamps.failed.where))
    if not plan.phases["run"]:
        return tell_of_none(plan, result, as_json, failures)
    course = None if lamps.failed else reported(lambda: _course(log, truth_log), failures, log)
    plays = followed(plan, failures)
    comparison = reported(
        lambda: compared(plan, folder / "report.html", allowed, truth_log if course else None), failures, log
    )
    landed, fell = (course[0], course[1] is not None) if course else (float("nan"), None)
    if as_json:
        print_json(
            {
                **facts(plan, result),
                "landed_m": landed,
                "error_m": landed - goal,
                "fell": fell,
                **(comparison.parts if comparison else {}),
                **plays.facts,
                "truth": truth_log,
                "injections": injections if faults else None,
                "report": comparison and comparison.report,
                **noted(failures),
            }
        )
    else:
        if comparison:
            headline, rest = comparison.word, f"{comparison.text}\nRun {ended(result)}. {account(result)}\n"
        elif course:
            headline = f"{'Fell' if fell else 'Landed'} at {landed * 100:.1f} cm"
            off = f"{(landed - goal) * 100:+.1f} cm"
            sent = "" if math.isnan(goal) else f" for a goal of {goal * 100:.1f} cm ({off})"
            rest = f"{sent}; {ended(result)}.\n{account(result)}\n"
        else:
            headline = "Where it landed is not known"
            sent = "" if math.isnan(goal) else f" (goal {goal * 100:.1f} cm)"
            rest = f"{sent}; {ended(result)}.\n{account(result)}\n"
        again = shlex.join(["robolamp", "replay", str(log), *setup.words])
        tell(
            headline,
            rest
            + plays.text
            + busy(plan, result)
            + f"log     {log}\ntruth   {truth_log}"
            + (f"\nreport  {comparison.report}" if comparison else "")
            + (f"\ninjected {injections}" if faults else "")
            + (f"\nreplay  {again}" if comparison else ""),
        )
        if browse and not failures:
            from robolamp.cli.replay import show

            reported(lambda: show(log, setup, folder / "replay.html"), failures, log)
    return concluded(0 if result.ended == "finished" and fell is False else 1, failures)


@dataclass
class _Lamps:
    """The emulated lamp that a plan is carried out on: in real time, or in lockstep.

    Attributes:
        plan: What to do.
        console: Where to say what is done.
        name: Of the reality.
        reality: How the lamp differs from its twin.
        faults: What goes wrong.
        truth: File for what really happens.
        injections: File for what was injected; None: nowhere.
        failed: What went wrong with the emulator or its logs; None: nothing did.
    """

    plan: Drive
    console: Console
    name: str
    reality: Reality
    faults: Faults
    truth: Path
    injections: Path | None
    failed: RobolampError | None = None

    def in_lockstep(self, stop: StopRequest) -> RunResult:
        """Run in this process and in virtual time."""
        self.plan.host.lockstep = True
        self.console.print(f"Emulated lamp {self._bent} in lockstep; {self._goes}", markup=False)
        with LockstepLamp(self.plan.setup, self.reality, self.faults, self.truth, self.injections) as lamp:
            result = drive(self.plan, lamp.ports, stop, self.console.quiet)
        self.failed = lamp.failed
        return result

    def in_real_time(self, options: list[str], stop: StopRequest) -> RunResult:
        """Run behind serial ports, and in lockstep after that if this computer was too late for it.

        Args:
            options: Of the emulator.
            stop: Requests to stop.
        """
        plan = self.plan
        result: RunResult | None = None
        refusal: RobolampError | None = None
        emulator = EmulatorProcess(options, stop, self._waiting)
        with emulator:
            where = f"on {emulator.servo_port} and {emulator.foot_port}"
            self.console.print(f"Emulated lamp {self._bent} {where}; {self._goes}", markup=False)
            try:
                ports = Connection.real(emulator.servo_port, emulator.foot_port, MonotonicClock())
                result = drive(plan, ports, stop, self.console.quiet)
            except RobolampError as error:
                refusal = error
        self.failed = emulator.failed
        host = plan.host
        fell = None
        if result and plan.phases["run"] and not self.failed:
            with contextlib.suppress(RobolampError):  # it is read again, where what fails is told
                fell = _course(plan.log, self.truth)[1]
        ended = result.ended if result else "cut"
        host.busy = judged(plan.watch, emulator.late, ended, host.patience, fell)
        if not self.failed and host.busy.ended_it and not stop.requests and self.injections is None:
            self._set_aside()
            what = "cut the run" if fell is None else "let the lamp fall"
            self.console.print(f"{host.busy}, which {what}; going on in lockstep.", markup=False)
            return self.in_lockstep(stop)
        if result is None:
            assert refusal is not None
            if host.busy.ended_it:
                refusal.message += f". {host.busy}"
            raise self.failed or refusal
        return result

    @property
    def _goes(self) -> str:
        goal = self.plan.goal
        return f"{self.plan.act.name} is {'played' if math.isnan(goal) else f'sent {goal * 100:.1f} cm'}."

    @property
    def _bent(self) -> str:
        differs = self.name != "none"
        return f"(reality: {self.name}{', so not quite its twin; --reality none: as its twin' * differs})"

    def _waiting(self) -> None:
        self.console.print("Starting the emulated lamp; the first start compiles its physics.")

    def _set_aside(self) -> None:
        """Keep what the run left behind that this computer cut, under names that nobody takes for the lamp's log."""
        for path in (self.plan.log, self.truth):
            with contextlib.suppress(OSError):  # a run that was refused has no log
                path.replace(path.with_name(path.name + _CUT))
        cut = self.plan.log.with_name(self.plan.log.name + _CUT)
        self.plan.host.cut = cut if cut.is_file() else None
        self.plan.phases.clear()


def _course(log: Path, truth_log: Path) -> tuple[float, float | None]:
    """Return how far the emulated lamp truly came [m], and when it fell, on the run's clock [s]; None: it stands."""
    truth = read_truth(truth_log)
    run = read_run(log)
    at = run.at(truth.log_time)
    driven = np.flatnonzero(run.phase == "run")
    began = run.scheduled[driven[0]] if len(driven) else run.scheduled[0]
    during = (at >= began) & (at <= run.write_done[-1])
    landed = float(truth.base_x[during][-1] - truth.base_x[during][0]) if during.any() else float("nan")
    falls = at[during & truth.fallen]
    return landed, float(falls[0]) if falls.size else None
