"""What recordings of a servo tell: which parameters by themselves, which not, and which ended at a bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robolamp.calibrate.servo.pendulum_fit import Solution
from robolamp.calibrate.servo.recordings import Recording

TOLD = 0.75
"""A parameter is identified when the recordings by themselves tell it to this share of its prior's error."""

POWERED = ("torque_constant", "resistance", "viscous")
"""While a motor drives, K / R and K^2 / R + viscous are all that moves it: what else seems to tell the three apart is
the friction terms' share of the motor's torque, and as uncertain as those."""

_FALL = 0.1  # motion with torque off that shows friction without back-EMF [rad]
_RIDGE = 1e-6  # what is left of a prior where it is taken away: keeps the inverse finite
_EDGE = 1e-3  # of a bound, in standard deviations of the prior


def told_apart(solution: Solution, name: str, dropped: bool) -> bool:
    """Return whether the recordings tell a parameter: by themselves, not by what the priors say of the others.

    Args:
        solution: Of a fit in which it was free, at its own optimum.
        name: The parameter.
        dropped: Whether a recording shows the servo moving with its torque off.
    """
    if name in POWERED and not dropped:
        return False
    prior = np.eye(len(solution.z))
    alone = np.linalg.inv(np.linalg.inv(solution.covariance) - (1 - _RIDGE) * prior)
    index = solution.chart.names.index(name)
    return bool(0.0 < alone[index, index] < TOLD**2)


def at_bound(solution: Solution) -> list[str]:
    """Return the free parameters that ended at the edge of what they may be."""
    chart = solution.chart
    return [
        name
        for name, value, low, high in zip(chart.names, solution.z, chart.low, chart.high, strict=True)
        if min(value - low, high - value) < _EDGE
    ]


def dropped(recordings: Sequence[Recording]) -> bool:
    """Return whether a recording shows the servo moving with its torque off."""
    return any(
        np.ptp(recording.angle[~recording.torque]) > _FALL for recording in recordings if not recording.torque.all()
    )
