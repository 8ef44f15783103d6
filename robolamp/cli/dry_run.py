"""`robolamp dry-run`: a controller on the emulated lamp, through real serial ports."""

from __future__ import annotations

import contextlib
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter
from rich.console import Console

from robolamp.cli.options import DURATION, GOAL_TIME, Setup, length
from robolamp.cli.screen.output import print_json
from robolamp.controller.controller_file import check_goal_time
from robolamp.errors import RobolampError

if TYPE_CHECKING:
    from robolamp.cli.run.drive import Drive
    from robolamp.emulator.faults.script import Faults
    from robolamp.emulator.reality.file import Reality
    from robolamp.runtime.result import RunResult
    from robolamp.runtime.stop import StopRequest

_CUT = ".cut"  # suffix of what a run leaves behind that this computer cut: no log of the lamp any more


def dry_run(
    controller: str,
    /,
    *,
    goal: str,
    goal_time: Annotated[float | None, GOAL_TIME] = None,
    duration: Annotated[float, DURATION] = 5.0,
    reality: str = "worn",
    calibration: str = "nominal",
    lamp: Path | None = None,
    faults: Path | None = None,
    lockstep: Annotated[bool, Parameter(negative="")] = False,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    browse: Annotated[bool, Parameter(name="--open", negative="")] = False,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run a controller on the emulated lamp: the same loop as deploy, through real serial ports, with log and report.

    Where this computer is too busy for real time, so that it and not the lamp ends the run, the run is repeated in
    lockstep, which says so; one with --faults is not.

    Args:
        controller: A controller file, or the name of a shipped one (hop).
        goal: How far to go, as 0.30 (metres) or 30cm.
        goal_time: Time to take for the way in seconds, for a controller that reads goal_time.
        duration: How long the controller drives, in seconds.
        reality: Reality, which says how the emulated lamp differs from its twin: none, a file, or the name of one
            (worn); random:SEED: everything differs; knob:KIND:SEED: one number does, as knob:backlash:7.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        faults: A TOML script of faults on the emulated bus; injections.jsonl lists those that were injected.
        lockstep: Run lamp and loop by turns in one process, in virtual time: fast, and the same numbers each time.
        output: Folder for log, truth log and report; by default a new one in runs/.
        browse: Play the run in the browser at the end, where there is a terminal and a display.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, calibration)
    loaded = setup.controller(controller, on_board=True)
    check_goal_time(loaded, goal_time)
    distance = length(goal, "--goal")

    from robolamp.cli.run.drive import Drive, run_folder  # after the arguments are checked
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
    from robolamp.compare.tolerances import load_tolerances
    from robolamp.emulator.faults.script import Faults, load_faults
    from robolamp.emulator.reality.file import load_reality
    from robolamp.runtime.stop import StopRequest

    bent = load_reality(reality, setup.lamp, setup.assets)  # refused here in one line, not by the emulator
    script = load_faults(faults, tuple(joint.id for joint in setup.lamp.joints)) if faults else Faults("none")
    allowed = load_tolerances(setup.assets)
    folder = run_folder(output, loaded, distance)
    log, truth_log, injections = folder / "log.mcap", folder / "truth.mcap", folder / "injections.jsonl"
    console = Console(quiet=as_json, highlight=False, soft_wrap=True)
    plan = Drive(setup, loaded, distance, duration, "emulator", log, goal_time)
    lamps = _Lamps(plan, console, reality, bent, script, truth_log, injections if faults else None)
    failures: list[Failure] = []
    with tidying(plan, truth_log, injections), StopRequest() as stop:
        if lockstep:
            result = lamps.in_lockstep(stop)
        else:
            options = ["--reality", reality, "--calibration", calibration, "--truth", str(truth_log)]
            if lamp is not None:
                options += ["--lamp", str(lamp)]
            if faults is not None:
                folder.mkdir(parents=True, exist_ok=True)
                options += ["--faults", str(faults), "--injections", str(injections), "--ports", str(folder)]
            result = lamps.in_real_time(options, stop)
    if lamps.failed:
        failures.append(Failure(lamps.failed.message, lamps.failed.where))
    if not plan.phases["run"]:
        return tell_of_none(plan, result, as_json, failures)
    course = None if lamps.failed else reported(lambda: _course(log, truth_log), failures, log)
    comparison = reported(
        lambda: compared(plan, folder / "report.html", allowed, truth_log if course else None), failures, log
    )
    landed, fell = (course[0], course[1] is not None) if course else (float("nan"), None)
    if as_json:
        print_json(
            {
                **facts(plan, result),
                "landed_m": landed,
                "error_m": landed - distance,
                "fell": fell,
                **(comparison.parts if comparison else {}),
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
            off = f"{(landed - distance) * 100:+.1f} cm"
            rest = f" for a goal of {distance * 100:.1f} cm ({off}); {ended(result)}.\n{account(result)}\n"
        else:
            headline = "Where it landed is not known"
            rest = f" (goal {distance * 100:.1f} cm); {ended(result)}.\n{account(result)}\n"
        own = ["--lamp", str(lamp)] if lamp else []
        own += ["--calibration", calibration] if calibration != "nominal" else []
        again = shlex.join(["robolamp", "replay", str(log), *own])
        tell(
            headline,
            rest
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
        from robolamp.cli.run.drive import drive
        from robolamp.cli.run.lockstep import LockstepLamp

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
        from robolamp.cli.run.drive import drive
        from robolamp.cli.run.emulator_process import EmulatorProcess
        from robolamp.cli.run.witness import judged
        from robolamp.robot.connection import Connection
        from robolamp.runtime.clock import MonotonicClock

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
        return f"{self.plan.controller.name} is sent {self.plan.goal * 100:.1f} cm."

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
    from robolamp.log.reader import read_run, read_truth

    truth = read_truth(truth_log)
    run = read_run(log)
    at = run.at(truth.log_time)
    driven = np.flatnonzero(run.phase == "run")
    began = run.scheduled[driven[0]] if len(driven) else run.scheduled[0]
    during = (at >= began) & (at <= run.write_done[-1])
    landed = float(truth.base_x[during][-1] - truth.base_x[during][0]) if during.any() else float("nan")
    falls = at[during & truth.fallen]
    return landed, float(falls[0]) if falls.size else None
