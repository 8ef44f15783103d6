"""Playback: the motion of one lane of a fleet, from the goals that it was sent."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.twin.arena import Drives
from robolamp.twin.body import Body
from robolamp.twin.figure import STATE, FigureTwin
from robolamp.twin.fleet import SETTLED, Job, settle
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


def play_figure(twin: FigureTwin, job: Job, goals: NDArray[np.float64], period: float) -> NDArray[np.float64]:
    """Return the positions of a figure that stands and then is sent goals: to the bit those of the fleet's lane.

    Args:
        twin: The figure.
        job: The lane: where its goal is.
        goals: Goals as sent, tick by tick (`Trace.goals` of a lane), shape (k, n) [rad/s or rad, by its drive].
        period: Control period [s].

    Returns:
        MuJoCo positions at the start of each tick and at the end, shape (k + 1, nq); 0 for the drives, which nobody
        sees turn.
    """
    model, data, drives = twin.model, mujoco.MjData(twin.model), Drives(twin)
    mujoco.mj_setState(model, data, twin.state, STATE)
    if twin.goal is not None:
        data.qpos[twin.goal : twin.goal + 2] = job.goal * np.cos(job.direction), job.goal * np.sin(job.direction)
    mujoco.mj_forward(model, data)
    qpos = np.empty((len(goals) + 1, model.nq))
    for tick, goal in enumerate(goals):
        qpos[tick] = data.qpos
        for _ in range(round(period / twin.timestep)):
            drives.ask(data.ctrl[None], goal[None], data.qpos[None])
            mujoco.mj_step(model, data)
    qpos[-1] = data.qpos
    turning = [model.joint(f"drive_{name}").qposadr[0] for name in twin.figure.names]
    qpos[:, turning] = 0.0
    return qpos
