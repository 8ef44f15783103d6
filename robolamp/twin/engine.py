"""The engine: many lanes of one model that are stepped together, and how lanes are dealt out to threads.

Lamps and figures under controllers, replays of what was recorded, and the bench are put on it. Lanes do not touch each
other: what one does is the same to the bit whichever others there are, on however many threads.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch
from numpy.typing import NDArray

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""What the state of a lane holds."""


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
    """Return a copy of a state that lanes can start from, shape (nstate,)."""
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    return state


class Variants:
    """MuJoCo models that differ in numbers only.

    Args:
        models: The models.

    Raises:
        ValueError: They differ in more than numbers.
    """

    def __init__(self, models: Sequence[mujoco.MjModel]) -> None:
        self.model = models[0]
        self.count = len(models)
        self._differing: dict[str, NDArray[np.float64]] = {}
        for name in sorted(MODEL_FIELDS):
            if name.startswith("opt.") and name != "opt.gravity":
                continue
            values = [operator.attrgetter(name)(model) for model in models]
            if any(value.shape != values[0].shape for value in values):
                raise ValueError(f"the models differ in more than numbers: {name}")
            if any(not np.array_equal(values[0], value) for value in values[1:]):
                self._differing[name] = np.stack(values)

    def batch(self, variant: NDArray[np.int64]) -> Batch:
        """Return lanes for one thread.

        Args:
            variant: Which of the models each lane has, shape (k,).
        """
        batch, present = Batch(self.model, len(variant), 1), np.unique(variant)
        for name, values in self._differing.items():
            if (values[present] != values[0]).any():
                batch.expand(name)[:] = values[variant]
        return batch


class Lanes:
    """Lanes that are stepped together, on one thread.

    Args:
        variants: The models.
        variant: Which of them each lane has, shape (k,); None: a lane a model.
        states: State of each lane, shape (k, nstate), or one for all; None: MuJoCo's default.

    Attributes:
        batch: MuJoCo's lanes.
        qpos: Positions, shape (k, nq); written to.
        qvel: Velocities, shape (k, nv); written to.
        sensors: `sensordata`, shape (k, nsensordata).
        count: Number of lanes, k.
        steps: Physics steps taken so far, of all lanes together.
    """

    def __init__(
        self,
        variants: Variants,
        variant: NDArray[np.int64] | None = None,
        states: NDArray[np.float64] | None = None,
    ) -> None:
        self.variant = np.arange(variants.count) if variant is None else variant
        self.batch = variants.batch(self.variant)
        if states is not None:
            self.batch.state[:] = states
        self.qpos, self.qvel, self.sensors = (self.batch.bind(name) for name in ("qpos", "qvel", "sensordata"))
        self.count, self.steps = len(self.variant), 0
        self.forgive()

    def step(self, lanes: NDArray[np.int64]) -> None:
        """Take a physics step.

        Args:
            lanes: Which lanes.
        """
        self.batch.step(lanes if len(lanes) < self.count else None, 1)
        self.steps += len(lanes)

    def forgive(self) -> None:
        """Tell from here on which lanes diverge."""
        self._warned = self.batch.warning[:, :, 1].copy()

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes have diverged, shape (k,): MuJoCo resets them silently, only its warning counters tell."""
        return (self.batch.warning[:, :, 1] > self._warned).any(axis=1)


Result = TypeVar("Result")


def deal(count: int, workers: int | None, work: Callable[[slice], Result]) -> tuple[list[Result], NDArray[np.int64]]:
    """Deal lanes out to threads.

    Args:
        count: How many lanes.
        workers: How many threads at most; None: one for each core.
        work: Runs some of the lanes.

    Returns:
        What it gave for each share, and where each lane stands when the shares are put one after the other, shape
        (count,).
    """
    # Dealt out in turn: neighbours are often of one program, and fall, or do not, together.
    workers = min(workers or len(os.sched_getaffinity(0)), count)
    shares = [slice(first, None, workers) for first in range(workers)]
    order = np.argsort(np.concatenate([np.arange(count)[share] for share in shares]))
    if workers == 1:
        return [work(shares[0])], order
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, shares)), order
