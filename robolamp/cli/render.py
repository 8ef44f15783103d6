"""`robolamp render`: a run as a picture strip or an animation."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from PIL import Image

from robolamp.cli.options import Setup, length, seconds
from robolamp.cli.output import print_json
from robolamp.errors import RobolampError
from robolamp.files import write_atomic
from robolamp.twin.model import TwinModel
from robolamp.twin.render import animation, strip

_POSES = 8  # of a strip
_FRAME = 0.04  # time between the pictures of an animation [s]
_AFTER = 0.5  # how much of the rest after the motion is shown [s]


def render(
    run: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    goal: str = "0.30",
    duration: Annotated[float, Parameter(validator=seconds(0.5, 60.0))] = 5.0,
    calibration: str = "nominal",
    lamp: Path | None = None,
    opengl: bool = True,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Draw a controller at work on the twin, or the twin replaying a log.

    Args:
        run: A controller (file or shipped name), or a log (.mcap).
        output: The picture: .png for a strip of poses, .gif for an animation in real time.
        goal: How far a controller is sent, as 0.30 (metres) or 30cm; a log has its own.
        duration: How long a controller drives, in seconds.
        calibration: The twin's numbers: a file, or a name in calibration/.
        lamp: A folder of your own lamp, laid out like robolamp's.
        opengl: Without it, draw side views of the links even where OpenGL is to be had.
        as_json: Print one JSON object.
    """
    if output.suffix not in (".png", ".gif"):
        raise RobolampError(f"{output.name!r} does not end in .png or .gif", "--output")
    setup = Setup.of(lamp, calibration)
    if run.endswith(".mcap"):
        twin, time, qpos = _replayed(run, setup)
    else:
        twin, time, qpos = _driven(run, setup, length(goal, "--goal"), duration)
    shown = _moving(time, qpos)
    time, qpos = time[shown] - time[shown][0], qpos[shown]
    stream = io.BytesIO()
    if output.suffix == ".png":
        picked = np.linspace(0, len(time) - 1, _POSES).round().astype(int)
        labels = [f"{time[i]:.2f} s   {100 * (qpos[i, 0] - qpos[0, 0]):.1f} cm" for i in picked]
        Image.fromarray(strip(twin, qpos[picked], labels, opengl=opengl)).save(stream, "PNG", optimize=True)
    else:
        frames = np.searchsorted(time, np.arange(0.0, time[-1], _FRAME))
        pictures = [Image.fromarray(picture) for picture in animation(twin, qpos[frames], opengl=opengl)]
        pictures[0].save(stream, "GIF", save_all=True, append_images=pictures[1:], duration=1000 * _FRAME, loop=0)
    write_atomic(output, stream.getvalue())
    if as_json:
        print_json({"picture": output, "duration_s": time[-1], "travel_m": qpos[-1, 0] - qpos[0, 0]})
    else:
        print(output)
    return 0


def _driven(
    name: str, setup: Setup, goal: float, duration: float
) -> tuple[TwinModel, NDArray[np.float64], NDArray[np.float64]]:
    from robolamp.controller.pilot import Pilot
    from robolamp.runtime.loop import run
    from robolamp.signals import Tick
    from robolamp.twin.lamp import TwinLamp
    from robolamp.twin.model import build

    controller = setup.controller(name, on_board=True)
    twin = build(setup.lamp, setup.calibration, setup.assets)
    body = TwinLamp(twin)
    body.open()
    time: list[float] = []
    qpos: list[NDArray[np.float64]] = []

    def keep(tick: Tick) -> None:
        if tick.phase == "run":
            time.append(tick.began)
            qpos.append(body.body.data.qpos.copy())

    pilot = Pilot(controller, setup.lamp, goal)
    run(body, pilot, setup.lamp, period=pilot.control_period, duration=duration, on_tick=keep)
    return twin, np.array(time), np.array(qpos)


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
