"""The pilot: a controller at work on one lamp. Observations in, goals out, once a tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.controller_file import Controller, check_goal_time, check_terminals
from robolamp.controller.envelope import Envelope
from robolamp.controller.hop_counter import SignalLimits
from robolamp.controller.terminals import FOOT_WINDOW, OPTIONAL, Signals, on_board_terminals
from robolamp.lamp import Lamp
from robolamp.signals import Interventions, Observation, Way


@dataclass(frozen=True)
class PilotStep:
    """What the pilot made of one observation.

    Attributes:
        inputs: Terminal values, in the order of the pilot's `terminals`.
        outputs: The controller's raw outputs, shape (n,) [rad].
        goal: What may be sent, shape (n,) [rad].
        hops: Hops so far, as the foot sensor tells them.
        contact: Whether the foot is on the ground.
        interventions: Running totals of the envelope.
        way: How far the lamp has come; None: no odometer tells.
    """

    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]
    goal: NDArray[np.float64]
    hops: int
    contact: bool
    interventions: Interventions
    way: Way | None = None


class Pilot:
    """Evaluates a controller on board; everything is compiled when it is made, before anything moves.

    Args:
        controller: The controller.
        lamp: The lamp.
        goal: Commanded distance [m].
        goal_time: Commanded time to take for it [s]; None: none is commanded.

    Raises:
        ExpressionError: The controller needs a signal that the lamp has not, or a time that was not commanded.
    """

    def __init__(self, controller: Controller, lamp: Lamp, goal: float, goal_time: float | None = None) -> None:
        n = len(lamp.joints)
        check_goal_time(controller, goal_time)
        known = on_board_terminals(n, odometer=lamp.odometer is not None) + (() if goal_time is None else OPTIONAL)
        check_terminals(controller, known, controller.name)
        self.terminals = known if lamp.odometer is None else known + FOOT_WINDOW
        self._program = controller.compile(self.terminals)
        self._limits = SignalLimits.of(lamp, controller.control_period)
        self._lamp = lamp
        self._n = n
        self._goal = np.array([goal])
        self._goal_time = 0.0 if goal_time is None else goal_time
        self.control_period = controller.control_period
        self.reset(np.zeros(n))

    def reset(self, goal: NDArray[np.float64]) -> None:
        """Begin a run.

        Args:
            goal: What the joints are holding, shape (n,) [rad].
        """
        self._tick = -1
        self._signals = Signals(1, self._n, self._limits, self.terminals)
        self._envelope = Envelope(self._lamp.lower, self._lamp.upper, self._lamp.slew, self._limits.period, goal)

    def step(self, observation: Observation, time: float) -> PilotStep:
        """Return the goals for one tick.

        Args:
            observation: What was measured; missing values (NaN) keep their last.
            time: Since the run began, by the schedule [s]; ticks that were missed are counted by it.
        """
        force = np.array([observation.foot_force])
        tick = round(time / self._limits.period)
        inputs = self._signals.update(
            observation.angle[None], force, self._goal, elapsed=tick - self._tick, goal_time=self._goal_time,
            foot=(np.array([observation.foot_mean]), np.array([observation.foot_contact])),
        )[0]  # fmt: skip
        self._tick = tick
        outputs = np.array(self._program.run(inputs.tolist()))
        goal = self._envelope.apply(outputs)
        return PilotStep(
            inputs=inputs.copy(),
            outputs=outputs,
            goal=goal,
            hops=int(self._signals.hops[0]),
            contact=bool(self._signals.contact[0]),
            interventions=self._envelope.interventions,
            way=self._signals.way,
        )
