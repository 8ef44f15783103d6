"""`robolamp odometer`: learns how far hops go from what the lamp measures, and says how well that holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import App, Parameter, validators
from rich.console import Console
from rich.table import Table

from robolamp.cli.options import Setup
from robolamp.cli.screen.output import counted, print_json
from robolamp.cli.screen.progress_bar import bar
from robolamp.controller.controller_file import Controller
from robolamp.errors import RobolampError
from robolamp.files import suffix_of
from robolamp.odometer import load_odometer, save_odometer

CONTROLLERS = (
    "hop-counting", "hop-sighted", "hop-bending", "hop-bending-sighted", "hop", "cycle-sighted", "luxo-1997",
)  # fmt: skip
"""What the shipped odometer is learnt from."""

_Lamps = Annotated[int, Parameter(validator=validators.Number(gte=10, lte=10_000))]
_Goals = Annotated[int, Parameter(validator=validators.Number(gte=1, lte=100))]
_Seed = Annotated[int, Parameter(validator=validators.Number(gte=0))]
_Workers = Annotated[int | None, Parameter(validator=validators.Number(gte=1))]
_Json = Annotated[bool, Parameter(name="--json", negative="")]

app = App(name="odometer", help_format="plaintext", result_action="return_value")


@app.command(sort_key=0)
def fit(
    *controllers: str,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    lamps: _Lamps = 400,
    goals: _Goals = 2,
    vary: Annotated[float, Parameter(validator=validators.Number(gte=0, lte=0.5))] = 0.08,
    hidden: Annotated[int, Parameter(validator=validators.Number(gte=1, lte=256))] = 32,
    seed: _Seed = 1,
    workers: _Workers = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    as_json: _Json = False,
) -> int:
    """Learn an odometer: let controllers hop on drawn lamps on the twin, and learn how far each hop went.

    Name the file as `odometer` in hardware/lamp.toml to use it.

    Args:
        controllers: Controller files, or names of shipped ones; by default the shipped hops.
        output: The file to write (.toml).
        lamps: How many lamps are drawn: most from sim/tasks/spread.toml, some of them half or 1.5 times as far off,
            some from spread-narrow.toml, and one in seventeen the calibrated lamp with the spread's play and stiffness.
        goals: How many goals for each controller on each lamp, 5 to 60 cm away.
        vary: Standard deviation by which constants of every other lamp's controller are changed.
        hidden: Size of the network's hidden layer.
        seed: Of lamps, goals, constants and the network.
        workers: Threads; by default one for each core.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    from robolamp.evolve import odometry

    if suffix_of(output) != ".toml":
        raise RobolampError(f"{str(output)!r} does not end in .toml", "--output")
    setup = Setup.of(lamp, calibration)
    drivers = _controllers(setup, controllers)
    rng = np.random.default_rng(seed)
    groups = odometry.lamps_of(setup.lamp, setup.calibration, setup.assets, lamps, rng)
    with bar("hopping", quiet=as_json) as done:
        steps = odometry.gather(
            setup.lamp, groups, drivers, goals, rng, vary=vary, workers=workers, done=lambda share: done(0.95 * share)
        )
        found = odometry.fit(steps, setup.lamp, drivers, hidden, seed)
    facts = {
        "command": _command(controllers, lamps, goals, vary, hidden, seed, calibration),
        "controllers": [driver.name for driver in drivers],
        "lamps": sum(len(group.twins) for group in groups),
        "learnt_from_steps": len(steps.length),
        "calibration_sha256": setup.calibration.hash,
    }
    save_odometer(odometry.with_facts(found, facts), output)
    _tell({"odometer": output, **facts, **found.scores}, as_json)
    return 0


@app.command(sort_key=1)
def score(
    *controllers: str,
    odometer: Path | None = None,
    lamps: _Lamps = 40,
    goals: _Goals = 8,
    seed: _Seed = 101,
    workers: _Workers = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    as_json: _Json = False,
) -> int:
    """Judge an odometer on lamps that it was not learnt from: how far off it is, and whether it knows.

    Args:
        controllers: Controller files, or names of shipped ones; by default the shipped hops.
        odometer: The odometer's file; by default the lamp's own, `odometer` in hardware/lamp.toml.
        lamps: How many lamps are drawn from sim/tasks/spread.toml.
        goals: How many goals for each controller on each lamp, 5 to 60 cm away.
        seed: Of lamps and goals.
        workers: Threads; by default one for each core.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    from robolamp.evolve import odometry

    setup = Setup.of(lamp, calibration)
    found = load_odometer(odometer) if odometer else setup.lamp.odometer
    if found is None:
        raise RobolampError("the lamp has none; name a file by --odometer", "odometer in hardware/lamp.toml")
    drivers, rng = _controllers(setup, controllers), np.random.default_rng(seed)
    group = odometry.drawn(setup.lamp, setup.calibration, setup.assets, "spread", 1.0, lamps, rng)
    with bar("hopping", quiet=as_json) as done:
        steps = odometry.gather(setup.lamp, [group], drivers, goals, rng, workers=workers, done=done)
    _tell({"odometer": odometer or "the lamp's", "lamps": lamps, **odometry.judge(found, steps, drivers)}, as_json)
    return 0


def _controllers(setup: Setup, names: tuple[str, ...]) -> list[Controller]:
    return [setup.controller(name) for name in names or CONTROLLERS]


def _command(
    controllers: tuple[str, ...], lamps: int, goals: int, vary: float, hidden: int, seed: int, calibration: str
) -> str:
    words = f"robolamp odometer fit {' '.join(controllers)}".rstrip()
    words += f" -o odometer.toml --lamps {lamps} --goals {goals} --vary {vary:g} --hidden {hidden} --seed {seed}"
    return words if calibration == "nominal" else f"{words} --calibration {calibration}"


def _tell(facts: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(facts)
        return
    console, table = Console(), Table(title_justify="left")
    for column in (
        "controller",
        "steps",
        "error of a step",
        "of a run",
        "runs within 1.5 cm",
        "error / said",
    ):
        table.add_column(column, justify="left" if column == "controller" else "right")
    for row in facts["by_controller"]:
        table.add_row(
            row["controller"], f"{row['steps']}", f"{1e3 * row['step_rms_m']:.1f} mm",
            f"{1e3 * row['run_median_m']:.1f} mm", f"{row['runs_within']:.0%}", f"{row['run_standardised']:.2f}",
        )  # fmt: skip
    console.print(table)
    lamps, unlike = counted(facts["lamps"], "lamp"), facts["unlike"]
    console.print(f"{lamps}; {unlike:.1%} of the steps are unlike those that it was learnt from")
