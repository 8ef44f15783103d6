"""`robolamp dry-run`: a controller on the emulated lamp, through real serial ports."""

from __future__ import annotations

import contextlib
import json as json_module
import select
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from rich.console import Console

from robolamp.cli.options import DURATION, GOAL_TIME, Setup, length
from robolamp.cli.output import print_json
from robolamp.controller.file import check_goal_time
from robolamp.errors import BusError

_READY_TIMEOUT = 60.0  # the emulator compiles its friction kernel on its first start [s]


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
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run a controller on the emulated lamp: the same loop as deploy, through real serial ports, with log and report.

    Args:
        controller: A controller file, or the name of a shipped one (hop).
        goal: How far to go, as 0.30 (metres) or 30cm.
        goal_time: Time to take for the way in seconds, for a controller that reads goal_time.
        duration: How long the controller drives, in seconds.
        reality: How the emulated lamp differs from its twin: none, a file, or the name of one (worn);
            random:SEED: everything differs; knob:KIND:SEED: one thing does, as knob:backlash:7.
        calibration: The twin's numbers: a file, or a name in calibration/.
        lamp: A folder of your own lamp, laid out like robolamp's.
        faults: A TOML script of what goes wrong on the emulated bus; what was injected goes to injections.jsonl.
        lockstep: In one process and virtual time: faster than real time, and the same numbers each time.
        output: Folder for log, truth and report; by default a new one in runs/.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, calibration)
    loaded = setup.controller(controller, on_board=True)
    check_goal_time(loaded, goal_time)
    distance = length(goal, "--goal")

    from robolamp.cli.drive import Drive, drive, run_folder  # after the arguments are checked
    from robolamp.cli.outcome import account, ended, facts, reporting, tell, tell_of_none, tidying
    from robolamp.cli.parts import told
    from robolamp.compare.run import compare_log
    from robolamp.emulator.faults import Faults, load_faults
    from robolamp.emulator.reality import load_reality
    from robolamp.log.reader import read_run, read_truth
    from robolamp.runtime.stop import StopRequest

    bent = load_reality(reality, setup.lamp, setup.assets)  # refused here in one line, not by the emulator
    script = load_faults(faults, tuple(joint.id for joint in setup.lamp.joints)) if faults else Faults("none")
    folder = run_folder(output, loaded, distance)
    log, truth_log, injections = folder / "log.mcap", folder / "truth.mcap", folder / "injections.jsonl"
    console = Console(quiet=as_json, highlight=False, soft_wrap=True)
    plan = Drive(setup, loaded, distance, duration, "emulator", log, goal_time)
    goes = f"{loaded.name} goes {distance:.2f} m."
    with tidying(plan, truth_log, injections), StopRequest() as stop:
        if lockstep:
            from robolamp.cli.lockstep import lockstep_lamp

            console.print(f"Emulated lamp (reality: {reality}) in lockstep; {goes}", markup=False)
            with lockstep_lamp(setup, bent, script, truth_log, injections if faults else None) as (ports, virtual):
                result = drive(plan, ports.servo_port, ports.foot_port, stop, as_json, virtual)
        else:
            options = ["--reality", reality, "--calibration", calibration, "--truth", str(truth_log)]
            if lamp is not None:
                options += ["--lamp", str(lamp)]
            if faults is not None:
                folder.mkdir(parents=True, exist_ok=True)
                options += ["--faults", str(faults), "--injections", str(injections), "--ports", str(folder)]
            with _emulator(options) as ports:
                console.print(
                    f"Emulated lamp (reality: {reality}) on {ports['servo_port']} and {ports['foot_port']}; {goes}",
                    markup=False,
                )
                result = drive(plan, ports["servo_port"], ports["foot_port"], stop, as_json)
    if not plan.phases["run"]:
        return tell_of_none(plan, result, as_json)
    with reporting(log):
        truth = read_truth(truth_log)
        run = read_run(log)
        at = run.at(truth.log_time)
        driven = np.flatnonzero(run.phase == "run")
        began = run.scheduled[driven[0]] if len(driven) else run.scheduled[0]
        during = (at >= began) & (at <= run.write_done[-1])
        landed = float(truth.base_x[during][-1] - truth.base_x[during][0]) if during.any() else float("nan")
        fell = bool(truth.fallen[during].any())
        comparison = compare_log(
            log, assets=setup.assets, calibration=setup.calibration, out=folder / "report.html", truth=truth_log
        )
    if as_json:
        print_json(
            {
                **facts(plan, result),
                "landed_m": landed,
                "error_m": landed - distance,
                "fell": fell,
                **comparison.parts(),
                "truth": truth_log,
                "injections": injections if faults else None,
                "report": comparison.report,
            }
        )
    else:
        word, rest = told(comparison)
        tell(
            word,
            f"{rest}\nRun {ended(result)}. {account(result)}\n"
            f"log     {log}\ntruth   {truth_log}\nreport  {comparison.report}"
            + (f"\ninjected {injections}" if faults else ""),
        )
    return 0 if result.ended == "finished" and not fell else 1


@contextlib.contextmanager
def _emulator(options: list[str]) -> Iterator[dict[str, str]]:
    """Start an emulated lamp in a process of its own, yield its ports, and end it."""
    command = [sys.executable, "-m", "robolamp", "emulate", "--json", *options]
    # A session of its own: Ctrl-C lands the lamp first, and only then is the emulator ended.
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stdout is not None
    try:
        ready, _, _ = select.select([process.stdout], [], [], _READY_TIMEOUT)
        line = process.stdout.readline() if ready else ""
        try:
            said = json_module.loads(line)
        except ValueError:
            said = {"error": f"did not start (it said {line.strip()!r})", "where": ""}
        if "error" in said:
            raise BusError(said["error"], said["where"] or "emulator")
        yield said
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()
