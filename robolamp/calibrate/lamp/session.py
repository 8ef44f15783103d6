"""A recorded session, ready to be simulated: each log cut to the part that counts, with what stood around it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.manifest import NAME, Manifest, check_recordings, load_manifest
from robolamp.errors import FileError
from robolamp.lamp import Lamp, same_lamp
from robolamp.log.reader import Run, read_run

Array = NDArray[np.float64]

LEAD = 0.3
"""How much of the rest before an excitation is simulated with it [s]."""

_LEAST_TICKS = 50  # fewer are no recording
_STOP_MARGIN = 0.005  # a joint that comes this close to its limit when limp is about to meet its stop [rad]


@dataclass(frozen=True)
class LampRecording:
    """One log of a session, from a moment of rest on, N ticks.

    Attributes:
        name: Of the step.
        run: The log.
        first: Its first tick that counts.
        last: Its last.
        clamped: Whether the base was clamped.
        p_gain: Position P Gain register (84) of each servo, shape (n,).
        limp_from: When torque went off [s]; infinite where it did not.
        travel: How far the lamp went, measured [m]; None where it was not.
        sha256: Of the log.
    """

    name: str
    run: Run
    first: int
    last: int
    clamped: bool
    p_gain: Array
    limp_from: float
    travel: float | None
    sha256: str

    @property
    def rows(self) -> slice:
        """The ticks that count."""
        return slice(self.first, self.last + 1)

    @property
    def missing(self) -> int:
        """How many readings of a joint's angle are missing among the ticks that count."""
        return int(np.isnan(self.run.angle[self.rows]).sum())


@dataclass(frozen=True)
class LampSession:
    """A session's recordings.

    Attributes:
        folder: Where they are.
        manifest: What it says.
        recordings: In the order in which they were made.
    """

    folder: Path
    manifest: Manifest
    recordings: tuple[LampRecording, ...]

    def named(self, *names: str) -> tuple[LampRecording, ...]:
        """Return the recordings whose name begins with one of some words."""
        return tuple(recording for recording in self.recordings if recording.name.startswith(names))


def read_session(folder: Path, lamp: Lamp) -> LampSession:
    """Read the recordings of a folder that `robolamp calibrate record` made.

    Args:
        folder: The folder.
        lamp: The lamp that they are of.

    Raises:
        FileError: There is no session, a recording is missing or changed, or one is of another lamp or too short.
    """
    manifest = load_manifest(folder)
    if manifest is None:
        raise FileError(f"holds no {NAME}; expected a folder made by `robolamp calibrate record`", str(folder))
    if manifest.servo:
        raise FileError(f"is of a single {manifest.servo}, not of a lamp: `robolamp calibrate fit`", str(folder))
    check_recordings(manifest, folder)
    if not manifest.entries:
        raise FileError("nothing is recorded yet", str(folder))
    recordings = [
        _cut(folder / entry.file, lamp, entry.step, entry.clamped, entry.travel, entry.sha256)
        for entry in manifest.entries
    ]
    return LampSession(folder, manifest, tuple(recordings))


def _cut(path: Path, lamp: Lamp, name: str, clamped: bool, travel: float | None, digest: str) -> LampRecording:
    run = read_run(path)
    if run.joints != lamp.names:
        raise FileError(f"is of joints {', '.join(run.joints)}; expected {', '.join(lamp.names)}", str(path))
    if not same_lamp(lamp, run.context.get("lamp", "")):
        raise FileError(f"is of another lamp, or {lamp.path.name} was changed since", str(path))
    moving = np.flatnonzero(run.phase == "run")
    if moving.size < _LEAST_TICKS:
        raise FileError(f"too short: {moving.size} ticks of excitation, expected {_LEAST_TICKS} or more", str(path))
    silent = [joint for joint, angle in zip(run.joints, run.angle[moving].T, strict=True) if np.isnan(angle).all()]
    if silent:
        raise FileError(f"holds no reading of {', '.join(silent)}; record it again", str(path))
    first = int(np.searchsorted(run.began, run.began[moving[0]] - LEAD))
    limp = np.flatnonzero(run.phase == "limp")
    last, limp_from = int(moving[-1]), np.inf
    if limp.size:
        # Torque went off right after the last goal; past a stop the physics is the stop's.
        limp_from = float(run.write_done[limp[0] - 1])
        angle = run.angle[limp]
        stopped = ((angle < lamp.lower + _STOP_MARGIN) | (angle > lamp.upper - _STOP_MARGIN)).any(axis=1)
        last = int(limp[np.flatnonzero(stopped)[0] - 1] if stopped.any() else limp[-1])
    gains = run.context.get("position_p_gain", "").split()
    known = len(gains) == len(lamp.names) and all(gain.isdigit() for gain in gains)
    p_gain = np.array(gains, float) if known else np.array([float(joint.position_p_gain) for joint in lamp.joints])
    return LampRecording(name, run, first, last, clamped, p_gain, limp_from, travel, digest)
