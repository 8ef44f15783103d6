"""The way by the lamp's odometer, against the way that it truly came where somebody knows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robolamp.log.reader import Run

_FAR = 3.0  # standard errors


@dataclass(frozen=True)
class MeasuredWay:
    """What a lamp's odometer made of a run.

    Attributes:
        length: How far the lamp came by it [m].
        stderr: Its standard error [m].
        travelled: How far it truly came [m]; NaN: nobody knows.
    """

    length: float
    stderr: float
    travelled: float

    @property
    def error(self) -> float:
        """How far the odometer is off [m]; NaN where nobody knows."""
        return self.length - self.travelled

    @property
    def text(self) -> str:
        """Return it in words."""
        said = f"counted {self.length * 100:.1f} cm, give or take {self.stderr * 100:.1f}"
        if math.isnan(self.travelled):
            return f"{said}."
        far = " That is further off than it says." if abs(self.error) > _FAR * self.stderr else ""
        return f"{said}; travelled {self.travelled * 100:.1f} cm.{far}"


def measured_way(run: Run, travelled: float) -> MeasuredWay | None:
    """Return what a lamp's odometer made of a run; None where the log holds none of it.

    Args:
        run: The log.
        travelled: How far the lamp truly came [m]; NaN: nobody knows.
    """
    if not {"way", "way_stderr"} <= set(run.terminals) or run.inputs.shape[1] < len(run.terminals):
        return None  # no odometer, or no tick that the controller drove
    length, stderr = (run.inputs[:, run.terminals.index(name)] for name in ("way", "way_stderr"))
    told = np.flatnonzero(np.isfinite(length))
    return MeasuredWay(float(length[told[-1]]), float(stderr[told[-1]]), travelled) if told.size else None
