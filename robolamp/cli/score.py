"""`robolamp score`: a controller on the twin, many goals (and lamps) at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter, validators
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robolamp.cli.bar import bar
from robolamp.cli.figures import stage_of
from robolamp.cli.options import DURATION, GOAL_TIME, Setup, goal_range
from robolamp.cli.output import called, counted, print_json
from robolamp.cli.pole import pole_of
from robolamp.controller.file import check_goal_time
from robolamp.controller.terminals import all_terminals
from robolamp.errors import RobolampError
from robolamp.twin.drawn import LampLaw
from robolamp.twin.fleet import Fleet, Job
from robolamp.twin.judge import Outcome
from robolamp.twin.model import Pole, build

_LANES_AT_ONCE = 6000  # about 67 MB of simulation state
_GOALS, _DURATION = "0.05:0.60:56", 5.0  # [m], [s]
_ROWS = 12  # of the table that a person reads; --json has every goal


def score(
    controller: str,
    /,
    *,
    goals: str | None = None,
    lamps: Annotated[int | None, Parameter(validator=validators.Number(gte=1, lte=1000))] = None,
    spread: Annotated[float | None, Parameter(validator=validators.Number(gte=0, lte=5))] = None,
    seed: Annotated[int | None, Parameter(validator=validators.Number(gte=0))] = None,
    duration: Annotated[float | None, DURATION] = None,
    goal_time: Annotated[float | None, GOAL_TIME] = None,
    pole: str | None = None,
    pole_at: str | None = None,
    task: str | None = None,
    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Score a controller on the twin: where it lands, how it gets there, whether it falls.

    Parameters
    ----------
    controller
        A controller file, or the name of a shipped one (hop).
    goals
        One goal, or LOW:HIGH:COUNT, in metres (0.05:0.60:56). For a figure other than the lamp: X,Y, or
        LOW:HIGH:COUNT, COUNT points all around, LOW to HIGH away; by default the goals of its task.
    lamps
        Instead of the calibrated lamp, this many lamps drawn from the spread, sim/tasks/spread.toml, and from the
        calibration's covariance if it was fitted (sim/tasks/README.md).
    spread
        With --lamps: factor on the spread, all its standard deviations (1).
    seed
        With --lamps: seed of the drawn lamps (1). For a figure other than the lamp: of the points.
    duration
        Length of each run in seconds (5, or the time limit of a figure's task).
    goal_time
        Time to take for the way in seconds, for a controller that reads goal_time.
    pole
        Limbo: height of the lower edge of a pole across the way, as 0.20 (metres) or 20cm.
    pole_at
        With --pole: its distance ahead of the lamp's start (20cm).
    task
        For a figure other than the lamp: the task it is scored in (file or name); without it, the task.toml beside the
        controller, or the task that it was evolved for.
    workers
        Threads; by default one for each core.
    calibration
        Calibration, the twin's numbers: a file, or a name in calibration/.
    lamp
        Folder of your own lamp, as `robolamp new` makes it.
    as_json
        Print one JSON object: origin (evolved, tuned, by hand); goals_m, errors_m, hops, flight_share (for a figure
        directions_rad, fitness, collided) a goal (and lamp); hits, hits_1997, falls, upright, pole_hits.
    """
    setup = Setup.of(lamp, calibration)
    lamp_alone = {
        "--lamps": lamps, "--spread": spread, "--goal-time": goal_time, "--pole": pole, "--pole-at": pole_at,
        "--calibration": calibration != "nominal",
    }  # fmt: skip
    stage = stage_of(setup, controller, task, lamp_alone)
    if stage is not None:
        from robolamp.cli.score_figure import score_figure

        return score_figure(stage, goals, seed, duration, workers, as_json)
    for option, given in (("--spread", spread), ("--seed", seed)):
        if given is not None and lamps is None:
            raise RobolampError("is for lamps that are drawn; give --lamps, too", option)
    loaded = setup.controller(controller)
    check_goal_time(loaded, goal_time)
    limbo = pole_of(pole, pole_at)
    distances = goal_range(goals or _GOALS, "--goals")
    joints = len(setup.lamp.joints)
    drawn, drawn_from = [(setup.calibration, None)], ""
    if lamps is not None:
        law = LampLaw(setup.lamp, setup.calibration, setup.assets)
        rng, scale = np.random.default_rng(1 if seed is None else seed), 1.0 if spread is None else spread
        drawn, drawn_from = [law.draw(rng, scale) for _ in range(lamps)], law.source
    twins = [build(setup.lamp, numbers, setup.assets, bend, pole=limbo) for numbers, bend in drawn]
    fleet = Fleet(twins, loaded.control_period, workers)
    program = loaded.compile(all_terminals(joints))
    jobs = [Job(0, variant, float(goal), goal_time or 0.0) for variant in range(len(twins)) for goal in distances]
    parts = [jobs[start : start + _LANES_AT_ONCE] for start in range(0, len(jobs), _LANES_AT_ONCE)]
    with bar("simulating", quiet=as_json) as share:
        outcomes = [
            fleet.run(
                [program], part, duration or _DURATION, done=lambda of, number=number: share((number + of) / len(parts))
            )
            for number, part in enumerate(parts)
        ]
    outcome = Outcome.join(outcomes)
    shape = (len(distances),) if lamps is None else (lamps, len(distances))
    if as_json:
        print_json(
            {
                "controller": loaded.name,
                "origin": loaded.origin or None,
                "goals_m": distances,
                "errors_m": outcome.error.reshape(shape),
                "hops": outcome.hops.astype(int).reshape(shape),
                "flight_share": outcome.flight_share.reshape(shape),
                "hits": int(outcome.hit.sum()),
                "hits_1997": int(outcome.hit_1997.sum()),
                "falls": int(outcome.fallen.sum()),
                "runs": len(jobs),
                "unstable": int(outcome.unstable.sum()),
                "upright": int(outcome.upright.sum()),
                "median_abs_error_m": np.median(np.abs(outcome.error)),
                "flight_share_median": _median(outcome.flight_share),
                **({"drawn_from": drawn_from} if drawn_from else {}),
                **({} if limbo is None else {"pole_hits": int(outcome.pole.sum())}),
            }
        )
        return 0
    _print(called(loaded), distances, outcome, len(twins), drawn_from, limbo)
    return 0


