"""Playback: the motion of one lane of a fleet, from the goals that it was sent."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.twin.body import Body
from robolamp.twin.fleet import SETTLED, settle
from robolamp.twin.model import TwinModel


def play(twin: TwinModel, goals: NDArray[np.float64], period: float, ticks: int) -> NDArray[np.float64]:
    """Return the positions of a lamp that stands and then is sent goals: to the bit those of the fleet's lane.

    Args:
        twin: The lamp.
        goals: Goals as sent, tick by tick (`Trace.goals` of a lane), shape (k, n) [rad]; the last one is kept up.
        period: Control period [s].
        ticks: How many control periods to play.

    Returns:
        MuJoCo positions at the start of each tick and at the end, shape (ticks + 1, nq).
    """
    body = Body(twin)
    mujoco.mj_setState(body.model, body.data, settle(twin), SETTLED)
    mujoco.mj_forward(body.model, body.data)
    substeps, arrival = round(period / twin.timestep), round(twin.line_delay / twin.timestep)
    qpos = np.empty((ticks + 1, twin.model.nq))
    for step in range(ticks * substeps):
        if step % substeps == 0:
            qpos[step // substeps] = body.data.qpos
        sent = (step - arrival) // substeps
        if sent >= 0:
            body.set_goal(goals[min(sent, len(goals) - 1)])
        body.step()
    qpos[ticks] = body.data.qpos
    return qpos
