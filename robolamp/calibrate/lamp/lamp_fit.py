"""Fitting a whole lamp to a session: joints first, then their play and the arm's stiffness, then foot, then floor.

The joints' parameters are found by nonlinear least squares over all clamped recordings at once, open loop
(`robolamp.calibrate.lamp.open_loop_fit`). Play and stiffness (`robolamp.calibrate.lamp.gear_fit`) are kept where they
pay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibrate.lamp.floor_fit import Floor, fit_floor
from robolamp.calibrate.lamp.gear_fit import IDENTIFIED, fit_gears
from robolamp.calibrate.lamp.open_loop_fit import Solution, conditioned, covariance, minimise
from robolamp.calibrate.lamp.session import LampRecording, LampSession
from robolamp.calibrate.lamp.simulation import mass_of, rescale, simulate
from robolamp.calibrate.lamp.supply import measure_supply, median_error
from robolamp.calibrate.lamp.unknowns import MOST, SPREAD, Unknown, calibrated, gears_of, unknowns
from robolamp.calibration import LAMP, Calibration
from robolamp.dynamixel.wire_time import Transport, wire_time
from robolamp.errors import RobolampError
from robolamp.lamp import Lamp
from robolamp.twin.lamp_model import TwinModel, build

Array = NDArray[np.float64]

HELD_OUT = ("steps-firm",)
"""Recordings that the joints are not fitted to, but judged by."""

SCALE_ERROR = 0.005
"""Relative standard error of a lamp's mass as weighed: a gramme in two hundred."""

_ITERATIONS = 7
_WORTH = 0.95  # of a rigid twin's error on recordings left out: the most that play and stiffness may leave of it
_BOUND = 0.98  # share of MOST beyond which a value stands at its bound


@dataclass(frozen=True)
class LampFit:
    """What a session told of a lamp.

    Attributes:
        asked: The unknowns of the joints, m of them; play and stiffness are among them where they are worth it.
        z: Their values, in standard deviations from their priors, shape (m,); 0 where not identified.
        sigma: Their standard errors in the same measure, shape (m,).
        correlation: Of their errors, shape (m, m).
        lamp: What was found of the lamp as a whole: value and standard error by name.
        floor: How well the floor's parameters predict the hops; None without hops.
        foot_offset: Foot sensor reading with the foot in the air [N]; NaN where not known.
        latency: What a reading takes beyond its bytes' time on the line, by the stamps [s].
        mae: Mean absolute error of each recording's joints, base calibration and fitted, by name [rad].
        trained: Names of the recordings that were fitted to.
        left_out: Mean absolute error on recordings not fitted to, of the rigid twin and of one with play and stiffness
            [rad]; NaN for what was not tried, infinite where the recordings tell neither play nor stiffness.
    """

    asked: tuple[Unknown, ...]
    z: Array
    sigma: Array
    correlation: Array
    lamp: dict[str, tuple[float, float]]
    floor: Floor | None
    foot_offset: float
    latency: float
    mae: dict[str, tuple[float, float]]
    trained: tuple[str, ...]
    left_out: tuple[float, float] = (math.nan, math.nan)

    def identified(self, index: int) -> bool:
        """Whether the recordings told an unknown apart from the others."""
        return bool(self.sigma[index] < IDENTIFIED and self.z[index] != 0.0)

    def servo_delays(self) -> dict[str, float]:
        """Return each joint's fitted delay after its goal was sent [s]."""
        return {
            unknown.joint: unknown.value(float(z))
            for unknown, z in zip(self.asked, self.z, strict=True)
            if unknown.name == "delay"
        }


