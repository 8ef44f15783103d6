"""A servo with a pendulum on its shaft, in MuJoCo: many recordings and many parameter sets at once, open loop.

The motor is `robolamp.twin.actuators.motors`', as in the lamp's twin. A goal that changes
between two steps counts in each for its share, so that results are smooth in the delay.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from robolamp.calibrate.servo.fast_pendulum import COLUMN, PARAMETERS, TIMESTEP, Track, goal_of_step, require_pendulum
from robolamp.calibrate.servo.recordings import Recording
from robolamp.jit import njit
from robolamp.twin.actuators.motors import Motors, Views
from robolamp.twin.actuators.servo import ServoParameters
from robolamp.twin.engine import deal
from robolamp.twin.pendulum_model import build_pendulum

Array = NDArray[np.float64]

_TOLD = 500  # steps after which the share that is done is told


class Bench:
    """Recordings that can be simulated with any parameters, again and again.

    Args:
        recordings: Pendulum recordings.
        timestep: Physics step [s].
        workers: Threads; None: one for each core.
        share: Called with the share of the recordings' steps that is done, 0 to 1, from several threads.

    Attributes:
        recordings: The recordings.
        steps: Physics steps taken so far.

    Raises:
        FileError: A recording is not of a pendulum, or has no voltage.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        *,
        timestep: float = TIMESTEP,
        workers: int | None = None,
        share: Callable[[float], None] = lambda _share: None,
    ) -> None:
        require_pendulum(recordings)
        self.recordings = list(recordings)
        self.timestep = timestep
        self._workers = workers
        self.steps = 0
        self._share, self._taken, self._lock = share, 0, threading.Lock()
        self._tracks = [Track(recording, timestep) for recording in recordings]

    def simulate(self, parameters: Array, which: Sequence[int] | None = None) -> list[Array]:
        """Simulate recordings from their first sample to their last.

        Args:
            parameters: Parameter sets, shape (m, len(PARAMETERS)).
            which: Indices of the recordings; None: all.

        Returns:
            For each of them the angles that the encoder would have read at its samples, shape (m, k) [rad].
        """
        chosen = range(len(self.recordings)) if which is None else which
        jobs = [(index, row) for index in chosen for row in range(len(parameters))]
        # Long ones first, dealt out in turn: the threads end together.
        jobs.sort(key=lambda job: -self._tracks[job[0]].steps)
        parts, _ = deal(len(jobs), self._workers, lambda share: self._run(jobs[share], parameters))
        results = {job: angles for part in parts for job, angles in part.items()}
        self.steps += sum(self._tracks[index].steps for index, _ in jobs)
        return [np.stack([results[index, row] for row in range(len(parameters))]) for index in chosen]

    def _run(self, jobs: list[tuple[int, int]], parameters: Array) -> dict[tuple[int, int], Array]:
        tracks = [self._tracks[index] for index, _ in jobs]
        lanes, longest = len(jobs), max(track.steps for track in tracks)
        sets = np.ascontiguousarray(parameters[[row for _, row in jobs]])
        at_once = [{**dict(zip(PARAMETERS, values, strict=True)), "delay": 0.0} for values in sets]  # goals come late
        twins = [
            build_pendulum(ServoParameters.single(values), track.load, self.timestep)
            for values, track in zip(at_once, tracks, strict=True)
        ]
        batch = Batch(twins[0].model, lanes, 1)
        _set_constants(batch, tracks, sets)
        views = Views.of_batch(batch, twins, gains=True)
        motors, qpos, qvel = Motors(twins, views), views.qpos, views.qvel
        # Inside, the angle is the pendulum's own; the encoder's differs by its offset.
        offset = sets[:, COLUMN["encoder_offset"]]
        qpos[:, 0] = np.array([track.start[0] for track in tracks]) - offset
        qvel[:, 0] = np.array([track.start[1] for track in tracks])
        batch.forward()
        inputs = _Inputs(tracks)
        angles = np.empty((longest + 1, lanes))
        angles[0] = qpos[:, 0]
        alive = every = np.arange(lanes)
        ends = np.array([track.steps for track in tracks])
        due = set(ends.tolist())
        for step in range(longest):
            if step in due:
                alive = every[ends > step]
            inputs.drive(step * self.timestep, self.timestep, sets, motors)
            motors.before_step(alive)
            batch.step(alive, 1)
            angles[step + 1] = qpos[:, 0]
            if (step + 1) % _TOLD == 0:
                self._tell(len(alive) * _TOLD)
        found = {}
        for lane, (job, track) in enumerate(zip(jobs, tracks, strict=True)):
            found[job] = np.interp(track.samples, track.grid, angles[: track.steps + 1, lane]) + offset[lane]
        return found

    def _tell(self, steps: int) -> None:
        with self._lock:
            self._taken += steps
            self._share(self._taken / sum(track.steps for track in self._tracks))


