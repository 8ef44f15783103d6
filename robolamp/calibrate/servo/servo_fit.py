"""Fitting one servo to recordings of a pendulum bench: the ladder climbed, the rest told in words.

The ladder is climbed as long as the error falls on recordings that the fit did not see, and those above do without a
rung that does not lower it. The recordings are dealt into parts, each part is predicted by a fit to the others, which
climbs by itself: begun near a fit to all, it would stay near what that one has seen.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.servo.fast_pendulum import Pendulum, parameter_set
from robolamp.calibrate.servo.identifiability import POWERED, at_bound, dropped, told_apart
from robolamp.calibrate.servo.ladder import LADDER, Chart, Rung, correlation_words, switched_off
from robolamp.calibrate.servo.pendulum_fit import Problem, Solution
from robolamp.calibrate.servo.recordings import Recording
from robolamp.calibration import JOINT, SERVO, Calibration
from robolamp.errors import RobolampError

Array = NDArray[np.float64]

IDENTIFIED = 0.6
"""A parameter is settled when its standard error is below this share of its prior's."""

_PARTS = 3  # the recordings are dealt into
_GAIN = 0.99  # a rung is worth it when it lowers the error left out by a hundredth
_PATIENCE = 2  # rungs in a row without gain after which nobody climbs on
_SCATTER = 0.4  # of starts around the best guess, in standard deviations of the priors


@dataclass(frozen=True)
class Climbed:
    """What one rung brought, with those below it that were kept.

    Attributes:
        rung: The rung.
        kept: Whether the fit has its parameters.
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
        unseen: Error on recordings left out in turn, with the same parameters free [rad]; NaN where none could be.
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
    unseen: float
    left_out: dict[str, float]
    seconds: float
    servo_seconds: float

    @property
    def left_out_mae(self) -> float:
        """Error on recordings left out, with the terms that were kept [rad]; NaN where none could be."""
        return float(np.mean(list(self.left_out.values()))) if self.left_out else self.unseen

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
        """Whether the recordings tell a parameter; else it is at its prior or at its bound."""
        if name not in self.solution.chart.names or name in self.at_bound:
            return False
        return told_apart(self.solution, name, self.dropped)

    @property
    def dropped(self) -> bool:
        """Whether a recording shows the servo moving with its torque off."""
        return dropped(self.recordings)

    @property
    def at_bound(self) -> list[str]:
        """Free parameters that ended at the edge of what they may be."""
        return at_bound(self.solution)

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
    share: Callable[[float], None] = lambda _share: None,
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
        share: Called with the share that is done at most, 0 to 1: the ladder may end before its last rung.

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
    fits = 1 if held_back else 1 + len(parts)
    search = _Search(pendulum, centre, used, parts, rng, starts, lambda done: share(done / (fits * (len(LADDER) + 2))))
    climbed: list[_Step] = []
    kept: list[int] = []
    for number, rung in enumerate(LADDER):
        on = climbed[kept[-1]] if kept else None
        below = on.solution if on else None
        names_below = below.chart.names if below else ()
        solution = search.fit(list(dict.fromkeys([*names_below, *rung.parameters])), below, used, starts)
        mae = float(search.mae(solution, used).mean())
        others = search.others(solution, on.others if on else None)
        step = _Step(rung, solution, mae, search.left_out(others), others)
        climbed.append(step)
        if on is None or _worth(step, on, centre):
            kept.append(number)
        judged = f", left out {step.unseen * 1e3:.1f} mrad" if parts else ""
        told(f"{rung.name}: {mae * 1e3:.1f} mrad{judged}{'' if kept[-1] == number else ', not kept'}")
        if parts and number - kept[-1] >= _PATIENCE:
            break
    top = climbed[kept[-1]]
    ladder = [Climbed(step.rung, number in kept, step.mae, step.unseen) for number, step in enumerate(climbed)]
    told(f"once more with what was kept, from {2 * starts} starts")
    found = top.solution
    found = search.again(found, used)
    found, held = _settled(search, found, used, dropped([recordings[index] for index in used]))
    unseen = search.left_out(search.others(found, top.others, held, again=True))
    return ServoFit(
        servo=servo,
        base=base,
        recordings=tuple(recordings[index] for index in used),
        solution=found,
        ladder=tuple(ladder),
        mae=search.mae(found, used),
        unseen=unseen,
        left_out=dict(zip([names[i] for i in held_back], search.mae(found, held_back).tolist(), strict=True)),
        seconds=time.monotonic() - began,
        servo_seconds=pendulum.steps * pendulum.timestep,
    )


@dataclass(frozen=True)
class _Step:
    """What `Climbed` tells, and the fits behind it: to all that may be seen, and to all but each part."""

    rung: Rung
    solution: Solution
    mae: float
    unseen: float
    others: list[Solution]


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
        fitted: Callable[[int], None],
    ) -> None:
        self._pendulum, self._centre, self._used, self._parts = pendulum, centre, used, parts
        self._rng, self._starts = rng, starts
        self._fits, self._fitted = 0, fitted

    def fit(
        self, names: Sequence[str], before: Solution | None, which: Sequence[int], starts: int, held: Sequence[str] = ()
    ) -> Solution:
        """Fit parameters; those held keep their priors.

        From a solution with fewer of them and from around it; without one, from the best of many draws.
        """
        names = [name for name in names if name not in held]
        chart = Chart(
            names, self._centre, {**switched_off(self._centre), **{name: self._centre[name] for name in held}}
        )
        problem = Problem(self._pendulum, which)
        if before is None:
            begins = problem.starts(chart, self._rng, starts)
        else:
            known = dict(zip(before.chart.names, before.z.tolist(), strict=True))
            first = np.array([known.get(name, 0.0) for name in names])
            begins = [first, *(first + _SCATTER * self._rng.standard_normal(len(names)) for _ in range(starts - 1))]
        found = problem.best(chart, begins)
        self._fits += 1
        self._fitted(self._fits)
        return found

    def again(self, found: Solution, which: Sequence[int], held: Sequence[str] = ()) -> Solution:
        """Return the better of two fits: from what was found, and from nothing."""
        names = found.chart.names
        fits = [self.fit(names, before, which, self._starts, held) for before in (found, None)]
        return min(fits, key=lambda solution: solution.objective)

    def others(
        self,
        solution: Solution,
        before: Sequence[Solution] | None,
        held: Sequence[str] = (),
        *,
        again: bool = False,
    ) -> list[Solution]:
        """Fit, for each part that is left out, the same parameters to the others; what saw that part has no say in it.

        Args:
            solution: What was fitted to all that may be seen: it names the parameters.
            before: What was found for each part with fewer parameters; None: nothing yet.
            held: Parameters that keep their priors.
            again: Whether to fit from nothing, too.
        """
        names, found = solution.chart.names, []
        for number, (seen, _) in enumerate(self._parts):
            start = None if before is None else before[number]
            if seen == list(self._used):  # left out on request: the solution has not seen them
                found.append(solution)
            elif again and start is not None:
                found.append(self.again(start, seen, held))
            else:
                found.append(self.fit(names, start, seen, self._starts, held))
        return found

    def left_out(self, others: Sequence[Solution]) -> float:
        """Return the error on recordings left out [rad]: each part is predicted by its own of `others`; NaN of none."""
        errors = [self.mae(one, unseen) for one, (_, unseen) in zip(others, self._parts, strict=True)]
        return float(np.concatenate(errors).mean()) if errors else float("nan")

    def mae(self, solution: Solution, which: Sequence[int]) -> Array:
        """Return each recording's mean absolute error [rad]."""
        angles = self._pendulum.simulate(parameter_set(solution.values)[None], which)
        recordings = [self._pendulum.recordings[index] for index in which]
        return np.array([
            np.abs(angle[0] - recording.angle).mean() for angle, recording in zip(angles, recordings, strict=True)
        ])  # fmt: skip

    def hold(self, solution: Solution, names: Sequence[str], which: Sequence[int]) -> Solution:
        """Return a fit with fewer parameters: those named keep their priors, the others are fitted around them."""
        rest = [other for other in solution.chart.names if other not in names]
        chart = Chart(rest, self._centre, {**solution.chart.held, **{name: self._centre[name] for name in names}})
        known = dict(zip(solution.chart.names, solution.z.tolist(), strict=True))
        return Problem(self._pendulum, which).fit(chart, np.array([known[other] for other in rest]))


