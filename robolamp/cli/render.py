"""`robolamp render`: a run as a picture strip or an animation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from robolamp.assets import bare_name
from robolamp.cli.options import GOAL_TIME, Setup, length, seconds
from robolamp.cli.scoring.controller_stage import Stage, stage_of
from robolamp.cli.scoring.pole_options import pole_of
from robolamp.cli.screen.output import print_json
from robolamp.errors import RobolampError
from robolamp.files import kind_of, read_toml, suffix_of, write_atomic
from robolamp.twin.figure_model import FigureTwin, Twin
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.pictures.moments import Moment, caption, centimetres, moments
from robolamp.twin.pictures.render import animation, beside, png, strips
from robolamp.twin.pictures.video import encoders, gif, mp4

Array = NDArray[np.float64]

_GOAL = "0.30"  # [m]
_FIGURES = "figures other than the lamp"
_POSES = 8  # of a strip
_FRAME = 0.04  # time between the pictures of an animation [s]
_ANIMATIONS = {".gif": gif, ".mp4": mp4}
_LATE = 0.06  # how much later than its goals the lamp is at a key frame [s]: measured on the twin, 0.02 to 0.08
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
    twin: Annotated[bool, Parameter(negative="")] = False,
    truth: Path | None = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    opengl: bool = True,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Draw a controller at work or a gesture on the twin, or the lamp as its log tells of it.

    Args:
        run: A controller or a gesture (file or shipped name), or a log (.mcap).
        output: The picture: .png for a strip of poses, .gif or .mp4 for an animation in real time; .mp4 needs
            `pip install 'robolamp[video]'`.
        goal: How far a controller is sent, as 0.30 (metres, the default) or 30cm; a log has its own. For a figure other
            than the lamp: X,Y in metres; without it, the first goal of its task.
        duration: How long a controller drives, in seconds (8, beyond 64 cm what the goal takes at 8 cm/s; or the
            time limit of a figure's task).
        goal_time: Time to take for the way in seconds, for a controller that reads goal_time.
        pole: Limbo: height of the lower edge of a pole across the way, as 0.20 (metres) or 20cm.
        pole_at: With --pole: its distance ahead of the lamp's start (20cm).
        task: For a figure other than the lamp: the task it is in (file or name); without it, the task.toml beside the
            controller, or the task that it was evolved for.
        twin: For a log: draw the twin's replay beside the lamp.
        truth: For a log of an emulated lamp: its truth log, which says where the base was; by default truth.mcap
            beside the log, if there is one. Without it the base is drawn where the twin's was.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        opengl: Draw with OpenGL where there is one; without it, draw side views of the links.
        as_json: Print one JSON object.
    """
    if suffix_of(output) not in (".png", *_ANIMATIONS):
        raise RobolampError(f"{output.name!r} does not end in .png, .gif or .mp4", "--output")
    if suffix_of(output) == ".mp4":
        encoders()  # before the work of drawing
    setup = Setup.of(lamp, calibration)
    limbo = pole_of(pole, pole_at)
    lamp_alone = {
        "--goal-time": goal_time, "--pole": pole, "--pole-at": pole_at, "--calibration": calibration != "nominal",
    }  # fmt: skip
    plane, keys = False, None
    if played := _gesture(setup, run):
        for option, value in (
            ("--goal", goal), ("--duration", duration), ("--goal-time", goal_time), ("--pole", limbo), ("--task", task),
            ("--twin", twin or None), ("--truth", truth),
        ):  # fmt: skip
            if value is not None:
                raise RobolampError(f"is not for a gesture; {run} is one", option)
        model, time, motions, keys = _played(setup, played)
        point = None
    elif suffix_of(Path(run)) == ".mcap":
        for option, value, alone in (("--pole", limbo, "a controller; no log has a pole"), ("--task", task, _FIGURES)):
            if value is not None:
                raise RobolampError(f"is for {alone}", option)
        model, time, motions, point = _logged(run, truth, setup, with_twin=twin)
    else:
        if twin or truth is not None:
            raise RobolampError("is for a log; a controller is drawn on the twin", "--twin" if twin else "--truth")
        stage = stage_of(setup, run, task, lamp_alone, goal_time=goal_time, pole=limbo)
        model, time, motions, point = _staged(stage, goal, duration)
        plane = stage.task is not None
    shown = np.ones(len(time), bool) if keys else _moving(time, np.hstack(list(motions.values())))
    time, motions = time[shown] - time[shown][0], {name: poses[shown] for name, poses in motions.items()}
    travel = _travel(next(iter(motions.values())), plane)
    if suffix_of(output) == ".png":
        first = next(iter(motions.values()))
        chosen = keys or moments(model, time, lambda index: first[index], _POSES)
        picked = [moment.at for moment in chosen]
        drawn, notes = {name: poses[picked] for name, poses in motions.items()}, None
        labels = [caption(time[at], name, None if keys else travel[at]) for at, name in chosen]
        if twin:  # the two are not at one place
            labels = [caption(time[at], name) for at, name in chosen]
            ways = {name: _travel(poses, False) for name, poses in motions.items()}
            notes = {name: [centimetres(way[at]) for at in picked] for name, way in ways.items()}
        data = png(strips(model, drawn, labels, opengl=opengl, point=point, notes=notes))
    else:
        frames = np.searchsorted(time, np.arange(0.0, time[-1], _FRAME))
        drawn = {name: poses[frames] for name, poses in motions.items()}
        if len(drawn) == 1:
            pictures = animation(model, next(iter(drawn.values())), opengl=opengl, point=point)
        else:
            pictures = beside(model, drawn, opengl=opengl, point=point)
        data = _ANIMATIONS[suffix_of(output)](pictures, _FRAME)
    write_atomic(output, data)
    if as_json:
        print_json({"picture": output, "duration_s": time[-1], "travel_m": travel[-1]})
    else:
        print(output)
    return 0


