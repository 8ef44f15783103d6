"""Fitting one servo to recordings of a pendulum bench: the ladder climbed, the rest told in words.

The ladder is climbed as long as the error falls on recordings that the fit did not see: the recordings are dealt into
parts, each part is predicted by a fit to the others.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.identify import Problem, Solution
from robolamp.calibrate.ladder import LADDER, Chart, Rung, correlation_words, switched_off
from robolamp.calibrate.pendulum import Pendulum, parameter_set
from robolamp.calibrate.recordings import Recording
from robolamp.calibration import JOINT, SERVO, Calibration
from robolamp.errors import RobolampError

Array = NDArray[np.float64]

IDENTIFIED = 0.6
"""A parameter is settled when its standard error is below this share of its prior's."""

TOLD = 0.75
"""A parameter is identified when the recordings by themselves tell it to this share of its prior's error."""

_PARTS = 3  # the recordings are dealt into
_GAIN = 0.99  # a rung is worth it when it lowers the error left out by a hundredth
_PATIENCE = 2  # rungs without gain after which nobody climbs on
_POWERED = ("torque_constant", "resistance", "viscous")
# While a motor drives, K / R and K^2 / R + viscous are all that moves it: what else seems to tell the three apart is
# the friction terms' share of the motor's torque, and as uncertain as those.
_FALL = 0.1  # motion with torque off that shows friction without back-EMF [rad]
_RIDGE = 1e-6  # what is left of a prior where it is taken away: keeps the inverse finite
_SCATTER = 0.4  # of starts around the best guess, in standard deviations of the priors


@dataclass(frozen=True)
class Climbed:
    """What one rung brought, with all below it.

    Attributes:
        rung: The rung.
        kept: Whether the fit went so far.
        mae: Mean absolute error on the recordings fitted to [rad].
        left_out_mae: On recordings left out [rad]; NaN where none could be.
    """

    rung: Rung
    kept: bool
    mae: float
    left_out_mae: float


@dataclass(frozen=True)
class ServoFit:
    """What recordings told of a servo.

    Attributes:
        servo: Servo model.
        base: What was known before.
        recordings: What was fitted to.
        solution: The parameters.
        ladder: What each rung brought.
        mae: Mean absolute error of each recording, shape (k,) [rad].
        left_out: Names of recordings that were left out on request, and their errors [rad].
        seconds: How long it took.
        servo_seconds: How much servo time was simulated [s].
    """

    servo: str
    base: Calibration
    recordings: tuple[Recording, ...]
    solution: Solution
    ladder: tuple[Climbed, ...]
    mae: Array
    left_out: dict[str, float]
    seconds: float
    servo_seconds: float

    @property
    def left_out_mae(self) -> float:
        """Error on recordings left out, with the terms that were kept [rad]; NaN where none could be."""
        if self.left_out:
            return float(np.mean(list(self.left_out.values())))
        return [each.left_out_mae for each in self.ladder if each.kept][-1]

    @property
    def sigma(self) -> dict[str, float]:
        """Standard error of each free parameter, by that of its prior."""
        deviations = np.sqrt(np.diag(self.solution.covariance))
        return dict(zip(self.solution.chart.names, deviations.tolist(), strict=True))

    @property
    def stderr(self) -> dict[str, float]:
        """Standard error of each free parameter, in its unit."""
        slope = self.solution.chart.slope(self.solution.z)
        sigma = np.sqrt(np.diag(self.solution.covariance)) * slope
        return dict(zip(self.solution.chart.names, sigma.tolist(), strict=True))

    def identified(self, name: str) -> bool:
        """Whether the recordings tell a parameter: by themselves, not by what the priors say of the others."""
        if name not in self.solution.chart.names or name in self.at_bound:
            return False
        if name in _POWERED and not self.dropped:
            return False
        prior = np.eye(len(self.solution.z))
        alone = np.linalg.inv(np.linalg.inv(self.solution.covariance) - (1 - _RIDGE) * prior)
        index = self.solution.chart.names.index(name)
        return 0.0 < alone[index, index] < TOLD**2

    @property
    def dropped(self) -> bool:
        """Whether a recording shows the servo moving with its torque off."""
        return any(
            np.ptp(recording.angle[~recording.torque]) > _FALL
            for recording in self.recordings
            if not recording.torque.all()
        )

    @property
    def at_bound(self) -> list[str]:
        """Free parameters that ended at the edge of what they may be."""
        chart, z = self.solution.chart, self.solution.z
        return [
            name
            for name, value, low, high in zip(chart.names, z, chart.low, chart.high, strict=True)
            if min(value - low, high - value) < 1e-3
        ]

    @property
    def inseparable(self) -> list[list[str]]:
        """Groups of parameters that only tell something together."""
        return correlation_words(self.solution.chart.names, self.solution.covariance, IDENTIFIED)