def _print(name: str, distances: np.ndarray, outcome: Outcome, lamps: int, drawn: str, pole: Pole | None) -> None:
    title = f"{name} on the twin" + (f", {counted(lamps, 'lamp')} drawn from {drawn}" if drawn else "")
    if pole is not None:
        title += f", a pole {pole.height * 100:.1f} cm high at {pole.x * 100:.0f} cm"
    table = Table(title=Text(title, "italic"), title_justify="left")
    columns = ("goal", "median error", "worst error", "hops", "flight share", "falls", "hits")
    for column in columns if pole is None else (*columns, "pole hits"):
        table.add_column(column, justify="right")
    runs = len(outcome.goal)
    error, share = outcome.error.reshape(lamps, -1), outcome.flight_share.reshape(lamps, -1)
    hops = outcome.hops.reshape(lamps, -1)
    fallen, hit = outcome.fallen.reshape(lamps, -1), outcome.hit.reshape(lamps, -1)
    touched = outcome.pole.reshape(lamps, -1)
    shown = np.unique(np.linspace(0, len(distances) - 1, _ROWS).round().astype(int))
    for index in shown:
        own = error[:, index]
        table.add_row(
            f"{distances[index] * 100:.1f} cm",
            f"{np.median(own) * 100:+.1f} cm",
            f"{own[np.argmax(np.abs(own))] * 100:+.1f} cm",
            f"{np.median(hops[:, index]):.0f}",
            _share(share[:, index]),
            f"{fallen[:, index].sum()}",
            f"{hit[:, index].sum()}",
            *([] if pole is None else [f"{touched[:, index].sum()}"]),
        )
    console = Console(highlight=False)
    console.print(table)
    some = f"{len(shown)} of {len(distances)} goals are shown; " if len(shown) < len(distances) else ""
    console.print(f"{some}an error below 0 is short of the goal.".capitalize(), style="dim")
    hits, falls = counted(outcome.hit.sum(), "hit"), counted(outcome.fallen.sum(), "fall")
    poles = "" if pole is None else f", {counted(outcome.pole.sum(), 'pole hit')}"
    console.print(
        f"{counted(runs, 'run')}: {hits} (at rest within 1.5 cm, upright), {outcome.hit_1997.sum()} came within"
        f" 1.5 cm, {falls}{poles}; median |error| {np.median(np.abs(outcome.error)) * 100:.1f} cm,"
        f" median flight share {_share(outcome.flight_share)}.",
        soft_wrap=True,
    )


def _median(values: np.ndarray) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else float("nan")


def _share(values: np.ndarray) -> str:
    median = _median(values)
    return "-" if np.isnan(median) else f"{median:.2f}"
