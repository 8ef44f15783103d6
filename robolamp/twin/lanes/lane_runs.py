"""Runs: lanes that controllers drive, whatever their bodies are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.twin.engine import Lanes
from robolamp.twin.judges.key_poses import KeyPose
from robolamp.twin.judges.run_outcome import RunOutcome

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Job:
    """A lane: which program on which lamp to which goal.

    Attributes:
        program: Index of the program.
        variant: Index of the lamp, or of the figure.
        goal: Commanded distance [m].
        goal_time: Commanded time to take for it [s]; 0: none is commanded.
        direction: Of the goal, from x towards y [rad]; the lamp's is always ahead.
    """

    program: int
    variant: int
    goal: float
    goal_time: float = 0.0
    direction: float = 0.0


@dataclass(frozen=True)
class RunSettings:
    """What all lanes of a fleet have in common.

    Attributes:
        terminals: What the programs read, in their order.
        period: Control period [s].
        duration: Length of a run [s].
        poses: Poses that every lane is compared with.
        read: Terminals that are read, or recorded.
    """

    terminals: tuple[str, ...]
    period: float
    duration: float
    poses: Sequence[KeyPose] = ()
    read: frozenset[str] = frozenset()


class Runs(ABC):
    """Lanes that controllers drive: what a fleet needs to know of bodies.

    A body says what its controllers read, what becomes of their goals, and how a run is judged.

    Args:
        lanes: The lanes, in the states that their runs start from.
        settings: What they have in common.
        timestep: Physics step [s].

    Attributes:
        lanes: The lanes.
        inputs: What the controllers read, shape (k, terminals) in the programs' order.
        unstable: Which of them diverged, shape (k,).
    """

    inputs: Array
    unseen: Sequence[int] = ()
    """Addresses in `qpos` of what turns without being seen."""

    def __init__(self, lanes: Lanes, settings: RunSettings, timestep: float) -> None:
        self.lanes = lanes
        self.unstable = np.zeros(lanes.count, bool)
        self._substeps = round(settings.period / timestep)
        # The first reading: sensors describe a state only after a step, and what has settled stands on its feet.
        lanes.batch.forward()

    @abstractmethod
    def sense(self, time: float) -> None:
        """Write what the controllers read now into `inputs`.

        Args:
            time: Since the runs began [s].
        """

    def advance(self, goals: Array, alive: NDArray[np.int64]) -> None:
        """Send goals and simulate a control period.

        Args:
            goals: Of all lanes, shape (k, n); of the kind that the bodies' drive says.
            alive: Lanes that still run.
        """
        self._send(goals)
        for substep in range(self._substeps):
            self._drive(alive, substep)
            self.lanes.step(alive)
            self._judge(alive)

    def survivors(self, time: float) -> NDArray[np.int64]:
        """Return the lanes that still run after a control period.

        Args:
            time: When it began [s].
        """
        self.unstable |= self.lanes.diverged
        return np.flatnonzero(~self._ended(time))

    @abstractmethod
    def outcome(self, interventions: NDArray[np.int64]) -> RunOutcome:
        """Return what became of the runs.

        Args:
            interventions: What the envelope changed, shape (k,).
        """

    @abstractmethod
    def _send(self, goals: Array) -> None:
        """Take the goals of a control period, shape (k, n)."""

    @abstractmethod
    def _drive(self, alive: NDArray[np.int64], substep: int) -> None:
        """Write what the next physics step of a control period needs; the goals of `_send` stay as they were."""

    @abstractmethod
    def _judge(self, alive: NDArray[np.int64]) -> None:
        """Look at the physics step that was taken."""

    @abstractmethod
    def _ended(self, time: float) -> NDArray[np.bool_]:
        """Return which lanes run no more, shape (k,), after the control period that began then [s]."""