def fit_servo(
    recordings: Sequence[Recording],
    base: Calibration,
    *,
    leave_out: Sequence[str] = (),
    seed: int = 1,
    starts: int = 3,
    workers: int | None = None,
    told: Callable[[str], None] = lambda _text: None,
) -> ServoFit:
    """Fit a servo.

    Args:
        recordings: Sound pendulum recordings of one servo (see `soundness`).
        base: What is known before: centres of the priors, and the servo's model.
        leave_out: Names of recordings to judge by alone, instead of dealing all into parts.
        seed: Of the starts.
        starts: Starts of each fit.
        workers: Threads; None: one for each core.
        told: Called with a line of progress.

    Raises:
        RobolampError: A name in leave_out is none of the recordings', or nothing is left to fit to.
        FileError: A recording is not of a pendulum, has no voltage, or the base lacks a parameter.
    """
    began = time.monotonic()
    names = [recording.name for recording in recordings]
    for name in leave_out:
        if name not in names:
            known = ", ".join(names)
            raise RobolampError(f"{name!r} is none of the recordings; expected one of {known}", "--leave-out")
    held_back = [index for index, name in enumerate(names) if name in leave_out]
    used = [index for index in range(len(names)) if index not in held_back]
    if not used:
        raise RobolampError("leaves nothing to fit to", "--leave-out")
    servo = next((recording.servo for recording in recordings if recording.servo), "")
    if servo not in base.groups:
        known = ", ".join(name for name in base.groups if name != "lamp" and not name.startswith("joint "))
        raise RobolampError(f"has no {servo or 'servo of that name'}; expected one of {known}", str(base.path))
    centre = {**base.servo(servo, ""), "encoder_offset": 0.0}
    pendulum = Pendulum(recordings, workers=workers)
    rng = np.random.default_rng(seed)
    parts = [(used, held_back)] if held_back else [
        ([index for index in used if index not in part], part) for part in _deal(recordings, used)
    ]  # fmt: skip
    search = _Search(pendulum, centre, used, parts, rng, starts)
    climbed: list[tuple[Rung, Solution, float, float]] = []
    for rung in LADDER:
        below = climbed[-1][1] if climbed else None
        names_below = below.chart.names if below is not None else ()
        solution = search.fit([*names_below, *rung.parameters], below, used, starts)
        mae, unseen = float(search.mae(solution, used).mean()), search.left_out(solution)
        climbed.append((rung, solution, mae, unseen))
        said = f", left out {unseen * 1e3:.1f} mrad" if parts else ""
        told(f"{rung.name}: {mae * 1e3:.1f} mrad{said}")
        if len(climbed) - 1 - _top(climbed, centre) >= _PATIENCE:
            break
    top = _top(climbed, centre)
    ladder = [Climbed(rung, index <= top, mae, unseen) for index, (rung, _, mae, unseen) in enumerate(climbed)]
    found = climbed[top][1]
    told(f"kept up to: {ladder[top].rung.name}; once more from {2 * starts} starts")
    found = search.fit(found.chart.names, found, used, 2 * starts)
    found = _settled(search, found, used)
    return ServoFit(
        servo=servo,
        base=base,
        recordings=tuple(recordings[index] for index in used),
        solution=found,
        ladder=tuple(ladder),
        mae=search.mae(found, used),
        left_out=dict(zip([names[i] for i in held_back], search.mae(found, held_back).tolist(), strict=True)),
        seconds=time.monotonic() - began,
        servo_seconds=pendulum.steps * pendulum.timestep,
    )


class _Search:
    """The fits of one run: what they have in common."""

    def __init__(
        self,
        pendulum: Pendulum,
        centre: dict[str, float],
        used: Sequence[int],
        parts: Sequence[tuple[list[int], list[int]]],
        rng: np.random.Generator,
        starts: int,
    ) -> None:
        self._pendulum, self._centre, self._used, self._parts = pendulum, centre, used, parts
        self._rng, self._starts = rng, starts

    def fit(self, names: Sequence[str], before: Solution | None, which: Sequence[int], starts: int) -> Solution:
        """Fit parameters, from a solution with fewer of them and from around it."""
        chart = Chart(names, self._centre, switched_off(self._centre))
        first = np.zeros(len(names))
        if before is not None:
            known = dict(zip(before.chart.names, before.z.tolist(), strict=True))
            first = np.array([known.get(name, 0.0) for name in names])
        around = [first + _SCATTER * self._rng.standard_normal(len(names)) for _ in range(starts - 1)]
        return Problem(self._pendulum, which).best(chart, [first, *around])

    def left_out(self, solution: Solution) -> float:
        """Return the error on recordings left out: each part predicted by a fit to the others [rad]."""
        errors = []
        for seen, unseen in self._parts:
            alone = seen == list(self._used)  # left out on request: the solution has not seen them
            part = solution if alone else self.fit(solution.chart.names, solution, seen, self._starts)
            errors.append(self.mae(part, unseen))
        return float(np.concatenate(errors).mean()) if errors else float("nan")

    def mae(self, solution: Solution, which: Sequence[int]) -> Array:
        """Return each recording's mean absolute error [rad]."""
        angles = self._pendulum.simulate(parameter_set(solution.values)[None], which)
        recordings = [self._pendulum.recordings[index] for index in which]
        return np.array([
            np.abs(angle[0] - recording.angle).mean() for angle, recording in zip(angles, recordings, strict=True)
        ])  # fmt: skip

    def hold(self, solution: Solution, name: str, which: Sequence[int]) -> Solution:
        """Return a fit with one parameter less: it keeps its prior."""
        rest = [other for other in solution.chart.names if other != name]
        chart = Chart(rest, self._centre, {**solution.chart.held, name: self._centre[name]})
        known = dict(zip(solution.chart.names, solution.z.tolist(), strict=True))
        return Problem(self._pendulum, which).fit(chart, np.array([known[other] for other in rest]))