def _gesture(setup: Setup, run: str) -> Path | None:
    """Return the file of a gesture; None where it is something else."""
    from robolamp.pose.gesture_file import all_gestures

    path, bare = Path(run), bare_name(run)
    if kind_of(path) == "file":
        return path if suffix_of(path) == ".toml" and "frame" in read_toml(path) else None
    return next((item for item in all_gestures(setup.assets) if item.stem == bare), None)


def _played(setup: Setup, path: Path) -> tuple[TwinModel, Array, dict[str, Array], list[Moment]]:
    """Return a gesture as the twin plays it, as positions, and the moments at which it has come to a key frame."""
    from robolamp.pose.gesture import PERIOD, check_slew
    from robolamp.pose.gesture_file import load_gesture
    from robolamp.twin.lamp_model import build
    from robolamp.twin.standing import stand

    gesture = load_gesture(path, setup.lamp)
    check_slew(gesture, setup.lamp)
    twin = build(setup.lamp, setup.calibration, setup.assets)
    standing = stand(twin, gesture.motion().samples(), PERIOD)
    moving = [frame.time for frame in gesture.frames if not np.isnan(frame.pose).all()]
    times = (np.array([0.0, *moving]) + _LATE) / gesture.speed
    if len(times) > _POSES:
        times = times[np.linspace(0, len(times) - 1, _POSES).round().astype(int)]
    last = len(standing.time) - 1
    ticks = np.minimum(np.rint(times / PERIOD).astype(int), last)
    return twin, standing.time, {"": standing.qpos}, [Moment(int(tick), "") for tick in np.unique(ticks)]


def _staged(
    stage: Stage, goal: str | None, duration: float | None
) -> tuple[Twin, Array, dict[str, Array], tuple[float, float] | None]:
    """Return what `score` scores, as positions, and the point it is sent to, where its goal is one.

    A lamp's run ends at a fall, and what follows is drawn, too.
    """
    if stage.task is None:
        length(goal or _GOAL, "--goal")  # one, and no range
    job, fleet = stage.jobs(goal, "--goal", _GOAL)[0], stage.fleet(1)
    trace = fleet.run([stage.program], [job], duration or stage.time([job]), record=True).trace
    assert trace is not None
    ticks, twin = trace.goals.shape[1], stage.twins[0]
    qpos = fleet.play(job, trace.goals[0, : trace.ticks[0]], ticks)
    point = float(job.goal * np.cos(job.direction)), float(job.goal * np.sin(job.direction))
    body = isinstance(twin, FigureTwin) and twin.goal is not None
    return twin, np.arange(ticks + 1) * fleet.period, {"": qpos}, None if body else point


def _travel(qpos: Array, plane: bool) -> Array:
    """Return how far the base has come since the first sample, shape (k,) [m]: ahead, or for figures in the plane."""
    way = qpos[:, :2] - qpos[0, :2]
    return np.hypot(*way.T) if plane else way[:, 0]


def _logged(
    path: str, truth: Path | None, setup: Setup, *, with_twin: bool
) -> tuple[TwinModel, Array, dict[str, Array], tuple[float, float] | None]:
    """Return a log's run as positions, and where on the floor it was sent, where the log says that."""
    from robolamp.compare.logged_motion import lamp_motion, truth_of, twin_motion
    from robolamp.compare.replays.goal_replay import replay
    from robolamp.log.mcap_stream import read_contents
    from robolamp.log.reader import prefix_in, run_of

    contents = read_contents(Path(path))
    log = run_of(contents, prefix_in(contents))
    known = truth_of(log, truth)
    twin = replay(log, setup.lamp, setup.calibration, setup.assets)
    driven = log.phase == "run" if (log.phase == "run").any() else np.ones(log.index.size, bool)
    time = twin.time[(twin.time >= log.scheduled[driven][0]) & (twin.time <= log.scheduled[driven][-1])]
    poses = lamp_motion(log, twin, time, known)
    motions = {"lamp": poses, "twin": twin_motion(twin, time)} if with_twin else {"": poses}
    return twin.twin, time, motions, None if np.isnan(log.goal_m) else (float(poses[0, 0]) + log.goal_m, 0.0)


def _moving(time: Array, qpos: Array) -> NDArray[np.bool_]:
    """Return which samples to show: up to half a second after the last motion, shape (k,)."""
    still = np.abs(qpos - qpos[-1]).max(axis=1) < 0.02
    moving = np.flatnonzero(~still)
    end = time[moving[-1]] + _AFTER if len(moving) else time[-1]
    return time <= end
