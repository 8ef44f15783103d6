"""How well a calibration predicts recordings that it may never have seen: open loop, in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.servo.fast_pendulum import parameter_set
from robolamp.calibrate.servo.mujoco_bench import Bench
from robolamp.calibrate.servo.recordings import Recording
from robolamp.calibration import Calibration
from robolamp.errors import FileError

Array = NDArray[np.float64]

BENCH = "bench"
"""What a calibration file calls the joint that turns a pendulum: `[joint.bench]`."""


@dataclass(frozen=True)
class RecordingsScore:
    """How well one recording is predicted.

    Attributes:
        recording: The recording.
        angle: What the calibrated servo would have done, at the recording's samples, shape (k,) [rad].
        seen: Whether the calibration was fitted to it; None where the file does not say.
    """

    recording: Recording
    angle: Array
    seen: bool | None

    @property
    def mae(self) -> float:
        """Mean absolute position error [rad]."""
        return float(np.mean(np.abs(self.angle - self.recording.angle)))


def model_of(recording: Recording, calibration: Calibration) -> str:
    """Return the servo model whose parameters a recording is simulated with.

    Raises:
        FileError: The calibration has no such model, or several and the recording does not say which.
    """
    models = [name for name in calibration.groups if name != "lamp" and not name.startswith("joint ")]
    if recording.servo in models:
        return recording.servo
    if recording.servo:
        raise FileError(
            f"is of another servo: {recording.servo}; {calibration.path.name} has {', '.join(models)}",
            str(recording.path),
        )
    if len(models) != 1:
        raise FileError(f"does not name its servo; expected one of {', '.join(models)}", str(recording.path))
    return models[0]


def parameters_of(recording: Recording, calibration: Calibration) -> dict[str, float]:
    """Return the values that a recording is simulated with: its joint's own, or those of the bench."""
    joint = recording.joint or BENCH
    values = calibration.servo(model_of(recording, calibration), joint)
    return {**values, "encoder_offset": calibration.joint(joint, "encoder_offset")}


def score_recordings(
    recordings: Sequence[Recording],
    calibration: Calibration,
    workers: int | None = None,
    share: Callable[[float], None] = lambda _share: None,
) -> list[RecordingsScore]:
    """Simulate each recording from its first sample to its last, with its goals and its supply as recorded.

    Args:
        recordings: Sound pendulum recordings (see `soundness`).
        calibration: The calibration.
        workers: Threads; None: one for each core.
        share: Called with the share that is done, 0 to 1.

    Raises:
        FileError: A recording is of a servo that the calibration does not have, not of a pendulum, or has no voltage.
    """
    bench = Bench(recordings, workers=workers, share=share)
    fitted = calibration.provenance.get("recordings")
    known = {item.get("sha256") for item in fitted if isinstance(item, dict)} if isinstance(fitted, list) else None
    scores = []
    sets = [parameter_set(parameters_of(recording, calibration)) for recording in recordings]
    distinct = np.unique(np.stack(sets), axis=0)
    for values in distinct:
        which = [index for index, each in enumerate(sets) if np.array_equal(each, values, equal_nan=True)]
        for index, angles in zip(which, bench.simulate(values[None], which), strict=True):
            recording = recordings[index]
            scores.append(
                (index, RecordingsScore(recording, angles[0], None if known is None else recording.sha256 in known))
            )
    return [score for _, score in sorted(scores, key=lambda item: item[0])]


def mean_error(scores: Sequence[RecordingsScore]) -> float:
    """Return the mean over recordings of their mean absolute error [rad]; NaN without any."""
    return float(np.mean([score.mae for score in scores])) if scores else math.nan