def _settled(search: _Search, solution: Solution, which: Sequence[int], dropped: bool) -> tuple[Solution, list[str]]:
    """Return a solution whose parameters that the recordings do not tell are at their priors, and which these are.

    The others are fitted again around them.

    Its covariance stays that of all of them: what is known of a parameter does not grow by holding another.
    """
    chart, bound = solution.chart, at_bound(solution)
    untold = [name for name in chart.names if name not in bound and not told_apart(solution, name, dropped)]
    if not untold:
        return solution, untold
    if len(untold) == len(chart.names):
        return Solution(chart, np.zeros(len(untold)), solution.objective, solution.covariance), untold
    held = search.hold(solution, untold, which)
    z = chart.coordinates(np.array([held.values[name] for name in chart.names]))
    return Solution(chart, np.clip(z, chart.low, chart.high), held.objective, solution.covariance), untold


def _worth(step: _Step, on: _Step, centre: dict[str, float]) -> bool:
    """Whether a step lowers the error left out; where none could be left out: whether the base has its terms on."""
    if np.isfinite(step.unseen):
        return step.unseen <= _GAIN * on.unseen
    off = switched_off(centre)
    return any(centre[name] != off[name] for name in step.rung.parameters)


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
    motor = {name for name in POWERED if name in fit.sigma and not fit.identified(name)}
    if motor and not fit.dropped:
        said.append(
            "torque_constant and resistance cannot be separated: powered motion tells only K / R and K^2 / R + "
            "viscous; they keep their priors; record a torque-off drop to separate K from R"
        )
    for group in together:
        if fit.dropped or not motor & set(group):
            kept = [name for name in group if not fit.identified(name) and name not in fit.at_bound]
            verb = "keeps its prior" if len(kept) == 1 else "keep their priors"
            also = f"; {' and '.join(kept)} {verb}" if kept else ""
            said.append(f"{' and '.join(group)} cannot be separated by these recordings{also}")
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
