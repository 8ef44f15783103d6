"""Foot and floor, from a lamp that stands and hops: the sensor's gain, the floor's friction, the contact's softness.

Forces at rest and in flight give the sensor's gain and offset. Friction and softness are tried on a grid: a hop's
length jumps with them, so that there is no slope to go down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibrate.lamp.session import LampRecording
from robolamp.calibrate.lamp.simulation import Simulated, mass_of, simulate
from robolamp.calibration import LAMP, Calibration, Parameter
from robolamp.controller.hop_counter import shortest_flight
from robolamp.lamp import Lamp
from robolamp.twin.lamp_model import TwinModel, build

Array = NDArray[np.float64]

FRICTION = np.geomspace(0.6, 1.6, 9)
"""Floor friction, in shares of the calibration's: rubber on wood is 0.6 to 1.0, on glass less."""

SOFTNESS = np.array([1.0, 1.4, 2.0, 2.8])
"""Contact time constants, in shares of the model's, which is as hard as its step allows."""

TRAVEL_ERROR = 0.04
"""What a hop's length is trusted to, relative: a ruler reads 2 mm, and two hops are never alike."""

TIME_ERROR = 0.010
"""What take-off and landing are trusted to [s]: the foot sensor gives 80 readings a second."""

_PRIOR = (0.25, 0.4)  # standard deviations of the logarithms of friction and softness before any hop
_STILL = 0.02  # speed below which a joint counts as at rest [rad/s]


@dataclass(frozen=True)
class Flight:
    """One flight of a recording.

    Attributes:
        takeoff: By the foot sensor, since the recording's first sample [s].
        landing: [s].
        predicted_takeoff: In the twin [s]; NaN where it does not fly then.
        predicted_landing: In the twin [s].
    """

    takeoff: float
    landing: float
    predicted_takeoff: float
    predicted_landing: float


@dataclass(frozen=True)
class Floor:
    """What standing and hopping told.

    Attributes:
        values: Parameter of the lamp: value and standard error.
        foot_offset: Foot sensor reading with the foot in the air [N]; NaN where it never was.
        travel: How far each hop went, measured and predicted, by recording [m].
        flights: Every flight.
    """

    values: dict[str, tuple[float, float]]
    foot_offset: float
    travel: dict[str, tuple[float, float]]
    flights: tuple[Flight, ...]


def fit_floor(recordings: Sequence[LampRecording], lamp: Lamp, calibration: Calibration, assets: Assets) -> Floor:
    """Fit foot and floor to the recordings of a lamp that stands free.

    Args:
        recordings: The recordings.
        lamp: Its description.
        calibration: With the joints fitted.
        assets: Where the model is.
    """
    offset, gain, gain_error = _foot(recordings, lamp, calibration, assets)
    values = {"foot_gain": (gain, gain_error)} if math.isfinite(gain) else {}
    hops = [recording for recording in recordings if recording.travel is not None]
    if not hops:
        return Floor(values, offset, {}, ())
    base = calibration.lamp("floor_friction"), calibration.lamp("contact_softness")
    trials = [
        (_inside("floor_friction", base[0] * friction), _inside("contact_softness", base[1] * softness))
        for friction in FRICTION
        for softness in SOFTNESS
    ]
    twins = [_twin(lamp, calibration, assets, *trial) for trial in trials]
    shots = {hop.name: simulate(hop, twins) for hop in hops}
    cost = np.zeros(len(trials))
    for hop in hops:
        seen = flights_in(hop, lamp.flight_time)
        shot = shots[hop.name]
        for lane in range(len(trials)):
            cost[lane] += _hop_cost(hop, shot, lane, seen, lamp.flight_time)
    for lane, (friction, softness) in enumerate(trials):
        cost[lane] += (math.log(friction / base[0]) / _PRIOR[0]) ** 2 + (math.log(softness / base[1]) / _PRIOR[1]) ** 2
    best = int(np.argmin(cost))
    weight = np.exp(-0.5 * (cost - cost[best]))
    weight /= weight.sum()
    for index, name in enumerate(("floor_friction", "contact_softness")):
        column = np.array([trial[index] for trial in trials])
        mean = float(weight @ column)
        values[name] = (float(trials[best][index]), math.sqrt(float(weight @ (column - mean) ** 2)))
    travel, found = {}, []
    for hop in hops:
        shot = shots[hop.name]
        travel[hop.name] = (float(hop.travel or 0.0), way(shot, best))
        seen, predicted = flights_in(hop, lamp.flight_time), flights_of(shot, best, lamp.flight_time)
        for (takeoff, landing), nearest in zip(seen, matched(seen, predicted), strict=True):
            found.append(Flight(takeoff, landing, *nearest))
    return Floor(values, offset, travel, tuple(found))


