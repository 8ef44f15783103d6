"""The moments of a motion that a picture strip shows: standing, take-off, apex and landing of its flights, the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.twin.figure_model import FigureTwin
from robolamp.twin.judges.lamp_judge import HOP_CLEARANCE
from robolamp.twin.lamp_model import TwinModel

_SHORTEST = 0.06  # [s]: feet that rebound are off the floor for 44 to 56 ms, those of a hop for 120 and more
_EVERY = 0.004  # [s]: moments are looked for no closer than this
_GROUND = 0.0002  # height from which on nothing touches the floor [m]: contacts are soft

Array = NDArray[np.float64]


class Moment(NamedTuple):
    """A moment.

    Attributes:
        at: Index of the sample.
        name: What it is: "stance", "take-off", "apex", "landing", "end"; empty for one between those.
    """

    at: int
    name: str


def moments(twin: TwinModel | FigureTwin, time: Array, pose: Callable[[int], Array], count: int) -> list[Moment]:
    """Return as many moments as a strip has room for, in order.

    Where there are more than that, every flight keeps its apex, and the first ones the rest; where there are fewer, the
    longest stretches between them are halved.

    Args:
        twin: The lamp, or a figure.
        time: Of the samples, ascending, shape (k,) [s].
        pose: Returns the MuJoCo positions of a sample, shape (nq,).
        count: How many moments, two at least; fewer samples than that are all shown.
    """
    last = time.size - 1
    stride = max(1, round(_EVERY * last / max(time[-1] - time[0], _EVERY)))
    samples = np.unique(np.append(np.arange(0, last, stride), last))
    model, data = twin.model, mujoco.MjData(twin.model)
    solid = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] and model.geom_contype[geom]]
    height = np.array([_clearance(twin, data, solid, pose(index)) for index in samples])
    height -= height[0]  # it stands at first
    flights = [tuple(int(samples[at]) for at in flight) for flight in _flights(time[samples], height)]
    found = {0: "stance", last: "end"}
    room = max(count - len(found), 0)
    apexes = [flight[1] for flight in flights]
    if len(apexes) > room:
        apexes = [apexes[at] for at in np.linspace(0, len(apexes) - 1, room).round().astype(int)]
    wanted = [(at, "apex") for at in apexes]
    for off, _, on in flights:
        wanted += [(off, "take-off"), (on, "landing")]
    for at, name in wanted:
        if len(found) < count:
            found.setdefault(at, name)
    return _filled(found, time, min(count, time.size))


def centimetres(way: float) -> str:
    """Return a way [m] for a caption."""
    return f"{round(way * 100, 1) + 0.0:.1f} cm"


def caption(time: float, name: str, travel: float | None = None) -> str:
    """Return what stands under a picture.

    Args:
        time: When [s].
        name: What moment it is; empty: none of note.
        travel: How far the base has come [m]; None: that is told elsewhere.
    """
    way = "" if travel is None else centimetres(travel)
    return "   ".join(part for part in (f"{time:.2f} s", name, way) if part)


def _flights(time: Array, height: Array) -> list[tuple[int, int, int]]:
    """Return the last sample on the floor, the highest, and the first on the floor again of each flight."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], height > _GROUND, [False]]).astype(int)))
    found = []
    for begin, end in edges.reshape(-1, 2):
        if begin == 0 or end == time.size:  # it was in the air before, or still is
            continue
        apex = begin + int(np.argmax(height[begin:end]))
        if time[end] - time[begin - 1] >= _SHORTEST and height[apex] >= HOP_CLEARANCE:
            found.append((int(begin), apex, int(end)))
    return found


def _filled(found: dict[int, str], time: Array, count: int) -> list[Moment]:
    """Halve the longest stretches until there are so many moments."""
    while len(found) < count:
        known = np.array(sorted(found))
        gaps = np.where(np.diff(known) > 1, np.diff(time[known]), -1.0)
        widest = int(np.argmax(gaps))
        middle = np.searchsorted(time, (time[known[widest]] + time[known[widest + 1]]) / 2)
        found[int(np.clip(middle, known[widest] + 1, known[widest + 1] - 1))] = ""
    return [Moment(index, found[index]) for index in sorted(found)]


def _clearance(twin: TwinModel | FigureTwin, data: mujoco.MjData, solid: Sequence[int], qpos: Array) -> float:
    """Return the height of the lowest point of what may touch the floor [m]; rounded parts count as their boxes."""
    model = twin.model
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    lowest = np.inf
    for geom in solid:
        up = data.geom_xmat[geom].reshape(3, 3)[2]
        centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        lowest = min(lowest, data.geom_xpos[geom, 2] + up @ centre - np.abs(up) @ half)
    return float(lowest)
