"""A servo with a pendulum on its shaft, written out: MuJoCo's own step for one degree of freedom, fifty times as fast.

A fit needs some 10^5 simulated recordings, and a hinge alone leaves MuJoCo's Batch little to be fast with. So the fit
runs on this, which gives MuJoCo's numbers (`robolamp.calibrate.servo.mujoco_bench`, a test compares the two), and what
is shown of a fit is MuJoCo's.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.servo.recordings import Recording
from robolamp.calibration import JOINT, SERVO
from robolamp.errors import FileError
from robolamp.jit import njit
from robolamp.twin.actuators.servo import (
    FIRM,
    OPEN,
    QUICK,
    REFERENCE_TEMPERATURE,
    TORQUE_CONSTANT,
    effective_resistance,
    friction_loss,
    motor_torque,
    viscous_friction,
    voltage_gain,
)
from robolamp.twin.pendulum_model import POINT, Load

Array = NDArray[np.float64]

PARAMETERS = (*SERVO, "encoder_offset")
"""Columns of a parameter set: a servo's, and what its encoder reads with the pendulum hanging straight down [rad]."""

COLUMN = {name: column for column, name in enumerate(PARAMETERS)}
"""Where each is."""

TIMESTEP = 0.001
"""Physics step [s]."""

_GRAVITY = 9.81  # MuJoCo's [m/s^2]
_SMOOTH = 0.5  # see `supply` [s]


def parameter_set(values: Mapping[str, float]) -> Array:
    """Return a parameter set, shape (len(PARAMETERS),), with what `values` lacks at its default.

    Args:
        values: Parameters by name, in their units.
    """
    legal = {**SERVO, **JOINT}
    found = [values.get(name, legal[name].default) for name in PARAMETERS]
    return np.array([math.nan if value is None else value for value in found])


def supply(recording: Recording) -> Array:
    """Return the supply that a recording is simulated with, shape (k,) [V]: as read, averaged over half a second.

    A servo samples its supply at whatever phase of its PWM it happens to be, up to a volt above or below what acts.
    Samples without a reading count as the median of the others.

    Raises:
        FileError: The recording has no voltage at all.
    """
    volts = recording.voltage
    known = np.isfinite(volts)
    if not known.any():
        raise FileError("no supply voltage; expected one with each sample", str(recording.path))
    volts = np.where(known, volts, np.median(volts[known]))
    half = max(1, round(_SMOOTH / 2 / float(np.median(np.diff(recording.time)))))
    padded = np.concatenate([np.full(half, volts[0]), volts, np.full(half, volts[-1])])
    sums = np.concatenate([[0.0], np.cumsum(padded)])
    width = 2 * half + 1
    return (sums[width:] - sums[:-width]) / width


def start(recording: Recording) -> tuple[float, float]:
    """Return the angle [rad] and velocity [rad/s] that a recording begins with."""
    velocity = recording.velocity[0]
    return float(recording.angle[0]), float(velocity) if math.isfinite(velocity) else 0.0


class Track:
    """A recording, as it is played: times from its first sample on, one more value than samples.

    Args:
        recording: The recording.
        timestep: Physics step [s].
    """

    def __init__(self, recording: Recording, timestep: float) -> None:
        begin = recording.time[0]
        self.samples = recording.time - begin
        self.steps = math.ceil(self.samples[-1] / timestep)
        self.grid = np.arange(self.steps + 1) * timestep
        self.arrays = (
            np.append(recording.goal_time - begin, math.inf),
            np.append(recording.goal, recording.goal[-1]),
            np.append(self.samples, math.inf),
            np.append(supply(recording), math.nan),
            np.append(np.nan_to_num(recording.temperature, nan=REFERENCE_TEMPERATURE), math.nan),
            np.append(recording.torque, False).astype(np.float64),
            np.append(recording.p_gain, math.nan),
        )
        self.start = np.array(start(recording))
        self.release = recording.release - begin
        self.load = Load(float(recording.mass or 0.0), float(recording.length or 0.0), recording.arm_mass)


