"""A pilot without a controller: it plays goals that were planned before, whatever is measured."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.envelope import Envelope
from robolamp.controller.hop_counter import SignalLimits
from robolamp.controller.pilot import PilotStep
from robolamp.controller.terminals import Signals
from robolamp.lamp import Lamp
from robolamp.signals import Observation

Array = NDArray[np.float64]


class GoalPilot:
    """Plays goals in the loop, where a controller would be; the same envelope keeps them safe.

    Args:
        goal: Returns the goals at a time since the run began [s], shape (n,) [rad].
        lamp: Limits and slew.
        period: Control period [s].
        start: What the joints are holding at the beginning, shape (n,) [rad]; None: the neutral pose.
    """

    terminals: tuple[str, ...] = ()

    def __init__(self, goal: Callable[[float], Array], lamp: Lamp, period: float, start: Array | None = None) -> None:
        n = len(lamp.joints)
        self._wanted = goal
        self.control_period = period
        self._envelope = Envelope(lamp.lower, lamp.upper, lamp.slew, period, np.zeros(n) if start is None else start)
        self._contact = Signals(1, n, SignalLimits.of(lamp, period), ())
        self._nowhere = np.zeros(1)

    def step(self, observation: Observation, time: float) -> PilotStep:
        """Return the goals for one tick.

        Args:
            observation: What was measured; only the foot's contact is made of it.
            time: Since the run began, by the schedule [s].
        """
        self._contact.update(observation.angle[None], np.array([observation.foot_force]), self._nowhere)
        wanted = self._wanted(time)
        return PilotStep(
            inputs=np.empty(0),
            outputs=wanted,
            goal=self._envelope.apply(wanted),
            hops=int(self._contact.hops[0]),
            contact=bool(self._contact.contact[0]),
            interventions=self._envelope.interventions,
        )
