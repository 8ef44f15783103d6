"""A pilot that gives way to the hand that moves the lamp."""

from __future__ import annotations

import numpy as np

from robolamp.controller.goal_pilot import GoalPilot
from robolamp.controller.pilot import PilotStep
from robolamp.lamp import Lamp
from robolamp.pose.gesture import PERIOD
from robolamp.signals import Observation

BAND = 0.08
"""How far a joint may be from its goal before the goal follows [rad]: what its weight alone does to the lamp's joints
(`robolamp gesture check` shows 0.07 to 0.1), so that it holds itself and a hand's push is followed."""


class HandPilot(GoalPilot):
    """Lets goals follow the joints, each once its joint is further away than a band.

    Args:
        lamp: Limits and slew.
        band: That far [rad]; 0: goals are the angles themselves.
    """

    def __init__(self, lamp: Lamp, band: float = BAND) -> None:
        super().__init__(lambda time: self._goal, lamp, PERIOD)
        self._band = band
        self._lamp = lamp
        self._goal = np.zeros(len(lamp.joints))

    def step(self, observation: Observation, time: float) -> PilotStep:
        """Return the goals for one tick.

        Args:
            observation: Where the joints are.
            time: Since the run began, by the schedule [s].
        """
        angle = np.clip(observation.angle, self._lamp.lower, self._lamp.upper)
        self._goal = np.clip(self._goal, angle - self._band, angle + self._band)
        self._goal = np.clip(self._goal, self._lamp.lower, self._lamp.upper)
        return super().step(observation, time)
