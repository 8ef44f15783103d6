"""`robolamp render`: a run as a picture strip or an animation."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from PIL import Image

from robolamp.cli.figures import Stage, stage_of
from robolamp.cli.options import GOAL_TIME, Setup, length, seconds
from robolamp.cli.output import print_json
from robolamp.cli.pole import pole_of
from robolamp.controller.file import Controller, check_goal_time
from robolamp.controller.terminals import all_terminals, figure_terminals
from robolamp.errors import RobolampError
from robolamp.files import write_atomic
from robolamp.twin.arena import FigureFleet
from robolamp.twin.figure import FigureTwin
from robolamp.twin.fleet import Fleet, Job
from robolamp.twin.model import Pole, TwinModel, build
from robolamp.twin.playback import play, play_figure
from robolamp.twin.render import animation, strip

_GOAL, _DURATION = "0.30", 5.0  # [m], [s]
_POSES = 8  # of a strip
_FRAME = 0.04  # time between the pictures of an animation [s]
_AFTER = 0.5  # how much of the rest after the motion is shown [s]


def render(
    run: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    goal: str | None = None,
    duration: Annotated[float | None, Parameter(validator=seconds(0.5, 60.0))] = None,
    goal_time: Annotated[float | None, GOAL_TIME] = None,
    pole: str | None = None,
    pole_at: str | None = None,
    task: str | None = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    opengl: bool = True,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Draw a controller at work on the twin, or the twin replaying a log.

    Args:
        run: A controller (file or shipped name), or a log (.mcap).
        output: The picture: .png for a strip of poses, .gif for an animation in real time.
        goal: How far a controller is sent, as 0.30 (metres, the default) or 30cm; a log has its own. For a figure other
            than the lamp: X,Y in metres; without it, the first goal of its task.
        duration: How long a controller drives, in seconds (5, or the time limit of a figure's task).
        goal_time: Time to take for the way in seconds, for a controller that reads goal_time.
        pole: Limbo: height of the lower edge of a pole across the way, as 0.20 (metres) or 20cm.
        pole_at: With --pole: its distance ahead of the lamp's start (20cm).
        task: For a figure other than the lamp: the task it is in (file or name); without it, the task.toml beside the
            controller, or the task that it was evolved for.
        calibration: The twin's numbers: a file, or a name in calibration/.
        lamp: A folder of your own lamp, laid out like robolamp's.
        opengl: Without it, draw side views of the links even where OpenGL is to be had.
        as_json: Print one JSON object.
    """
    if output.suffix not in (".png", ".gif"):
        raise RobolampError(f"{output.name!r} does not end in .png or .gif", "--output")
    setup = Setup.of(lamp, calibration)
    limbo = pole_of(pole, pole_at)
    lamp_alone = {
        "--goal-time": goal_time, "--pole": pole, "--pole-at": pole_at, "--calibration": calibration != "nominal",
    }  # fmt: skip
    stage, point = stage_of(setup, run, task, lamp_alone), None
    if stage is not None:
        twin, time, qpos, point = _staged(stage, goal, duration)
    elif run.endswith(".mcap"):
        if limbo is not None:
            raise RobolampError("is for a controller; no log has a pole", "--pole")
        twin, time, qpos = _replayed(run, setup)
    else:
        controller = setup.controller(run)
        check_goal_time(controller, goal_time)
        job = Job(0, 0, length(goal or _GOAL, "--goal"), goal_time or 0.0)
        twin, time, qpos = _driven(controller, setup, limbo, job, duration or _DURATION)
    shown = _moving(time, qpos)
    time, qpos = time[shown] - time[shown][0], qpos[shown]
    stream = io.BytesIO()
    if output.suffix == ".png":
        picked = np.linspace(0, len(time) - 1, _POSES).round().astype(int)
        labels = [f"{time[i]:.2f} s   {100 * _travel(qpos, stage is not None)[i]:.1f} cm" for i in picked]
        Image.fromarray(strip(twin, qpos[picked], labels, opengl=opengl, point=point)).save(
            stream, "PNG", optimize=True
        )
    else:
        frames = np.searchsorted(time, np.arange(0.0, time[-1], _FRAME))
        pictures = [Image.fromarray(picture) for picture in animation(twin, qpos[frames], opengl=opengl, point=point)]
        pictures[0].save(stream, "GIF", save_all=True, append_images=pictures[1:], duration=1000 * _FRAME, loop=0)
    write_atomic(output, stream.getvalue())
    if as_json:
        print_json({"picture": output, "duration_s": time[-1], "travel_m": _travel(qpos, stage is not None)[-1]})
    else:
        print(output)
    return 0


def _driven(
    controller: Controller, setup: Setup, pole: Pole | None, job: Job, duration: float
) -> tuple[TwinModel, NDArray[np.float64], NDArray[np.float64]]:
    """Return what `score` scores, as positions: a run ends at a fall, and what follows is drawn, too."""
    twin = build(setup.lamp, setup.calibration, setup.assets, pole=pole)
    program = controller.compile(all_terminals(len(setup.lamp.joints)))
    outcome = Fleet([twin], controller.control_period, 1).run([program], [job], duration, record=True)
    assert outcome.trace is not None
    ticks, sent = outcome.trace.goals.shape[1], outcome.trace.goals[0, : outcome.trace.ticks[0]]
    return twin, np.arange(ticks + 1) * controller.control_period, play(twin, sent, controller.control_period, ticks)


def _staged(
    stage: Stage, goal: str | None, duration: float | None
) -> tuple[FigureTwin, NDArray[np.float64], NDArray[np.float64], tuple[float, float] | None]:
    """Return a figure's run as positions, and the point it is sent to, where its goal is one."""
    controller, twin = stage.controller, stage.twin
    job = stage.jobs(goal, "--goal")[0]
    program = controller.compile(figure_terminals(twin.figure))
    fleet = FigureFleet([twin], controller.control_period, 1)
    outcome = fleet.run([program], [job], duration or stage.task.duration, record=True)
    assert outcome.trace is not None
    goals = outcome.trace.goals[0, : outcome.trace.ticks[0]]
    qpos = play_figure(twin, job, goals, controller.control_period)
    x, y = job.goal * np.cos(job.direction), job.goal * np.sin(job.direction)
    time = np.arange(len(qpos), dtype=np.float64) * controller.control_period
    return twin, time, qpos, (float(x), float(y)) if twin.goal is None else None


def _travel(qpos: NDArray[np.float64], plane: bool) -> NDArray[np.float64]:
    """Return how far the base has come since the first sample, shape (k,) [m]: ahead, or for figures in the plane."""
    way = qpos[:, :2] - qpos[0, :2]
    return np.hypot(*way.T) if plane else way[:, 0]


def _replayed(path: str, setup: Setup) -> tuple[TwinModel, NDArray[np.float64], NDArray[np.float64]]:
    from robolamp.compare.replay import replay
    from robolamp.log.reader import read_run

    log = read_run(path)
    twin = replay(log, setup.lamp, setup.calibration, setup.assets)
    driven = log.scheduled[log.phase == "run"]
    first, last = (driven[0], driven[-1]) if len(driven) else (log.scheduled[0], log.scheduled[-1])
    during = (twin.time >= first) & (twin.time <= last)
    return twin.twin, twin.time[during], twin.qpos[during]


def _moving(time: NDArray[np.float64], qpos: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which samples to show: up to half a second after the last motion, shape (k,)."""
    still = np.abs(qpos - qpos[-1]).max(axis=1) < 0.02
    moving = np.flatnonzero(~still)
    end = time[moving[-1]] + _AFTER if len(moving) else time[-1]
    return time <= end