def flights(contact: NDArray[np.bool_], time: Array, least: float) -> list[tuple[float, float]]:
    """Return take-off and landing of each flight, [s].

    Args:
        contact: Whether the foot is on the ground, shape (N,).
        time: Of those samples, shape (N,) [s].
        least: The shortest flight [s], see `shortest_flight`.
    """
    change = np.flatnonzero(np.diff(contact.astype(np.int8)))
    found, began = [], None
    for row in change:
        moment = float(time[row] + time[row + 1]) / 2
        if contact[row]:
            began = moment
        elif began is not None:
            if moment - began >= least:
                found.append((began, moment))
            began = None
    return found


def _foot(
    recordings: Sequence[LampRecording], lamp: Lamp, calibration: Calibration, assets: Assets
) -> tuple[float, float, float]:
    """Return the foot sensor's offset [N], its gain, and the gain's standard error."""
    twin = _twin(lamp, calibration, assets, calibration.lamp("floor_friction"), 1.0)
    weight = mass_of(twin) * float(np.linalg.norm(twin.model.opt.gravity))
    at_rest, in_air = [], []
    for recording in recordings:
        run, rows = recording.run, recording.rows
        force = run.foot_force[rows]
        speed = np.abs(run.velocity[rows]).max(axis=1)
        time = foot_time(recording)
        at_rest.append(force[(speed < _STILL) & np.isfinite(force)])
        for takeoff, landing in flights_in(recording, lamp.flight_time):
            middle = (time > takeoff + 0.02) & (time < landing - 0.02)
            in_air.append(force[middle & np.isfinite(force)])
    rest, air = np.concatenate(at_rest), np.concatenate(in_air) if in_air else np.empty(0)
    offset = float(np.median(air)) if air.size else math.nan
    if not rest.size:
        return offset, math.nan, math.nan
    gain = (float(np.median(rest)) - (offset if air.size else 0.0)) / weight
    error = float(np.std(rest)) / math.sqrt(max(len(rest) / 10, 1.0)) / weight
    return offset, _inside("foot_gain", gain), error


def _hop_cost(
    hop: LampRecording, shot: Simulated, lane: int, seen: list[tuple[float, float]], flight_time: float
) -> float:
    """Return how far a predicted hop is from a real one, in squares of what can be told."""
    went = float(hop.travel or 0.0)
    cost = ((way(shot, lane) - went) / max(TRAVEL_ERROR * abs(went), 0.004)) ** 2
    for (takeoff, landing), (left, came) in zip(seen, matched(seen, flights_of(shot, lane, flight_time)), strict=True):
        for real, predicted in ((takeoff, left), (landing, came)):
            late = min(abs(predicted - real), 5 * TIME_ERROR) if math.isfinite(predicted) else 5 * TIME_ERROR
            cost += (late / TIME_ERROR) ** 2
    return cost


def matched(seen: list[tuple[float, float]], predicted: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return for each flight the predicted one that overlaps it most; NaN where none does."""
    matched = []
    for takeoff, landing in seen:
        overlaps = [(min(landing, came) - max(takeoff, left), left, came) for left, came in predicted]
        best = max(overlaps, default=(0.0, math.nan, math.nan))
        matched.append(best[1:] if best[0] > 0 else (math.nan, math.nan))
    return matched


def flights_in(recording: LampRecording, flight_time: float) -> list[tuple[float, float]]:
    """Return take-off and landing of each flight by the foot sensor, since the recording's first angle [s]."""
    contact, least = recording.run.contact[recording.rows], shortest_flight(flight_time, recording.run.control_period)
    return flights(contact, foot_time(recording), least)


def flights_of(shot: Simulated, lane: int, flight_time: float) -> list[tuple[float, float]]:
    """Return take-off and landing of each simulated flight of a lane, since the recording's first angle [s]."""
    time = shot.contact_time - shot.contact_time[0]
    return flights(shot.contact[lane], time, shortest_flight(flight_time, float(time[1])))


def foot_time(recording: LampRecording) -> Array:
    """Return when each foot force was measured, since the recording's first angle, shape (N,) [s]."""
    run, rows = recording.run, recording.rows
    return run.measured_at[rows] - run.foot_age[rows] - float(run.sampled_at[recording.first].min())


def way(shot: Simulated, lane: int) -> float:
    """Return how far a lane's base went [m]."""
    return float(shot.base_x[lane, -1] - shot.base_x[lane, 0])


def _inside(name: str, value: float) -> float:
    return min(max(value, LAMP[name].low), LAMP[name].high)


def _twin(lamp: Lamp, calibration: Calibration, assets: Assets, friction: float, softness: float) -> TwinModel:
    groups = {name: dict(parameters) for name, parameters in calibration.groups.items()}
    groups["lamp"]["floor_friction"] = Parameter(friction, "1", None, "")
    groups["lamp"]["contact_softness"] = Parameter(softness, "1", None, "")
    return build(lamp, replace(calibration, groups=groups), assets)
