"""What is wrong with a recording, in words: such a recording is named, not fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.servo.recordings import Recording
from robolamp.errors import FileError, RobolampError

_LEAST_SAMPLES = 50  # fewer than the parameters of a servo leave over, and shorter than its slowest time constant
_LEAST_TIME = 0.5  # [s]
_LEAST_MOTION = 0.02  # an angle that stays within 13 encoder counts says nothing about friction in motion [rad]
_MOST_TIME = 3600.0  # chosen: ten times a bench's whole session; beyond it a time is likely of another unit [s]
_SLOWEST = 0.1  # between samples, on the whole: chosen; a servo answers a goal within it [s]
_LATEST_GOAL = 1.0  # between a goal and its sample: chosen; ten cycles of the slowest recording [s]
_TURN = 2 * math.pi  # what a servo's goals can span in position mode (e-manual, "Goal Position") [rad]
_MOST_ANGLE = 2 * _TURN  # chosen: an arm that is let go swings through once at most [rad]
_JUMP = math.pi  # between two samples: twice what an arm falls through in the longest step [rad]
_GOAL_JUMP = 0.75 * _TURN  # a goal may step across the whole of a half circle to either side [rad]
# Of angles from their goals, on the whole: the weakest servo of Rhoban/bam's recordings sags by 0.95; angles that are
# counted from the other end of the turn are off by half a turn [rad].
_MOST_AWAY = 0.75 * math.pi
_HEAVIEST, _FARTHEST = 5.0, 1.0  # of a pendulum, as in a servos file (robolamp.emulator.bare_servos_file) [kg], [m]
_MOST_GAIN = 16383  # Position P Gain (e-manual, 84)
_SUPPLY = (1.0, 30.0)  # chosen: around what any servo that robolamp knows is fed, however badly it reads [V]
_UNITS = (0.4, 2.5)  # velocity as read by that of the angle: chosen; deg/s, rpm and milliseconds are farther off
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
    found += _units(recording, step)
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
    elif (odd := gain[(gain > _MOST_GAIN) | (gain != np.rint(gain))]).size:
        found.append(
            f"the Position P Gain is {odd[0]:g}, expected a whole number up to {_MOST_GAIN}: not the register (84)?"
        )
    return found + _bench_units(recording)


def _bench_units(recording: Recording) -> list[str]:
    """Return what speaks for other units than kilograms and metres of a pendulum."""
    found = []
    for name, value in (("mass", recording.mass), ("arm_mass", recording.arm_mass)):
        if value is not None and value > _HEAVIEST:
            found.append(f"{name} is {value:g} kg, expected {_HEAVIEST:g} kg or less: are these grams?")
    if recording.length is not None and recording.length > _FARTHEST:
        found.append(f"length is {recording.length:g} m, expected {_FARTHEST:g} m or less: are these millimetres?")
    return found


def _units(recording: Recording, step: NDArray[np.float64]) -> list[str]:
    """Return what speaks for other units than seconds, radians and volts, or for angles that begin anew at a turn."""
    time, goal, angle, found = recording.time, recording.goal, recording.angle, []
    usual = float(np.median(step))
    if usual > _SLOWEST:
        found.append(
            f"a sample every {usual:g} s, expected one each {_SLOWEST:g} s or oftener: are these milliseconds?"
        )
    if recording.duration > _MOST_TIME:
        found.append(f"too long: {recording.duration:g} s, expected {_MOST_TIME:g} s or less: are these milliseconds?")
    late = np.abs(recording.goal_time - time)
    if (np.diff(recording.goal_time) < 0).any() or late.max() > _LATEST_GOAL:
        row = int(np.argmax(late))
        found.append(
            f"the times of goals go backwards, or away from those of samples: {recording.goal_time[row]:g} s for the "
            f"sample at {time[row]:g} s, expected {_LATEST_GOAL:g} s or less between them"
        )
    for name, values, most, jump in (("angle", angle, _MOST_ANGLE, _JUMP), ("goal", goal, _TURN, _GOAL_JUMP)):
        change = np.diff(values)
        row = int(np.argmax(np.abs(change)))
        largest = float(values[np.argmax(np.abs(values))])
        if abs(largest) > most:
            found.append(
                f"the {name} is {largest:g}, expected {-most:.2f} to {most:.2f} rad: are these degrees, or counts?"
            )
        elif abs(change[row]) > jump:
            found.append(
                f"the {name} jumps by {change[row]:+.2f} rad at {time[row + 1]:.2f} s: does it begin anew at a turn? "
                "Expected angles that go on"
            )
    if not found and recording.torque.any():
        away = float(np.median((angle - goal)[recording.torque]))
        if abs(away) > _MOST_AWAY:
            found.append(
                f"the angle is {away:+.2f} rad from its goal on the whole, expected {_MOST_AWAY:.2f} rad or less: are "
                "both counted from the same zero?"
            )
    volts = recording.voltage[np.isfinite(recording.voltage)]
    outside = volts[(volts < _SUPPLY[0]) | (volts > _SUPPLY[1])]
    if outside.size:
        found.append(
            f"the supply reads {outside[0]:g} V, expected {_SUPPLY[0]:g} to {_SUPPLY[1]:g} V: tenths, or missing?"
        )
    return found or _speed_units(recording)


def _speed_units(recording: Recording) -> list[str]:
    """Return a fault where the velocity is not the angle's: one of the three columns is in another unit."""
    measured = recording.velocity
    seen = np.gradient(recording.angle, recording.time)
    known = np.isfinite(measured)
    if not (measured[known] != 0.0).any():  # not measured: a recording begins at rest then
        return []
    share = float(np.sum(measured[known] * seen[known]) / max(np.sum(seen[known] ** 2), 1e-12))
    if _UNITS[0] <= share <= _UNITS[1] or np.ptp(recording.angle) < _LEAST_MOTION:
        return []
    return [f"the velocity is {share:.3g} times what angle and time say, expected 1: is one of them in another unit?"]


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
        raise RobolampError("torque is off in every recording: none shows what the motor does", "recordings")
