"""How the firmware's commands reach motors in the physics: goals, duties, torque on and off, within a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.emulator.servo.drive import Drive
from robolamp.twin.actuators.motors import Motors

Array = NDArray[np.float64]


class Driver:
    """What servos do to the motors of one lane, from whatever moment within a physics step it begins.

    Args:
        motors: They alone are driven by it; all windings are open at first.
    """

    def __init__(self, motors: Motors) -> None:
        self._motors = motors
        motors.driven[:] = 0.0
        self._arriving: list[tuple[Array, int, float]] = []  # what holds from the step after the next on

    def drive(self, joint: int, drive: Drive, late: float = 0.0) -> None:
        """Set what a servo does to its motor from the next step on.

        Args:
            joint: Which joint.
            drive: What it does; goal and duty in the joint's sense.
            late: How far into the next step that begins, 0 to 1 of it: that step's goal is the mean of the one before
                and this one, weighted by the time that each holds, or else every goal would come early; and a motor
                that is switched off is driven for that share.
        """
        motors, late = self._motors, min(max(late, 0.0), 1.0)
        driven, goals, by_duty = motors.driven[0], motors.goal[0], drive.duty is not None
        if not drive.torque:
            self._set(driven, joint, 0.0, late if driven[joint] else 0.0)
            return
        goal = drive.goal if drive.duty is None else drive.duty
        if not driven[joint] or by_duty != motors.by_duty[0, joint]:
            motors.forget(goal, joint)  # a servo that is switched on has forgotten what it was told before
        driven[joint], motors.by_duty[0, joint] = 1.0, by_duty
        motors.p_gain[0, joint], motors.limit[0, joint] = drive.p_gain, drive.duty_limit
        self._set(goals, joint, goal, goal + late * (goals[joint] - goal))

    def after_step(self) -> None:
        """Let what began within the last step go on."""
        for values, joint, value in self._arriving:
            values[joint] = value
        self._arriving.clear()

    def _set(self, values: Array, joint: int, value: float, at_first: float) -> None:
        values[joint] = at_first
        self._arriving.append((values, joint, value))