def _settled(search: _Search, solution: Solution, which: Sequence[int]) -> Solution:
    """Return a solution whose parameters that the recordings do not tell are at their priors, the others refitted.

    Its covariance stays that of all of them: what is known of a parameter does not grow by holding another.
    """
    chart, z, covariance = solution.chart, solution.z, solution.covariance
    values = solution
    for _ in range(len(chart.names)):
        deviations = np.sqrt(np.diag(values.covariance))
        worst = int(np.argmax(deviations))
        if deviations[worst] < IDENTIFIED:
            break
        values = search.hold(values, values.chart.names[worst], which)
    found = values.values
    z = chart.coordinates(np.array([found[name] for name in chart.names]))
    return Solution(chart, np.clip(z, chart.low, chart.high), values.objective, covariance)


def _top(climbed: Sequence[tuple[Rung, Solution, float, float]], centre: dict[str, float]) -> int:
    """Return the rung to stop at: the least error left out, or, where none could be, the last that the base has on."""
    unseen = np.array([each[3] for each in climbed])
    if np.isfinite(unseen).all():
        best = int(np.argmin(unseen))
        return int(np.flatnonzero(unseen <= unseen[best] / _GAIN)[0])  # as few terms as are as good
    off = switched_off(centre)
    return max(i for i, each in enumerate(climbed) if i == 0 or any(centre[n] != off[n] for n in each[0].parameters))


def _deal(recordings: Sequence[Recording], used: Sequence[int]) -> list[list[int]]:
    """Deal recordings into parts that differ in gain and trajectory as much within as they do as a whole."""
    if len(used) < _PARTS:
        return []
    parts: list[list[int]] = [[] for _ in range(_PARTS)]

    def kind(index: int) -> tuple[float, str]:
        return float(np.nanmedian(recordings[index].p_gain)), recordings[index].trajectory

    for index in sorted(used, key=kind):
        gain, trajectory = kind(index)
        alike = [
            (len(part), sum((kind(i)[0] == gain) + (kind(i)[1] == trajectory) for i in part), number)
            for number, part in enumerate(parts)
        ]
        # As long as no part is more than one ahead, the one with the least of its kind.
        least = min(count for count, _, _ in alike)
        number = min((same, count, number) for count, same, number in alike if count <= least + 1)[2]
        parts[number].append(index)
    return [part for part in parts if part]


def advice(fit: ServoFit) -> list[str]:
    """Return in words what the recordings do not tell, and what to record for it."""
    said = []
    together = fit.inseparable
    motor = {name for name in _POWERED if name in fit.sigma and not fit.identified(name)}
    if motor and not fit.dropped:
        said.append(
            "torque_constant and resistance cannot be separated: powered motion tells only K / R and K^2 / R + "
            "viscous; record a torque-off drop to separate K from R"
        )
    for group in together:
        if fit.dropped or not motor & set(group):
            said.append(f"{' and '.join(group)} cannot be separated by these recordings")
    for name in fit.solution.chart.names:
        if name in fit.at_bound:
            said.append(f"{name} is at its bound, {fit.solution.values[name]:g} {_unit(name)}")
        elif not fit.identified(name) and name not in motor and not any(name in group for group in together):
            said.append(f"{name} is not told by these recordings and keeps its prior, {fit.solution.values[name]:g} "
                        f"{_unit(name)}")  # fmt: skip
    if not any(np.isfinite(each.left_out_mae) for each in fit.ladder):
        said.append("too few recordings to leave any out: the error on unseen ones is not known; record three or more")
    return said


def _unit(name: str) -> str:
    return {**SERVO, **JOINT}[name].unit
