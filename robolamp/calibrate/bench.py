"""A servo with a pendulum on its shaft, in MuJoCo: many recordings and many parameter sets at once, open loop.

The motor is `robolamp.twin.servo`'s, the same kernels that the lamp's twin calls before each step. A goal that changes
between two steps counts in each for its share, so that results are smooth in the delay.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from robolamp.calibrate.pendulum import (
    COLUMN,
    OPEN,
    TIMESTEP,
    Track,
    goal_of_step,
    require_pendulum,
)
from robolamp.calibrate.recordings import COUNTS_PER_RADIAN, FULL_DUTY, Recording
from robolamp.jit import njit
from robolamp.twin.lanes import deal
from robolamp.twin.pendulum import pendulum_model
from robolamp.twin.servo import friction_loss, weaken

Array = NDArray[np.float64]

_R, _KP, _KD, _VMAX = 0, 4, 6, 7  # columns of a dcmotor's actuator_gainprm
_DOF = np.zeros(1, np.int64)
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
        self._model = pendulum_model(timestep)
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
        batch = Batch(self._model, lanes, 1)
        _set_constants(batch, tracks, sets)
        qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        motor, bias = batch.bind("qfrc_actuator"), batch.bind("qfrc_bias")
        loss, gain, damping = (
            batch.expand(name) for name in ("dof_frictionloss", "actuator_gainprm", "actuator_damping")
        )
        # Inside, the angle is the pendulum's own; the encoder's differs by its offset.
        offset = sets[:, COLUMN["encoder_offset"]]
        qpos[:, 0] = np.array([track.start[0] for track in tracks]) - offset
        qvel[:, 0] = np.array([track.start[1] for track in tracks])
        batch.forward()
        inputs = _Inputs(tracks)
        friction, weakness = _coefficients(sets)
        angles = np.empty((longest + 1, lanes))
        angles[0] = qpos[:, 0]
        alive = every = np.arange(lanes)
        ends = np.array([track.steps for track in tracks])
        due = set(ends.tolist())
        for step in range(longest):
            if step in due:
                alive = every[ends > step]
            inputs.drive(step * self.timestep, self.timestep, sets, ctrl, gain, damping, weakness)
            weaken(weakness, _DOF, _DOF, motor, qvel, gain)
            friction_loss(alive, friction, _DOF, motor, bias, qvel, loss)
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

    def drive(
        self, now: float, timestep: float, sets: Array, ctrl: Array, gain: Array, damping: Array, weakness: Array
    ) -> None:
        """Give every lane what its servo is told and fed in the next step; see `_drive`."""
        times, goals, samples, volts, warmth, torque, p_gain = self._arrays
        _drive(
            now, timestep, sets, times, goals, samples, volts, warmth, torque, p_gain, self._release,
            self._cursor,
            ctrl, gain, damping, weakness,
        )  # fmt: skip


def _set_constants(batch: Batch, tracks: Sequence[Track], sets: Array) -> None:
    """Give each lane its pendulum and what its servo keeps all along."""
    mass, centre, inertia = np.array([track.load.body for track in tracks]).T
    batch.expand("body_mass")[:, 1] = mass
    batch.expand("body_ipos")[:, 1, 2] = -centre
    batch.expand("body_inertia")[:, 1] = inertia[:, None]
    batch.expand("actuator_armature")[:, 0] = sets[:, COLUMN["armature"]]
    k = sets[:, COLUMN["torque_constant"]]
    batch.expand("actuator_gainprm")[:, 0, 1] = k
    batch.expand("actuator_gainprm")[:, 0, _R] = OPEN
    batch.set_const()


def _coefficients(sets: Array) -> tuple[Array, Array]:
    """Return what `friction_loss` and `weaken` take, shapes (lanes, 1, 9) and (lanes, 1, 5)."""

    def column(name: str) -> Array:
        return sets[:, COLUMN[name]]

    friction = [
        column("coulomb"), column("stribeck"), 1.0 / column("stribeck_velocity"), column("load_motor"),
        column("load_external"), column("load_external_stribeck"), column("load_motor_stribeck"),
        column("stribeck_exponent"), column("asymmetry"),
    ]  # fmt: skip
    names = ("torque_constant", "resistance", "saturation", "supply_resistance", "resistance")
    weakness = [column(name) for name in names]
    return np.stack(friction, axis=1)[:, None], np.stack(weakness, axis=1)[:, None]


_K, _RESISTANCE, _VISCOUS, _DIVISOR, _DELAY, _WARM_R, _WARM_B, _SATURATION, _SUPPLY, _OFFSET = (
    COLUMN[name]
    for name in (
        "torque_constant", "resistance", "viscous", "gain_divisor", "delay", "resistance_temperature",
        "viscous_temperature", "saturation", "supply_resistance", "encoder_offset",
    )
)  # fmt: skip


@njit(nogil=True, error_model="numpy")
def _drive(
    time: float,
    timestep: float,
    sets: Array,
    times: Array,
    goals: Array,
    samples: Array,
    volts: Array,
    warmth: Array,
    torque: Array,
    p_gain: Array,
    release: Array,
    cursor: NDArray[np.int64],
    ctrl: Array,
    gain: Array,
    damping: Array,
    weakness: Array,
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
        warmth: Degrees above the reference temperature at each sample.
        torque: Torque Enable with each goal.
        p_gain: Position P Gain with each goal.
        release: When torque goes off, whatever the goals say, shape (lanes,) [s].
        cursor: The goal and the sample in force, shape (lanes, 2); written to.
        ctrl: Shape (lanes, 1); written to.
        gain: `actuator_gainprm`, shape (lanes, 1, 10); written to.
        damping: `actuator_damping`, shape (lanes, 1); written to.
        weakness: What `weaken` takes, shape (lanes, 1, 5); written to.
    """
    for lane in range(sets.shape[0]):
        values = sets[lane]
        begin = time - values[_DELAY]
        goal, at = goal_of_step(times[lane], goals[lane], cursor[lane, 0], begin, begin + timestep)
        cursor[lane, 0] = at
        row = cursor[lane, 1]
        while samples[lane, row + 1] <= time:
            row += 1
        cursor[lane, 1] = row
        motor = gain[lane, 0]
        warm = warmth[lane, row]
        resistance = values[_RESISTANCE] * max(1.0 + values[_WARM_R] * warm, 0.1)
        weakness[lane, 0, 1] = resistance
        damping[lane, 0] = values[_VISCOUS] * np.exp(values[_WARM_B] * warm)
        share = min((release[lane] - time) / timestep, 1.0)  # of this step in which the motor is driven
        if torque[lane, at] == 0.0 or share <= 0.0:
            motor[_R], motor[_KP], motor[_KD] = OPEN, 0.0, 0.0
            continue
        if motor[_R] == OPEN or (values[_SATURATION] == 0.0 and values[_SUPPLY] == 0.0):
            motor[_R] = resistance
        if share < 1.0:
            motor[_R] /= share
        k, volt = values[_K], volts[lane, row]
        kv = p_gain[lane, at] * COUNTS_PER_RADIAN / (values[_DIVISOR] * FULL_DUTY) * volt
        motor[_KP], motor[_KD], motor[_VMAX] = kv * k / motor[_R], k * k / motor[_R], volt
        ctrl[lane, 0] = goal - values[_OFFSET]
