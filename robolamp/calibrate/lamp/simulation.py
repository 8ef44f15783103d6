"""The whole lamp, simulated open loop beside its recordings: many lamps (one a lane) through one recording at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.lamp.session import LampRecording
from robolamp.twin.actuators.servo import REFERENCE_TEMPERATURE
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.lanes.lamp_lanes import Lamps
from robolamp.twin.lanes.open_loop import goals_by_step

Array = NDArray[np.float64]

SETTLE = 0.4
"""How long a lamp stands with its first goals before a recording begins [s]."""

_VOLTAGE_TICKS = 5  # readings that a supply voltage is the mean of: it comes in steps of 0.1 V
_RESIDUAL_OF_CHAOS = 1.0  # what a lane that diverged is off by [rad]: more than any joint can be


@dataclass(frozen=True)
class Simulated:
    """What k lamps did in one recording of N samples.

    Attributes:
        angle: Joint angles when they were measured, shape (k, N, n) [rad]; NaN where they were not.
        base_x: Base centre, shape (k, N) [m].
        contact_time: Time of each physics step, shape (S,) [s].
        contact: Whether the floor carried the foot, shape (k, S).
    """

    angle: Array
    base_x: Array
    contact_time: Array
    contact: NDArray[np.bool_]


def simulate(recording: LampRecording, twins: Sequence[TwinModel]) -> Simulated:
    """Play a recording's goals to lamps, open loop from its first sample to its last, with its voltage as recorded.

    A goal arrives when it had been sent; the servos' delay follows.

    Args:
        recording: What to play.
        twins: The lamps, k variants of one model (clamped where the recording is).

    Returns:
        What they did; a lamp whose physics diverged is off by 1 rad throughout.
    """
    run, twin, lanes = recording.run, twins[0], len(twins)
    rows, dt = recording.rows, twin.timestep
    # Voltages are as recorded, sag and all.
    lamps = Lamps([replace(each, supply_resistance=0.0) for each in twins], gains=True)
    drive, qpos = lamps.motors, lamps.qpos
    drive.p_gain[:] = recording.p_gain
    temperature = np.nan_to_num(run.temperature[rows], nan=REFERENCE_TEMPERATURE)
    voltage = _smooth(run.voltage[rows], twin.voltage)
    every = np.arange(lanes)

    hold = run.goal[max(recording.first - 1, 0)]
    lamps.batch.reset()
    qpos[:] = twin.model.key_qpos[0]
    drive.place(_first_known(run.angle[rows]))
    drive.forget(hold)
    drive.full[:] = voltage[0]
    for _ in range(round(SETTLE / dt)):
        lamps.step(every)
    # Goals are under way and the foot is on the floor now; the joints fell a little until the goals came.
    drive.turn(_first_known(run.angle[rows]))
    lamps.qvel[:] = 0.0
    begin = float(np.nanmin(run.sampled_at[rows]))
    count = round((float(np.nanmax(run.sampled_at[rows])) - begin) / dt) + 2
    time = np.asarray(begin + dt * np.arange(count), np.float64)
    goals = goals_by_step(hold, run.goal[rows], run.write_done[rows] - begin, dt, count)
    at_tick = np.clip(np.searchsorted(run.began[rows], time, side="right") - 1, 0, None)
    angles, forces = np.empty((count, lanes, len(twin.qpos))), np.empty((count, lanes))
    base = np.empty((count, lanes))
    lamps.forgive()
    for step in range(count):
        angles[step], base[step] = drive.angle, qpos[:, 0]
        forces[step] = lamps.force
        torque = bool(time[step] + dt / 2 < recording.limp_from)
        drive.full[:], drive.temperature[:] = voltage[at_tick[step]], temperature[at_tick[step]]
        drive.driven[:] = torque
        drive.goal[:] = goals[step]
        lamps.step(every)
    measured_at = run.sampled_at[rows]
    angle = np.empty((lanes, measured_at.shape[0], len(twin.qpos)))
    for joint in range(len(twin.qpos)):
        angle[:, :, joint] = _at(measured_at[:, joint], begin, dt, angles[:, :, joint]).T
    angle[lamps.diverged] = run.angle[rows] + _RESIDUAL_OF_CHAOS
    angle[:, ~np.isfinite(measured_at)] = np.nan
    foot_at = run.measured_at[rows] - run.foot_age[rows]
    return Simulated(
        angle=angle,
        base_x=_at(foot_at, begin, dt, base).T,
        contact_time=time,
        contact=(forces > 0.0).T,
    )


def rescale(twin: TwinModel, mass: float) -> None:
    """Scale a lamp's masses and inertias so that the whole weighs what a scale showed.

    Args:
        twin: The lamp; its model is written to.
        mass: [kg].
    """
    share = mass / mass_of(twin)
    twin.model.body_mass[:] *= share
    twin.model.body_inertia[:] *= share
    mujoco.mj_setConst(twin.model, mujoco.MjData(twin.model))


def mass_of(twin: TwinModel) -> float:
    """Return the mass of a whole lamp [kg]."""
    return float(twin.model.body_subtreemass[0])


def _smooth(voltage: Array, otherwise: float) -> Array:
    """Return running means of the voltages read, shape (N, n) [V]; where none is known, another."""
    known = np.where(np.isfinite(voltage), voltage, np.nan)
    if np.isnan(known).all():
        return np.full(voltage.shape, otherwise)
    filled = np.where(np.isfinite(known), known, np.nanmean(known))
    half = _VOLTAGE_TICKS // 2
    padded = np.pad(filled, ((half, half), (0, 0)), mode="edge")
    return np.stack([padded[i : i + len(filled)] for i in range(_VOLTAGE_TICKS)]).mean(axis=0)


def _first_known(angle: Array) -> Array:
    """Return each joint's first measured angle, shape (n,) [rad]."""
    row = np.isfinite(angle).argmax(axis=0)
    return np.nan_to_num(angle[row, np.arange(angle.shape[1])])


def _at(time: Array, begin: float, dt: float, values: Array) -> Array:
    """Return values (a row a physics step) at other times, a row each; between two steps linear."""
    place = np.clip((np.nan_to_num(time, nan=begin) - begin) / dt, 0.0, len(values) - 1.001)
    low = place.astype(np.int64)
    share = (place - low).reshape(-1, *[1] * (values.ndim - 1))
    return values[low] * (1.0 - share) + values[low + 1] * share
