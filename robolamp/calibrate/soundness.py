"""What is wrong with a recording, in words: such a recording is named, not fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robolamp.calibrate.recordings import Recording
from robolamp.errors import FileError, RobolampError

_LEAST_SAMPLES = 50  # fewer than the parameters of a servo leave over, and shorter than its slowest time constant
_LEAST_TIME = 0.5  # [s]
_LEAST_MOTION = 0.02  # an angle that stays within 13 encoder counts says nothing about friction in motion [rad]
_LONGEST_GAP = 0.1  # the goal may have changed unseen, and a pendulum swings through its whole arc [s]
_GAP = 10.0  # and this many times the usual step: a slow recording has no gaps of its own
_APPROACH = 4  # samples before an extreme that tell the speed it is reached at
_STANDSTILL = 0.03  # an angle that stays exactly at its extreme for so long is held there [s]
_FAST = 1.5  # from this speed a servo's friction takes 30 ms and more to stop it, not one sample [rad/s]


def faults(recording: Recording) -> list[str]:
    """Return everything that makes a recording unfit to calibrate with; empty for a sound one.

    Args:
        recording: The recording.

    Returns:
        Texts that name what was found and what was expected.
    """
    found = []
    count = len(recording.time)
    if count < _LEAST_SAMPLES:
        return [f"too short: {count} samples, expected {_LEAST_SAMPLES} or more"]
    for name in ("time", "goal_time", "goal", "angle"):
        values = getattr(recording, name)
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            found.append(f"not finite: {name} of sample {row} is {values[row]}")
    if found:
        return found
    step = np.diff(recording.time)
    if (step <= 0).any():
        row = int(np.flatnonzero(step <= 0)[0])
        return [f"time goes backwards or stands still: {recording.time[row + 1]:g} s after {recording.time[row]:g} s"]
    if recording.duration < _LEAST_TIME:
        found.append(f"too short: {recording.duration:.2f} s, expected {_LEAST_TIME} s or more")
    longest = int(np.argmax(step))
    if step[longest] > max(_LONGEST_GAP, _GAP * float(np.median(step))):
        found.append(f"a gap: no sample for {step[longest]:.2f} s from {recording.time[longest]:.2f} s on")
    motion = float(np.ptp(recording.angle))
    if motion < _LEAST_MOTION:
        found.append(f"constant: the angle moves {motion * 1e3:.1f} mrad, expected {_LEAST_MOTION * 1e3:.0f} or more")
    else:
        found += _clipped(recording)
    gain = recording.p_gain[recording.torque]
    if not (np.isfinite(gain) & (gain > 0)).all():
        found.append("the Position P Gain is not known, or not above 0")
    return found


def _clipped(recording: Recording) -> list[str]:
    """Return a fault where the angle comes to its extreme at speed and stands there at once: no friction is so hard.

    (An arm that friction holds, even at full duty, has slowed down before: such recordings are sound.)
    """
    angle, time = recording.angle, recording.time
    for word, extreme in (("largest", angle.max()), ("smallest", angle.min())):
        stands = np.concatenate([[False], angle == extreme, [False]])
        edges = np.flatnonzero(np.diff(stands.astype(np.int8)))
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            before = max(first - _APPROACH, 0)
            if first - before < _APPROACH or time[end - 1] - time[first] < _STANDSTILL:
                continue
            speed = abs(angle[first - 1] - angle[before]) / (time[first - 1] - time[before])
            if speed > _FAST:
                return [
                    f"clipped: at {time[first]:.2f} s the angle comes to its {word}, {extreme:.3f} rad, at {speed:.1f} "
                    f"rad/s and stands there for {time[end - 1] - time[first]:.2f} s"
                ]
    return []


def require_sound(recordings: Sequence[Recording], servo: str | None = None) -> None:
    """Refuse recordings that cannot be calibrated with.

    Args:
        recordings: The recordings.
        servo: Servo model that is expected; None: all of one model, whichever.

    Raises:
        FileError: A recording has a fault, or is of another servo; the message names the first one.
        RobolampError: There is none, or torque is never on in any.
    """
    if not recordings:
        raise RobolampError("no recording to work on; expected one or more", "recordings")
    for recording in recordings:
        for fault in faults(recording):
            raise FileError(fault, recording.name if recording.joint else str(recording.path))
    wanted = servo if servo is not None else next((item.servo for item in recordings if item.servo), "")
    for recording in recordings:
        if recording.servo and recording.servo != wanted:
            raise FileError(f"is of another servo: {recording.servo}, expected {wanted}", recording.name)
    if not any(recording.torque.any() for recording in recordings):
        raise RobolampError("torque is off in every recording: nothing tells about the motor", "recordings")
