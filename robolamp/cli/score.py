"""`robolamp score`: a controller on the twin, many goals (and lamps) at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter, validators
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robolamp.cli.options import DURATION, GOAL_TIME, Setup
from robolamp.cli.scoring.controller_stage import stage_of
from robolamp.cli.scoring.pole_options import pole_of
from robolamp.cli.scoring.score_figure import figure_keys, print_figure
from robolamp.cli.screen.output import called, counted, print_json
from robolamp.cli.screen.progress_bar import bar
from robolamp.errors import RobolampError
from robolamp.twin.judges.run_outcome import RunOutcome
from robolamp.twin.lamp_model import Pole, build
from robolamp.twin.variation.random_lamps import LampLaw

_GOALS = "0.05:0.60:56"  # [m]
_ROWS = 12  # of the table that a person reads; --json has every goal


def score(
    controller: str,
    /,
    *,
    goals: str | None = None,
    lamps: Annotated[int | None, Parameter(validator=validators.Number(gte=1, lte=1000))] = None,
    spread: Annotated[float | None, Parameter(validator=validators.Number(gte=0, lte=5))] = None,
    spread_file: str | None = None,
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
        With --lamps: factor on the spread, all its deviations (1).
    spread_file
        With --lamps: the spread, a file or a name in sim/tasks/ (spread; spread-narrow: six numbers of a rigid lamp).
    seed
        With --lamps: seed of the drawn lamps (1). For a figure other than the lamp: of the points.
    duration
        Length of each run in seconds (8, beyond 64 cm what the furthest goal takes at 8 cm/s; or the time limit of a
        figure's task).
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
        "--lamps": lamps, "--spread": spread, "--spread-file": spread_file, "--goal-time": goal_time, "--pole": pole,
        "--pole-at": pole_at,
        "--calibration": calibration != "nominal",
    }  # fmt: skip
    limbo = pole_of(pole, pole_at)
    stage = stage_of(setup, controller, task, lamp_alone, goal_time=goal_time, pole=limbo)
    drawn_from = ""
    if lamps is not None:
        law = LampLaw(setup.lamp, setup.calibration, setup.assets, spread_file or "spread")
        rng, scale = np.random.default_rng(1 if seed is None else seed), 1.0 if spread is None else spread
        drawn, drawn_from = [law.draw(rng, scale) for _ in range(lamps)], law.source
        twins = [build(setup.lamp, numbers, setup.assets, bend, pole=limbo) for numbers, bend in drawn]
        stage = replace(stage, twins=twins)
    elif stage.task is None:
        for option, given in (("--spread", spread), ("--spread-file", spread_file), ("--seed", seed)):
            if given is not None:
                raise RobolampError("is for lamps that are drawn; give --lamps, too", option)
    jobs = stage.jobs(goals, "--goals", _GOALS, seed)
    with bar("simulating", quiet=as_json) as done:
        outcome = stage.fleet(workers).run([stage.program], jobs, duration or stage.time(jobs), done=done)
    count = len(jobs) // len(stage.twins)
    shape = (count,) if lamps is None else (lamps, count)
    if as_json:
        lamp_keys = {
            "flight_share": outcome.flight_share.reshape(shape),
            "flight_share_median": _median(outcome.flight_share),
            **({"drawn_from": drawn_from} if drawn_from else {}),
            **({} if limbo is None else {"pole_hits": int(outcome.pole.sum())}),
        }
        print_json(
            {
                "controller": stage.controller.name,
                "origin": stage.controller.origin or None,
                "goals_m": outcome.goal[:count],
                "errors_m": outcome.error.reshape(shape),
                "hops": outcome.hops.astype(int).reshape(shape),
                **(lamp_keys if stage.task is None else figure_keys(stage.task, outcome)),
                "hits": int(outcome.hit.sum()),
                "hits_1997": int(outcome.hit_1997.sum()),
                "falls": int(outcome.fallen.sum()),
                "runs": len(jobs),
                "unstable": int(outcome.unstable.sum()),
                "upright": int(outcome.upright.sum()),
                "median_abs_error_m": np.median(np.abs(outcome.error)),
            }
        )
    elif stage.task is None:
        _print(called(stage.controller), outcome, len(stage.twins), drawn_from, limbo)
    else:
        print_figure(called(stage.controller), stage.task, outcome)
    return 0


def _print(name: str, outcome: RunOutcome, lamps: int, drawn: str, pole: Pole | None) -> None:
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
    distances = outcome.goal[: runs // lamps]
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