def fit_lamp(
    session: LampSession,
    lamp: Lamp,
    base: Calibration,
    assets: Assets,
    *,
    held_out: Sequence[str] = HELD_OUT,
    names: Sequence[str] = tuple(SPREAD),
    iterations: int = _ITERATIONS,
    gears: bool = True,
    progress: Callable[[str], None] = lambda text: None,
    done: Callable[[float], None] = lambda _share: None,
) -> LampFit:
    """Fit a lamp to a session's recordings.

    Args:
        session: The recordings.
        lamp: Its description.
        base: What is known before.
        assets: Where the model is.
        held_out: Names of recordings that the joints are not fitted to.
        names: What is asked of each joint.
        iterations: The most steps of the joints' fit.
        gears: Whether to look for play and stiffness, where the base has neither: they are kept where they leave at
            most 95 % of the error on the recordings held out, and raise none of the error on the others.
        progress: Called with a line as it goes on.
        done: Called with the share that is done, 0 to 1, if every search goes on as long as it may.

    Raises:
        RobolampError: The session holds too little to fit a lamp to.
    """
    clamped = [recording for recording in session.recordings if recording.clamped]
    train = [recording for recording in clamped if recording.name not in held_out]
    if not train:
        raise RobolampError("no recording of the clamped lamp; expected one or more", str(session.folder))
    line, supply = _line_delay(session, lamp), measure_supply(session.recordings, base)
    whole = {"line_delay": line[0]} | {name: value for name, (value, _) in supply.items()}
    errors_of = {"line_delay": line[2], "mass_scale": SCALE_ERROR}
    errors_of |= {name: error for name, (_, error) in supply.items()}
    weighed = session.manifest.mass
    if weighed is not None:
        whole["mass_scale"] = base.lamp("mass_scale")

    def twins(asked: Sequence[Unknown], z: Array) -> list[TwinModel]:
        """Return a clamped lamp for each column of z, shape (m, k)."""
        found = []
        for column in z.T:
            twin = build(lamp, calibrated(base, asked, column, whole), assets, clamped=True)
            if weighed is not None:  # links may be heavier than thought, all of them together may not
                rescale(twin, weighed)
            found.append(twin)
        return found

    asked = unknowns(lamp, base, names)
    start = np.zeros(len(asked))
    # Lamps to simulate, at most: a derivative a step, and with gears what the search tries and what polishes it.
    rigid, plays = (iterations + 1) * (len(asked) + 2), len(lamp.joints)
    expected = rigid + (35 + 8 * plays + 3 * len(asked) if gears else 2)
    simulated = 0
    with ThreadPoolExecutor() as pool:

        def errors(asked: Sequence[Unknown], z: Array, recordings: Sequence[LampRecording] = train) -> list[Array]:
            """Return each recording's errors, shape (k, N, n) [rad]; NaN where nothing was read."""
            nonlocal simulated
            lanes = twins(asked, z)
            shots = pool.map(lambda recording: simulate(recording, lanes), recordings)
            found = [
                shot.angle - recording.run.angle[recording.rows]
                for shot, recording in zip(shots, recordings, strict=True)
            ]
            simulated += len(lanes)
            done(simulated / expected)
            return found

        count = 0

        def told(cost: float) -> None:
            nonlocal count
            count += 1
            progress(f"joints: step {count} of at most {iterations}, cost {cost:.0f}")

        def settle(asked: tuple[Unknown, ...], found: Solution) -> _Joints:
            """Set back what the recordings do not tell, and see how well the rest predicts."""
            spread = covariance(found.shots)
            known = (np.sqrt(np.diag(spread)) < IDENTIFIED) & (np.abs(found.z) < _BOUND * MOST)
            z = conditioned(found.z, spread, known)
            after = {
                recording.name: float(np.nanmean(np.abs(error)))
                for recording, error in zip(clamped, errors(asked, z[:, None], clamped), strict=True)
            }
            return _Joints(asked, z, spread, after)

        before = [float(np.nanmean(np.abs(error))) for error in errors(asked, start[:, None], clamped)]
        found = minimise(lambda z: errors(asked, z), start, iterations, told)
        simulated = max(simulated, rigid)
        joints = settle(asked, found)
        seen = [recording.name for recording in train]
        left_out = joints.error(joints.mae.keys() - seen), math.nan
        possible = gears_of(lamp, base) if gears and math.isfinite(left_out[0]) else ()
        bent = fit_gears(errors, asked, found, possible, progress) if possible else None
        if possible and bent is None:
            left_out = left_out[0], math.inf
        if bent:
            soft = settle(*bent)
            left_out = left_out[0], soft.error(soft.mae.keys() - seen)
            if left_out[1] < _WORTH * left_out[0] and soft.error(seen) <= joints.error(seen):
                joints = soft
    asked, z, sigma = joints.asked, joints.z, np.sqrt(np.diag(joints.covariance))
    mae = {recording.name: (old, joints.mae[recording.name]) for recording, old in zip(clamped, before, strict=True)}
    if weighed is not None:
        share = weighed / mass_of(build(lamp, calibrated(base, asked, z, whole), assets))
        whole["mass_scale"] = min(max(whole["mass_scale"] * share, LAMP["mass_scale"].low), LAMP["mass_scale"].high)
    values: dict[str, tuple[float, float]] = {name: (value, errors_of[name]) for name, value in whole.items()}
    for unknown, at, error in zip(asked, z.tolist(), sigma.tolist(), strict=True):
        if not unknown.joint:
            values[unknown.name] = (unknown.value(at), unknown.stderr(at, error))
    standing = [recording for recording in session.recordings if not recording.clamped]
    floor, offset = None, math.nan
    if standing:
        progress("foot and floor")
        fitted = calibrated(base, asked, z, whole)
        floor = fit_floor(standing, lamp, fitted, assets)
        offset = floor.foot_offset
        values.update(floor.values)
    return LampFit(
        asked=asked,
        z=z,
        sigma=sigma,
        correlation=joints.covariance / np.outer(sigma, sigma),
        lamp=values,
        floor=floor,
        foot_offset=offset,
        latency=line[1],
        mae=mae,
        trained=tuple(seen),
        left_out=left_out,
    )


@dataclass(frozen=True)
class _Joints:
    """What a fit of the joints came to.

    Attributes:
        asked: The unknowns, m of them.
        z: Their values, shape (m,).
        covariance: Of their errors, shape (m, m).
        mae: Mean absolute error of each clamped recording [rad].
    """

    asked: tuple[Unknown, ...]
    z: Array
    covariance: Array
    mae: dict[str, float]

    def error(self, names: Collection[str]) -> float:
        """Return the mean error of some recordings [rad]; NaN of none."""
        return float(np.mean([self.mae[name] for name in names])) if names else math.nan


def _line_delay(session: LampSession, lamp: Lamp) -> tuple[float, float, float]:
    """Return the medians of tick begin to goals sent, and of a reading beyond its bytes, and the first's error [s]."""
    quickest = wire_time("reading", len(lamp.joints), lamp.bus_baud, Transport.FAST)  # older logs do not say
    wires = [recording.run.answer_wire for recording in session.recordings]
    sent = np.concatenate([recording.run.write_done - recording.run.began for recording in session.recordings])
    read = np.concatenate(
        [
            recording.run.read_done - recording.run.began - (wire if np.isfinite(wire) else quickest)
            for recording, wire in zip(session.recordings, wires, strict=True)
        ]
    )
    return float(np.median(sent)), float(np.median(read)), median_error(sent)