class _Inputs:
    """The tracks of all lanes as arrays of one length, shape (lanes, samples + 1), and the goal and sample in force."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        width = max(len(track.samples) for track in tracks) + 1
        self._arrays: list[Array] = []
        for column in range(len(tracks[0].arrays)):
            rows = np.stack([np.pad(t.arrays[column], (0, width - len(t.samples) - 1), mode="edge") for t in tracks])
            self._arrays.append(rows)
        self._release = np.array([track.release for track in tracks])
        self._cursor = np.zeros((len(tracks), 2), np.int64)

    def drive(self, now: float, timestep: float, sets: Array, motors: Motors) -> None:
        """Give every lane what its servo is told and fed in the next step; see `_drive`."""
        _drive(
            now, timestep, sets, *self._arrays, self._release, self._cursor,
            motors.goal, motors.p_gain, motors.driven, motors.temperature, motors.full,
        )  # fmt: skip


def _set_constants(batch: Batch, tracks: Sequence[Track], sets: Array) -> None:
    """Give each lane its pendulum and what its servo keeps all along."""
    mass, centre, inertia = np.array([track.load.body for track in tracks]).T
    batch.expand("body_mass")[:, 1] = mass
    batch.expand("body_ipos")[:, 1, 2] = -centre
    batch.expand("body_inertia")[:, 1] = inertia[:, None]
    batch.expand("actuator_armature")[:, 0] = sets[:, COLUMN["armature"]]
    batch.set_const()


_DELAY, _OFFSET = COLUMN["delay"], COLUMN["encoder_offset"]


@njit(nogil=True, error_model="numpy")
def _drive(
    time: float,
    timestep: float,
    sets: Array,
    times: Array,
    goals: Array,
    samples: Array,
    volts: Array,
    temperature: Array,
    torque: Array,
    p_gain: Array,
    release: Array,
    cursor: NDArray[np.int64],
    goal: Array,
    gain: Array,
    driven: Array,
    warmth: Array,
    full: Array,
) -> None:
    """Give every lane what its servo is told and fed in the next step.

    Args:
        time: Since the first sample [s].
        timestep: Of the physics [s].
        sets: Parameter sets, shape (lanes, len(PARAMETERS)).
        times: When each goal was sent, shape (lanes, k) [s], infinite beyond the end.
        goals: Shape (lanes, k) [rad].
        samples: When each sample was taken, shape (lanes, k) [s], infinite beyond the end.
        volts: Supply at each sample [V].
        temperature: At each sample [degC].
        torque: Torque Enable with each goal.
        p_gain: Position P Gain with each goal.
        release: When torque goes off, whatever the goals say, shape (lanes,) [s].
        cursor: The goal and the sample in force, shape (lanes, 2); written to.
        goal: This and what follows as in `Motors`, shape (lanes, 1); written to.
        gain: `p_gain`.
        driven: See there.
        warmth: `temperature`.
        full: See there.
    """
    for lane in range(sets.shape[0]):
        values = sets[lane]
        begin = time - values[_DELAY]
        told, at = goal_of_step(times[lane], goals[lane], cursor[lane, 0], begin, begin + timestep)
        cursor[lane, 0] = at
        row = cursor[lane, 1]
        while samples[lane, row + 1] <= time:
            row += 1
        cursor[lane, 1] = row
        share = min(max((release[lane] - time) / timestep, 0.0), 1.0)  # of this step in which the motor is driven
        goal[lane, 0], gain[lane, 0] = told - values[_OFFSET], p_gain[lane, at]
        driven[lane, 0] = share if torque[lane, at] else 0.0
        warmth[lane, 0], full[lane, 0] = temperature[lane, row], volts[lane, row]
