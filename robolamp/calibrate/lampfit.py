"""Fitting a whole lamp to a session: joints first, then foot, then floor.

The joints' parameters are found by nonlinear least squares over all clamped recordings at once, open loop, with each
parameter's prior as one more residual: what the recordings do not tell stays where it was. Finite differences run as
lanes of one batch (`robolamp.calibrate.whole`), for which `mujoco.minimize.least_squares` is made.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco.minimize
import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibrate.floor import Floor, fit_floor
from robolamp.calibrate.session import LampRecording, LampSession
from robolamp.calibrate.supply import correlation_time, measure_supply, median_error
from robolamp.calibrate.unknowns import MOST, SPREAD, Unknown, calibrated, unknowns
from robolamp.calibrate.whole import mass_of, rescale, simulate
from robolamp.calibration import LAMP, Calibration
from robolamp.errors import RobolampError
from robolamp.lamp import Lamp
from robolamp.twin.model import TwinModel, build

Array = NDArray[np.float64]

HELD_OUT = ("steps-firm",)
"""Recordings that the joints are not fitted to, but judged by."""

IDENTIFIED = 0.6
"""A parameter counts as identified when its standard error is below this share of its prior's."""

NOISE = 0.010
"""What a residual of the first fit is measured in [rad]: ten times the encoder's noise, for errors of a model last long
(some ten samples at 100 Hz)."""

SCALE_ERROR = 0.005
"""Relative standard error of a lamp's mass as weighed: a gramme in two hundred."""

_STEP = 0.05  # of finite differences, in standard deviations of the prior: well above what friction makes rough
_OUTLIER = 5.0  # a residual of so many NOISE counts as an outlier
_EVERY = 2  # every second sample counts: neighbours say the same
_ITERATIONS = 7
_BOUND = 0.98  # share of MOST beyond which a value stands at its bound


@dataclass(frozen=True)
class LampFit:
    """What a session told of a lamp.

    Attributes:
        calibration: The base calibration with everything that was found (its file's text is not made yet).
        asked: The unknowns of the joints, m of them.
        z: Their values, in standard deviations from their priors, shape (m,); 0 where not identified.
        sigma: Their standard errors in the same measure, shape (m,).
        correlation: Of their errors, shape (m, m).
        lamp: What was found of the lamp as a whole: value and standard error by name.
        floor: How well the floor's parameters predict the hops; None without hops.
        foot_offset: Foot sensor reading with the foot in the air [N]; NaN where not known.
        latency: What a reading takes beyond its bytes' time on the line, by the stamps [s].
        mae: Mean absolute error of each recording's joints, base calibration and fitted, by name [rad].
        trained: Names of the recordings that were fitted to.
    """

    calibration: Calibration
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
    progress: Callable[[str], None] = lambda text: None,
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
        progress: Called with a line as it goes on.

    Raises:
        RobolampError: The session holds too little to fit a lamp to.
    """
    clamped = [recording for recording in session.recordings if recording.clamped]
    train = [recording for recording in clamped if recording.name not in held_out]
    if not train:
        raise RobolampError("no recording of the clamped lamp; expected one or more", str(session.folder))
    line, supply = _line_delay(session), measure_supply(session.recordings, base)
    whole = {"line_delay": line[0]} | {name: value for name, (value, _) in supply.items()}
    errors_of = {"line_delay": line[2], "mass_scale": SCALE_ERROR}
    errors_of |= {name: error for name, (_, error) in supply.items()}
    weighed = session.manifest.mass
    if weighed is not None:
        whole["mass_scale"] = base.lamp("mass_scale")
    asked = unknowns(lamp, base, names)

    def twins(z: Array, *, clamp: bool = True) -> list[TwinModel]:
        """Return a lamp for each column of z, shape (m, k)."""
        found = []
        for column in z.T:
            twin = build(lamp, calibrated(base, asked, column, whole), assets, clamped=clamp)
            if weighed is not None:  # links may be heavier than thought, all of them together may not
                rescale(twin, weighed)
            found.append(twin)
        return found

    with ThreadPoolExecutor() as pool:

        def errors(z: Array, recordings: Sequence[LampRecording]) -> list[Array]:
            """Return each recording's errors, shape (k, N, n) [rad]."""
            lanes = twins(z)
            shots = pool.map(lambda recording: simulate(recording, lanes), recordings)
            return [
                np.nan_to_num(shot.angle - recording.run.angle[recording.rows])
                for shot, recording in zip(shots, recordings, strict=True)
            ]

        def residual(z: Array) -> Array:
            found = errors(z, train)
            parts = [error[:, ::_EVERY].reshape(len(error), -1) / NOISE for error in found]
            return np.concatenate([np.concatenate(parts, axis=1).T, z])

        count = 0

        def told(trace: list[mujoco.minimize.IterLog]) -> None:
            nonlocal count
            count += 1
            progress(f"joints: step {count} of at most {iterations}, cost {trace[-1].objective:.0f}")

        start = np.zeros(len(asked))
        found, _ = mujoco.minimize.least_squares(
            start, residual, bounds=[np.full(len(asked), -MOST), np.full(len(asked), MOST)], eps=_STEP,
            norm=_Robust(len(asked)), max_iter=iterations, xtol=0.03, verbose=mujoco.minimize.Verbosity.SILENT,
            output=io.StringIO(), iter_callback=told,
        )  # fmt: skip
        z = np.asarray(found)
        spread = _STEP * np.eye(len(asked))
        shots = errors(np.column_stack([z, z[:, None] + spread]), train)
        covariance = _covariance(shots, _STEP)
        sigma = np.sqrt(np.diag(covariance))
        z = _conditioned(z, covariance, (sigma < IDENTIFIED) & (np.abs(z) < _BOUND * MOST))
        mae = {}
        for recording, error in zip(clamped, errors(np.column_stack([start, z]), clamped), strict=True):
            before, after = np.abs(error).mean(axis=(1, 2))
            mae[recording.name] = (float(before), float(after))
    if weighed is not None:
        share = weighed / mass_of(build(lamp, calibrated(base, asked, z, whole), assets))
        whole["mass_scale"] = min(max(whole["mass_scale"] * share, LAMP["mass_scale"].low), LAMP["mass_scale"].high)
    values: dict[str, tuple[float, float]] = {name: (value, errors_of[name]) for name, value in whole.items()}
    standing = [recording for recording in session.recordings if not recording.clamped]
    floor, offset = None, math.nan
    if standing:
        progress("foot and floor")
        fitted = calibrated(base, asked, z, whole)
        floor = fit_floor(standing, lamp, fitted, assets)
        offset = floor.foot_offset
        values.update(floor.values)
    return LampFit(
        calibration=calibrated(base, asked, z, {name: value for name, (value, _) in values.items()}),
        asked=asked,
        z=z,
        sigma=sigma,
        correlation=covariance / np.outer(sigma, sigma),
        lamp=values,
        floor=floor,
        foot_offset=offset,
        latency=line[1] - _reading_wire_time(len(lamp.joints), lamp.bus_baud),
        mae=mae,
        trained=tuple(recording.name for recording in train),
    )