class Pendulum:
    """Recordings that can be simulated with any parameters, again and again.

    Args:
        recordings: Pendulum recordings.
        timestep: Physics step [s].
        workers: Threads; None: one for each core.

    Attributes:
        recordings: The recordings.
        steps: Physics steps taken so far.

    Raises:
        FileError: A recording is not of a pendulum, or has no voltage.
    """

    def __init__(
        self, recordings: Sequence[Recording], *, timestep: float = TIMESTEP, workers: int | None = None
    ) -> None:
        require_pendulum(recordings)
        self.recordings = list(recordings)
        self.timestep = timestep
        self.steps = 0
        self._workers = workers or len(os.sched_getaffinity(0))
        self._tracks = [Track(recording, timestep) for recording in recordings]

    def simulate(self, parameters: Array, which: Sequence[int] | None = None, volts: float = 0.0) -> list[Array]:
        """Simulate recordings from their first sample to their last.

        Args:
            parameters: Parameter sets, shape (m, len(PARAMETERS)).
            which: Indices of the recordings; None: all.
            volts: Added to the supply as recorded [V].

        Returns:
            For each of them the angles that the encoder would have read at its samples, shape (m, k) [rad].
        """
        chosen = list(range(len(self.recordings)) if which is None else which)
        found = [np.empty((len(parameters), len(self._tracks[index].samples))) for index in chosen]

        def work(share: slice) -> None:
            for index, angles in zip(chosen, found, strict=True):
                track = self._tracks[index]
                for values, row in zip(parameters[share], angles[share], strict=True):
                    _swing(
                        values, track.load.moment, track.load.inertia, self.timestep, track.release, volts, track.start,
                        *track.arrays, row,
                    )  # fmt: skip

        if self._workers == 1 or len(parameters) == 1:
            work(slice(None))
        else:
            with ThreadPoolExecutor(self._workers) as pool:
                list(pool.map(work, [slice(first, None, self._workers) for first in range(self._workers)]))
        self.steps += len(parameters) * sum(self._tracks[index].steps for index in chosen)
        return found


def require_pendulum(recordings: Sequence[Recording]) -> None:
    """Refuse recordings of anything but a pendulum.

    Raises:
        FileError: A recording is not of a pendulum.
    """
    for recording in recordings:
        if not recording.pendulum:
            raise FileError(
                "not of a pendulum bench: no mass and length (for a lamp: `robolamp calibrate lamp`)",
                str(recording.path),
            )


_ARMATURE, _DELAY, _OFFSET = (COLUMN[name] for name in ("armature", "delay", "encoder_offset"))


@njit(nogil=True, error_model="numpy")
def goal_of_step(times: Array, goals: Array, at: int, begin: float, end: float) -> tuple[float, int]:
    """Return the mean goal of a step, each goal counted for its share, and the goal in force at the end.

    Args:
        times: When each goal arrives [s], the last one infinite.
        goals: The goals [rad].
        at: The goal in force so far.
        begin: Of the step [s].
        end: Of the step [s].
    """
    mean, last = 0.0, begin
    while times[at + 1] <= end:
        turn = max(times[at + 1], begin)
        mean += goals[at] * (turn - last)
        last, at = turn, at + 1
    return (mean + goals[at] * (end - last)) / (end - begin), at


@njit(nogil=True, error_model="numpy")
def _swing(
    p: Array,
    moment: float,
    own: float,
    timestep: float,
    release: float,
    more: float,
    begin: Array,
    times: Array,
    goals: Array,
    samples: Array,
    volts: Array,
    temperature: Array,
    torque: Array,
    p_gain: Array,
    angles: Array,
) -> None:
    """Simulate one recording with one parameter set; the arrays and `release` are those of `Track`.

    `moment` [kg m] and `own` [kg m^2] are the load's; `more` is added to the supply [V].

    implicitfast integration, and the friction constraint in closed form: with one degree of freedom it is
    clip(-M d (a0 + b w), -loss, loss), b = 2 / (d time constant) (MuJoCo's documentation, "Computation").
    """
    inertia = p[_ARMATURE] + own + POINT
    weight, damp = moment * _GRAVITY, 2.0 / (FIRM * QUICK)
    offset, k = p[_OFFSET], p[TORQUE_CONSTANT]
    angle, speed = begin[0] - offset, begin[1]
    at, row, done, step = 0, 0, 0, 0
    resistance, driving = OPEN, 0.0
    external = -weight * math.sin(angle)
    while True:
        time = step * timestep
        goal, at = goal_of_step(times, goals, at, time - p[_DELAY], time + timestep - p[_DELAY])
        while samples[row + 1] <= time:
            row += 1
        loss = friction_loss(p, driving, external, speed)  # from the torques of the last step
        external = -weight * math.sin(angle)
        share = min((release - time) / timestep, 1.0)  # of this step in which the motor is driven
        if torque[at] == 0.0 or share <= 0.0:
            resistance, driving = OPEN, 0.0
        else:
            volt = volts[row] + more
            drop = driving / k * resistance
            resistance = effective_resistance(p, temperature[row], drop, speed, volt)
            if share < 1.0:
                resistance /= share
            gain = voltage_gain(p, p_gain[at], volt)
            driving = motor_torque(p, resistance, gain, goal - offset - angle, speed, volt)
        viscous = viscous_friction(p, temperature[row])
        free = driving + external - viscous * speed
        friction = min(max(-FIRM * (free + inertia * damp * speed), -loss), loss)
        speed += timestep * (free + friction) / (inertia + timestep * (viscous + k * k / resistance))
        ahead = angle + timestep * speed
        step += 1
        while done < angles.shape[0] and samples[done] <= step * timestep:
            angles[done] = angle + (ahead - angle) * (samples[done] - time) / timestep + offset
            done += 1
        if done == angles.shape[0]:
            return
        angle = ahead
