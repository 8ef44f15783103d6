"""`robolamp deploy`: a controller on the physical lamp."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators
from rich.console import Console

from robolamp.cli.options import Setup, length
from robolamp.cli.output import print_json


def deploy(
    controller: str,
    /,
    *,
    goal: str,
    port: str | None = None,
    foot_port: str | None = None,
    duration: Annotated[float, Parameter(validator=validators.Number(gte=0.5, lte=600))] = 5.0,
    calibration: str = "nominal",
    lamp: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run a controller on the physical lamp: soft start, hop, soft landing, torque off; then compare with the twin.

    Stand the lamp upright with room to hop and a hand near its plug. Ctrl-C lands it softly; a second Ctrl-C turns its
    torque off at once.

    Args:
        controller: A controller file, or the name of a shipped one (hop).
        goal: How far to go, as 0.30 (metres) or 30cm.
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        duration: How long the controller drives, in seconds.
        calibration: The twin's numbers: a file, or a name in calibration/.
        lamp: A folder of your own lamp, laid out like robolamp's.
        output: Folder for log and report; by default a new one in runs/.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, calibration)
    loaded = setup.controller(controller, on_board=True)
    distance = length(goal, "--goal")

    from robolamp.cli.drive import Drive, drive, run_folder  # noqa: PLC0415 (after the arguments are checked)
    from robolamp.compare.report import sentence  # noqa: PLC0415
    from robolamp.compare.run import compare_log  # noqa: PLC0415
    from robolamp.runtime.stop import StopRequest  # noqa: PLC0415

    folder = run_folder(output, loaded, distance)
    plan = Drive(setup, loaded, distance, duration, "lamp", folder / "log.mcap")
    with StopRequest() as stop:
        result = drive(plan, port or setup.lamp.bus_port, foot_port or setup.lamp.foot_port, stop, as_json)
    comparison = compare_log(plan.log, assets=setup.assets, calibration=setup.calibration, out=folder / "report.html")
    if as_json:
        print_json(
            {
                "goal_m": distance,
                "landed_m": None,
                "error_m": None,
                "hops": result.hops,
                "fell": None,
                "ended": result.ended,
                "ticks": result.ticks,
                "missed_ticks": result.missed_ticks,
                "faults": result.faults,
                "interventions": vars(result.interventions),
                "verdict": comparison.verdict,
                "log": plan.log,
                "report": comparison.report,
            }
        )
    else:
        faults = ", ".join(f"{text} (x{count})" for text, count in result.faults.items()) or "none"
        Console(highlight=False, soft_wrap=True).print(
            f"[bold]{result.ended}{': ' + result.reason if result.reason else ''}[/bold] after {result.hops} hops"
            f" (where it landed is for your ruler: nothing on the lamp measures it).\n"
            f"Ticks {result.ticks}, missed {result.missed_ticks}, envelope interventions"
            f" {result.interventions.total}, faults: {faults}.\n"
            f"Twin against lamp: {sentence(comparison)}\n"
            f"log     {plan.log}\nreport  {comparison.report}"
        )
    return 0 if result.ended == "finished" else 1