class _Robust(mujoco.minimize.Norm):
    """Pseudo-Huber loss over the recordings' residuals, beyond _OUTLIER linear; quadratic over the priors behind them.

    Args:
        priors: How many residuals at the end are priors.
    """

    def __init__(self, priors: int) -> None:
        self._priors = priors

    def value(self, r: Array) -> np.float64:
        data, prior = r[: -self._priors], r[-self._priors :]
        cost = _OUTLIER**2 * (np.sqrt(1.0 + (data / _OUTLIER) ** 2) - 1.0)
        return np.float64(cost.sum() + 0.5 * (prior * prior).sum())

    def grad_hess(self, r: Array, proj: Array) -> tuple[Array, Array]:  # pyright: ignore (the base returns nothing)
        weight = 1.0 / np.sqrt(1.0 + (r / _OUTLIER) ** 2)
        weight[-self._priors :] = 1.0
        return proj.T @ (weight * r), proj.T @ (weight * proj)


def _covariance(shots: Sequence[Array], step: float) -> Array:
    """Return the covariance of the unknowns, prior included, shape (m, m).

    Residuals of a fit are correlated over time: what they are worth is found from their autocorrelation, recording by
    recording and joint by joint (Bayley and Hammersley 1946: the effective number of independent observations).

    Args:
        shots: Errors of each recording, the first lane at the optimum and one for each unknown stepped from it.
        step: That step.
    """
    m = len(shots[0]) - 1
    information = np.eye(m)
    for error in shots:
        jacobian = (error[1:] - error[0]) / step
        for joint in range(error.shape[2]):
            left = error[0, :, joint]
            variance = float(np.mean(left * left)) + 1e-8  # and never below the encoder's own 0.1 mrad
            inflation = correlation_time(left)
            j = jacobian[:, :, joint]
            information += j @ j.T / (variance * inflation)
    return np.asarray(np.linalg.inv(information), np.float64)


def _conditioned(z: Array, covariance: Array, known: NDArray[np.bool_]) -> Array:
    """Return the unknowns where those that are not known are set back to their priors, and the others move with them.

    Args:
        z: All of them at the optimum, shape (m,).
        covariance: Of their errors, shape (m, m).
        known: Which of them the recordings told, shape (m,).
    """
    back = np.zeros_like(z)
    pull = np.linalg.solve(covariance[np.ix_(~known, ~known)], z[~known]) if (~known).any() else np.empty(0)
    back[known] = z[known] - covariance[np.ix_(known, ~known)] @ pull
    return np.clip(back, -MOST, MOST)


def _line_delay(session: LampSession) -> tuple[float, float, float]:
    """Return the medians of tick begin to goals sent, and of a reading, and the first one's standard error [s]."""
    sent = np.concatenate([recording.run.write_done - recording.run.began for recording in session.recordings])
    read = np.concatenate([recording.run.read_done - recording.run.began for recording in session.recordings])
    return float(np.median(sent)), float(np.median(read)), median_error(sent)


def _reading_wire_time(n: int, baud: int) -> float:
    """Return how long the bytes of a tick's reading are on the line [s].

    Args:
        n: How many servos, of which a Fast Sync Read asks 19 bytes each (e-manual, protocol 2.0: 14 + n bytes there; 8,
            and 4 around each servo's data, back; 10 bits a byte).
        baud: Of the line [1/s].
    """
    return (14 + n + 8 + n * (4 + 19)) * 10.0 / baud
