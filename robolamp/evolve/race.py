"""Evaluating a generation with as little physics as its result allows.

Physics is deterministic, so what is known need not be simulated: a program that was tried before (in its simplified
form), and a child that would have sent its mother's goals, tick by tick. And what is certain to lose need not be tried
further: tournaments are drawn beforehand, fitness is a sum of terms not below 0, so an individual whose sum so far is
worse than somebody's whole fitness in every tournament it is in can win none of them. Neither changes any result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.simplify import simplify
from robolamp.evolve.representations.tree import Genome
from robolamp.evolve.trial import MAIN, MEASURES, STYLE, Case, Trials
from robolamp.figure import Driven
from robolamp.twin.trace import Trace, follows

_FIRST = 0.2  # of the individuals, the most promising, are tried on all cases before the others are compared with them
_AHEAD = 0.25  # of the others, the best so far, go on to all cases after each wave
_WAVE = 400  # trials at once, at least: fewer do not keep the processors busy
_MARGIN = 1e-9  # by which a bound must be worse, so that rounding makes nobody a loser
_LANES_AT_ONCE = 4000  # of a trace

_simplified = lru_cache(maxsize=20_000)(simplify)


def key(genome: Genome) -> Genome:
    """Return the simplified form of a genome: genomes of one key act alike."""
    return tuple(_simplified(part) for part in genome)


@dataclass(frozen=True)
class Contest:
    """What an individual can win in a generation.

    Attributes:
        tournaments: Individuals of each tournament, shape (k, size).
        phase: What style counts in this generation.
        champion: Fitness of the run's best individual so far, at full phase.
    """

    tournaments: NDArray[np.int64]
    phase: float
    champion: float


@dataclass
class Memory:
    """What a generation leaves to the next.

    Attributes:
        values: `MEASURES` of each program that was tried on all cases, shape (cases, 7), by key.
        lanes: Lanes of `trace` on which a program ran, shape (cases,), by key.
        trace: What programs saw and sent.
    """

    values: dict[Genome, NDArray[np.float64]] = field(default_factory=dict)
    lanes: dict[Genome, NDArray[np.int64]] = field(default_factory=dict)
    trace: Trace | None = None


@dataclass
class Counts:
    """Trials, one individual on one case each: made, and not made because ...

    Attributes:
        tried: They were simulated.
        cached: The program was tried before.
        inherited: The individual acts as its mother did.
        stopped: The individual was certain to lose, or was screened out.
    """

    tried: int = 0
    cached: int = 0
    inherited: int = 0
    stopped: int = 0


def fitness(values: NDArray[np.float64], phase: float) -> NDArray[np.float64]:
    """Return main + phase x style, the mean over cases; of a trial that was not made the least that it can be, 0.

    Args:
        values: `MEASURES`, shape (individuals, cases, 7).
        phase: What style counts.
    """
    known = np.nan_to_num(values[:, :, [MAIN, STYLE]])
    return known[:, :, 0].mean(axis=1) + phase * known[:, :, 1].mean(axis=1)


class Race:
    """A generation's evaluation.

    Attributes:
        counts: How the trials were come by.

    Args:
        trials: Tries genomes.
        cases: Goals and lamps.
        lamp: The lamp, or the figure.
        period: Control period [s].
        population: The individuals.
        mothers: Whom each individual is likely to act like, or None.
        memory: What the generation before left.
        reuse: Whether to use what is known; without, every trial is simulated.
        record: Whether what controllers see and send is to be remembered for their children.
    """

    def __init__(
        self,
        trials: Trials,
        cases: Sequence[Case],
        lamp: Driven,
        period: float,
        population: Sequence[Genome],
        mothers: Sequence[Genome | None],
        memory: Memory,
        reuse: bool = True,
        record: bool = True,
    ) -> None:
        self._trials, self._cases, self._lamp, self._period = trials, cases, lamp, period
        self._reuse, self._record = reuse, reuse and record
        self._keys = [key(genome) for genome in population] if reuse else list(population)
        # Without reuse an individual is only itself.
        names = self._keys if reuse else range(len(population))
        place = {name: index for index, name in enumerate(dict.fromkeys(names))}
        self._place = np.array([place[name] for name in names])
        first = np.unique(self._place, return_index=True)[1]
        self._unique = [self._keys[index] for index in first]
        self._mothers = [mothers[index] for index in first]
        count = len(cases)
        self._values = np.full((len(self._unique), count, len(MEASURES)), np.nan)
        self._traces: list[Trace] = [memory.trace] if memory.trace is not None else []
        self._where = np.full((len(self._unique), count, 2), -1)  # trace and lane of each trial
        self._screened = np.zeros(len(self._unique), bool)
        self._memory = memory
        self.counts = Counts()
        if reuse:
            self._recall()
            self._inherit()
        self.counts.cached += (len(population) - len(self._unique)) * count

    def _recall(self) -> None:
        for index, name in enumerate(self._unique):
            if name in self._memory.values:
                self._values[index] = self._memory.values[name]
                self.counts.cached += len(self._cases)
                if name in self._memory.lanes:
                    self._where[index] = np.stack([np.zeros_like(lanes := self._memory.lanes[name]), lanes], axis=1)

    def _inherit(self) -> None:
        """Take over, case by case, the runs of mothers whom their children follow."""
        if self._memory.trace is None:
            return
        lanes, asking, mothers = [], [], []
        for index, genome in enumerate(self._mothers):
            mother = None if genome is None else key(genome)
            if np.isnan(self._values[index, 0, MAIN]) and mother in self._memory.lanes:
                lanes.append(self._memory.lanes[mother])
                asking.append(index)
                mothers.append(mother)
        cases = len(self._cases)
        step = max(1, _LANES_AT_ONCE // cases)
        for start in range(0, len(asking), step):
            part = slice(start, start + step)
            own, rows = np.array(asking[part]), np.concatenate(lanes[part])
            programs = [self._trials.program(self._unique[index]) for index in own]
            program = np.repeat(np.arange(len(own)), cases)
            same, _ = follows(programs, program, self._memory.trace.take(rows), self._lamp, self._period)
            same = same.reshape(len(own), cases)
            known = np.stack([self._memory.values[mother] for mother in mothers[part]])
            for row, index in enumerate(own):
                self._values[index, same[row]] = known[row, same[row]]
                self._where[index, same[row], 0] = 0
                self._where[index, same[row], 1] = rows.reshape(len(own), cases)[row, same[row]]
            self.counts.inherited += int(same.sum())

    def _run(self, pairs: NDArray[np.int64]) -> None:
        """Simulate trials, shape (k, 2): program and case."""
        self.counts.tried += len(pairs)
        for part, values, trace in self._trials.measure(self._unique, self._cases, pairs, record=self._record):
            program, case = pairs[part].T
            self._values[program, case] = values
            if trace is not None:
                self._where[program, case] = np.stack(
                    [np.full(len(program), len(self._traces)), np.arange(len(program))], axis=1
                )
                self._traces.append(trace)

    def _missing(self, programs: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
        """Return what has not been tried, program by program, shape (k, 2)."""
        pairs = np.argwhere(np.isnan(self._values[:, :, MAIN]))
        return pairs if programs is None else pairs[np.isin(pairs[:, 0], programs)]

    @property
    def _complete(self) -> NDArray[np.bool_]:
        return ~np.isnan(self._values[:, :, MAIN]).any(axis=1) & ~self._screened

    def all(self) -> None:
        """Try every individual on every case."""
        self._run(self._missing())

    def screen(self, share: float, phase: float, turn: int) -> None:
        """Try all on a sixth of the cases, the better half on another sixth, and the best of those on all.

        What an individual was not tried on counts as it does for the worst of those that were tried on all.

        Args:
            share: Of the individuals that are tried on all.
            phase: What style counts.
            turn: Generation: each begins with other cases, in turn.
        """
        count = len(self._cases)
        some = int(np.ceil(count / 6))
        order = (turn * some + np.arange(count)) % count
        left = np.arange(len(self._unique))
        for tried, part in ((some, 0.5), (2 * some, share), (count, 1.0)):
            first = order[:tried]
            missing = self._missing(left)
            self._run(missing[np.isin(missing[:, 1], first)])
            ranks = np.argsort(fitness(self._values[left][:, first], phase), kind="stable")
            left = left[ranks[: max(1, int(np.ceil(max(part, share) * len(self._unique))))]]
        missing = self._missing()
        self.counts.stopped += len(missing)
        self._screened[missing[:, 0]] = True
        for column in (MAIN, STYLE):
            worst = self._values[~self._screened, :, column].max(axis=0)
            self._values[missing[:, 0], missing[:, 1], column] = worst[missing[:, 1]]

    def race(self, contest: Contest, promise: NDArray[np.float64]) -> None:
        """Try individuals until it is certain who wins each tournament, and whether there is a new champion.

        Args:
            contest: What can be won.
            promise: What fitness is expected of each individual, shape (individuals,).
        """
        hoped = np.full(len(self._unique), np.inf)
        np.minimum.at(hoped, self._place, promise)
        todo = [index for index in np.argsort(hoped, kind="stable") if not self._complete[index]]
        self._run(self._missing(np.array(todo[: int(np.ceil(_FIRST * len(todo)))], np.int64)))
        order = self._hardest_first(contest.phase)
        while len(rest := np.flatnonzero(~self._complete & ~self._losers(contest))):
            tried = ~np.isnan(self._values[:, :, MAIN])
            so_far = fitness(self._values, contest.phase)[rest] / np.maximum(tried[rest].mean(axis=1), 1e-9)
            untouched = ~tried[rest].any(axis=1)
            so_far[untouched] = np.inf
            ahead = rest[np.argsort(so_far, kind="stable")][: int(np.ceil(_AHEAD * (~untouched).sum()))]
            others = rest[~np.isin(rest, ahead)]
            columns = int(np.ceil(_WAVE / max(len(others), 1)))
            nexts = [(index, case) for index in others for case in order[~tried[index, order]][:columns]]
            self._run(np.concatenate([self._missing(ahead), np.array(nexts, np.int64).reshape(-1, 2)]))
        self.counts.stopped += len(self._missing())

    def _hardest_first(self, phase: float) -> NDArray[np.int64]:
        """Return the cases, those first on which the generation before did worst: they tell losers soonest."""
        if not self._memory.values:
            return np.arange(len(self._cases))
        known = np.stack(list(self._memory.values.values()))
        mean = known.mean(axis=0)
        return np.argsort(-(mean[:, MAIN] + phase * mean[:, STYLE]), kind="stable")

    def _losers(self, contest: Contest) -> NDArray[np.bool_]:
        """Return which programs can win nothing any more, shape (unique,)."""
        least = fitness(self._values, contest.phase)
        whole = fitness(self._values, 1.0)
        certain = np.where(self._complete, least, np.inf)
        teams = self._place[contest.tournaments]
        best = certain[teams].min(axis=1)
        worst_of = np.full(len(least), certain.min())  # also: the best of the generation is to be known
        np.maximum.at(worst_of, teams.ravel(), np.repeat(best, teams.shape[1]))
        champion = min(contest.champion, float(np.where(self._complete, whole, np.inf).min()))
        margin = _MARGIN * (1.0 + np.abs(least))
        return (least > worst_of + margin) & (whole > champion + margin) & ~self._complete

    @property
    def values(self) -> NDArray[np.float64]:
        """`MEASURES` of each individual on each case, NaN where it was not tried; shape (individuals, cases, 7)."""
        return self._values[self._place]

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Which individuals were tried on all cases, shape (individuals,)."""
        return self._complete[self._place]

    def remember(self, parents: Sequence[Genome]) -> Memory:
        """Return what the next generation may use.

        Args:
            parents: Those it is bred from: their runs are kept.
        """
        if not self._reuse:
            return Memory()
        values = {self._unique[index]: self._values[index] for index in np.flatnonzero(self._complete)}
        index = {name: row for row, name in enumerate(self._unique)}
        kept = [name for name in dict.fromkeys(key(parent) for parent in parents) if self._traced(index.get(name))]
        lanes: dict[Genome, NDArray[np.int64]] = {}
        count = len(self._cases)
        for number, name in enumerate(kept):
            lanes[name] = number * count + np.arange(count)
        if not kept:
            return Memory(values)
        where = np.concatenate([self._where[index[name]] for name in kept])
        blank = self._traces[0]
        whole = Trace.blank(len(where), blank.inputs.shape[1], blank.inputs.shape[2], blank.goals.shape[2])
        for number, trace in enumerate(self._traces):
            rows = np.flatnonzero(where[:, 0] == number)
            part = trace.take(where[rows, 1])
            whole.inputs[rows], whole.goals[rows], whole.ticks[rows] = part.inputs, part.goals, part.ticks
        return Memory(values, lanes, whole)

    def _traced(self, row: int | None) -> bool:
        return row is not None and bool((self._where[row, :, 0] >= 0).all()) and bool(self._complete[row])
