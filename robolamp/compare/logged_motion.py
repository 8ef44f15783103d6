"""The motion in a log, as positions of the twin's model: what pictures, videos and the player show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.compare.replays.goal_replay import Replay
from robolamp.errors import FileError
from robolamp.log.reader import Run, Truth, read_truth
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.pictures.render import qpos_of

Array = NDArray[np.float64]


def lamp_motion(run: Run, replay: Replay, time: Array, truth: Truth | None = None) -> Array:
    """Return the lamp's motion: its measured joint angles; the base from the truth log, or else from the replay.

    Nothing on a lamp measures where its base is. Where only a log is at hand the twin's base stands in for it: joints
    are then the lamp's, hops the twin's.

    Args:
        run: The lamp's log; a joint's missing readings are bridged, one that never answered stays neutral.
        replay: What the twin made of it.
        time: Moments, on the log's clock, shape (k,) [s].
        truth: The truth log of an emulated lamp, where there is one.

    Returns:
        MuJoCo positions, shape (k, nq).
    """
    if truth is None:
        base_time, base = replay.time, (replay.base_x, replay.base_z, replay.pitch)
    else:
        base_time, base = run.at(truth.log_time), (truth.base_x, truth.base_z, truth.pitch)
    angle = np.stack(
        [_between(time, run.sampled_at[:, joint], run.angle[:, joint]) for joint in range(len(run.joints))], axis=1
    )
    x, z, pitch = (np.interp(time, base_time, values) for values in base)
    return _positions(replay.twin, x, z, pitch, angle)


def truth_of(run: Run, path: Path | None) -> Truth | None:
    """Return the truth log that belongs to a log.

    Args:
        run: The lamp's log.
        path: The truth log; None: NAME.truth.mcap beside NAME.mcap, or truth.mcap, where there is one. A truth.mcap
            that is of another run is passed over, but beside a log.mcap, as dry-run writes them.

    Raises:
        FileError: It cannot be read, or is of another run.
    """
    if path is None and run.context.get("backend") == "twin":
        return None  # a replay keeps the clock of the lamp's log: what lies beside it is the lamp's
    own, shared = run.path.with_suffix(".truth.mcap"), run.path.with_name("truth.mcap")
    found = path or next((each for each in (own, shared) if each != run.path and each.is_file()), None)
    if found is None:
        return None
    truth = read_truth(found)
    at = run.at(truth.log_time[[0, -1]])
    if at[1] < run.began[0] or at[0] > run.write_done[-1]:
        if path is None and found == shared and run.path.name != "log.mcap":
            return None
        raise FileError(f"has nothing of the time of {run.path}: it is of another run", str(found))
    return truth


def twin_motion(replay: Replay, time: Array) -> Array:
    """Return the twin's motion.

    Args:
        replay: The twin's replay.
        time: Moments, on the log's clock, shape (k,) [s].

    Returns:
        MuJoCo positions at the physics step nearest to each moment, shape (k, nq).
    """
    step = float(replay.time[1] - replay.time[0])
    nearest = np.rint((time - replay.time[0]) / step).astype(np.int64)
    return replay.qpos[np.clip(nearest, 0, len(replay.qpos) - 1)]


def _between(time: Array, at: Array, values: Array) -> Array:
    known = np.isfinite(values) & np.isfinite(at)
    return np.interp(time, at[known], values[known]) if known.any() else np.zeros_like(time)


def _positions(twin: TwinModel, x: Array, z: Array, pitch: Array, angle: Array) -> Array:
    rows = [qpos_of(twin, base, row) for *base, row in zip(x, z, pitch, angle, strict=True)]
    return np.array(rows).reshape(-1, twin.model.nq)
