"""Play and stiffness of a lamp that was fitted as a rigid one: looked for on a grid, then fitted with everything else.

A search down a slope stalls on play: where there is none, its derivative says nothing, and what a rigid fit put into
friction and masses in its place holds it there. So values are tried, and for each of them the other unknowns move to
where the rigid fit's derivatives say that they explain the recordings best (variable projection, Golub and Pereyra
1973): that costs one simulation a value. Every unknown is then fitted together from the best of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.lamp.open_loop_fit import OUTLIER, Solution, covariance, minimise, residuals, slopes
from robolamp.calibrate.lamp.unknowns import MOST, Unknown
from robolamp.calibrate.least_squares import Robust
from robolamp.calibration import LAMP

Array = NDArray[np.float64]
ErrorsOf = Callable[[tuple[Unknown, ...], Array], list[Array]]
"""From unknowns, m of them, and a lamp a column, shape (m, k), to each recording's errors, shape (k, N, n) [rad]."""

IDENTIFIED = 0.6
"""A parameter counts as identified when its standard error is below this share of its prior's."""

_PLAY = (-MOST, -1.5, -0.4, 0.4, 1.1)  # standard deviations from the prior: 0.2 mrad, which is none, 1.4, 3, 5.3, 8.6
_STIFFNESS = (-1.2, -0.6, 0.0, 0.6, 1.3)  # 16 to 57 Nm/rad
_FINER = 0.3  # of the stiffness, to either side of the best so far
_POLISH = 2  # steps of all unknowns together
_WORTH = 1.05  # cost without a play by cost with it, from which on it is one
_INNER = 6  # reweighted steps of the others, by derivatives alone


def fit_gears(
    errors: ErrorsOf,
    rigid: tuple[Unknown, ...],
    found: Solution,
    gears: tuple[Unknown, ...],
    told: Callable[[str], None],
) -> tuple[tuple[Unknown, ...], Solution] | None:
    """Find the play of each joint and the stiffness of the arm.

    What the recordings do not tell, or what ends where a calibration file ends, is left out of the lamp, and the rest
    fitted once more without it.

    Args:
        errors: Simulates lamps.
        rigid: The unknowns of the rigid fit, m of them.
        found: What it found.
        gears: The unknowns to add: a play a joint, and the lamp's stiffness as the last.
        told: Called with a line as it goes on.

    Returns:
        All unknowns that are left and where they are; None where no play and no stiffness is.
    """
    search = _Search(errors, rigid, found, gears)
    best = search.run(told)
    asked = rigid + tuple(gear for gear, z in zip(gears, best.gears, strict=True) if z > -MOST)
    start = np.concatenate([best.rest, best.gears[best.gears > -MOST]])
    while len(asked) > len(rigid):
        every = asked
        ended = minimise(
            lambda z, every=every: errors(every, z),
            start,
            _POLISH,
            lambda cost: told(f"all joints with play and stiffness: cost {cost:.0f}"),
        )
        sigma = np.sqrt(np.diag(covariance(ended.shots)))
        keep = np.array(
            [
                index < len(rigid) or (error < IDENTIFIED and not _at_end(unknown, z))
                for index, (unknown, z, error) in enumerate(zip(asked, ended.z, sigma, strict=True))
            ]
        )
        if keep.all():
            return asked, ended
        asked = tuple(unknown for unknown, kept in zip(asked, keep, strict=True) if kept)
        start = ended.z[keep]
    return None


def _at_end(unknown: Unknown, z: float) -> bool:
    """Whether a value is where the search, or what a file may hold, ends."""
    legal = LAMP.get(unknown.name)
    return abs(z) > 0.98 * MOST or (legal is not None and unknown.value(z) in (legal.low, legal.high))


@dataclass(frozen=True)
class _Tried:
    """One value of each gear.

    Attributes:
        gears: In standard deviations from their priors.
        rest: The other unknowns that go with them.
        cost: What is minimised, by the derivatives.
    """

    gears: Array
    rest: Array
    cost: float


class _Search:
    """Tries values of gears; arguments as `fit_gears`'s."""

    def __init__(
        self, errors: ErrorsOf, rigid: tuple[Unknown, ...], found: Solution, gears: tuple[Unknown, ...]
    ) -> None:
        self._errors, self._asked, self._gears = errors, rigid + gears, len(gears)
        self._z, self._norm = found.z, Robust(len(rigid), OUTLIER)
        self._slopes = slopes(found.shots)

    def run(self, told: Callable[[str], None]) -> _Tried:
        """Return the best of the grid and of the search from there."""
        plays = self._gears - 1
        tried = self._try([[play] * plays + [stiff] for stiff in _STIFFNESS for play in (_PLAY[0], _PLAY[2], _PLAY[3])])
        best = min(tried, key=lambda one: one.cost)
        told(f"play and stiffness: cost {best.cost:.0f}")
        lines = [[_with(best.gears, joint, play) for play in _PLAY] for joint in range(plays)]
        lines.append([_with(best.gears, plays, best.gears[plays] + by) for by in (-_FINER, _FINER)])
        tried = self._try([gears for line in lines for gears in line])
        together, at = best.gears.copy(), 0
        for index, line in enumerate(lines):
            of_line = tried[at : at + len(line)]
            at += len(line)
            first = min(of_line, key=lambda one: one.cost)
            if index < plays and of_line[0].cost < _WORTH * min(first.cost, best.cost):
                first = of_line[0]  # without play, as good as with it
            elif first.cost >= best.cost:
                continue
            together[index] = first.gears[index]
        best = self._try([together])[0]
        return best

    def _try(self, gears: Sequence[Sequence[float] | Array]) -> list[_Tried]:
        """Return each with the other unknowns that fit it."""
        lanes = np.array(gears, np.float64)
        z = np.concatenate([np.repeat(self._z[:, None], len(lanes), axis=1), lanes.T])
        found = self._errors(self._asked, z)
        column = residuals(found, z[: len(self._z)])
        return [self._project(lane, column[:, index]) for index, lane in enumerate(lanes)]

    def _project(self, gears: Array, residual: Array) -> _Tried:
        moved = np.zeros_like(self._z)
        for _ in range(_INNER):
            gradient, curvature = self._norm.grad_hess((residual + self._slopes @ moved)[:, None], self._slopes)
            step = np.linalg.solve(curvature, gradient)[:, 0]
            moved = np.clip(self._z + moved - step, -MOST, MOST) - self._z
        prior = 0.5 * float(np.sum(gears[gears > -MOST] ** 2))  # play that is not there is not unlikely
        return _Tried(gears, self._z + moved, float(self._norm.value(residual + self._slopes @ moved)) + prior)


def _with(values: Array, index: int, value: float) -> Array:
    changed = values.copy()
    changed[index] = value
    return changed
