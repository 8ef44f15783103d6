"""What the 1997 paper's section 4 says, and by which rule our runs agree with it. The rules were fixed before the runs.

A run's result is its champion's fitness at phase 1 (lower is better), a point's result the median over its seeds.

- The noise s is the standard deviation over seeds, pooled over the study's points. Two points (or pools of points)
  differ clearly when their medians differ by more than twice the standard error of a difference of medians,
  2 x 1.2533 s sqrt(1/n + 1/m) for n and m runs, and by more than `ALIKE`.
- They are alike when their medians differ by at most `ALIKE` and twice that standard error is at most `COARSE`.
- Anything else is unclear; so is every comparison without two seeds or more at some point.

1.2533 = sqrt(pi / 2): the standard error of a median over that of a mean, for normal noise and many runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

ALIKE = 0.1
"""Medians closer than this are the same for whoever looks at the lamp: a fifth of the 0.5 below which the paper says
that motion tended to look good (section 4)."""
COARSE = 0.25
"""Noise above which nothing is called alike: half of that 0.5."""
ARRIVES = 0.10
"""A controller arrives when it ends upright within this share of the goal distance, or within 1.5 cm."""
_MEDIAN = math.sqrt(math.pi / 2)
_YARDSTICK = 0.25  # share of goals that the robust controller must arrive at before another is measured against it

AGREES, DISAGREES, UNKNOWN = "agrees", "does not agree", "cannot tell"

Results = Mapping[str, Sequence[float]]
"""A study's results: for each point the champion's fitness at phase 1 of each seed."""


@dataclass(frozen=True)
class ClaimVerdict:
    """The verdict on a claim.

    Attributes:
        study: Name of the study.
        claim: What the paper says.
        verdict: `AGREES`, `DISAGREES` or `UNKNOWN`.
        figures: The numbers it rests on, in a sentence.
    """

    study: str
    claim: str
    verdict: str
    figures: str


class Noise:
    """Comparisons of a study's points against the noise over seeds.

    Attributes:
        deviation: Standard deviation over seeds, pooled over the points; NaN where no point has two seeds.

    Args:
        results: The study's results.
    """

    def __init__(self, results: Results) -> None:
        self._results = results
        groups = [np.asarray(values) for values in results.values() if len(values) > 1]
        freedom = sum(len(group) - 1 for group in groups)
        squares = sum(float(((group - group.mean()) ** 2).sum()) for group in groups)
        self.deviation = math.sqrt(squares / freedom) if freedom else math.nan

    def clear(self, runs: int, others: int) -> float:
        """Return the difference of medians above which two groups of so many runs differ clearly."""
        return 2 * _MEDIAN * self.deviation * math.sqrt(1 / runs + 1 / others)

    def compare(self, points: Iterable[str], others: Iterable[str]) -> str:
        """Return how points do against others: "better", "worse", "alike" or "unclear"; runs of each are pooled."""
        first, second = (np.concatenate([self._results[name] for name in names]) for names in (points, others))
        bound = self.clear(len(first), len(second))
        gain = float(np.median(second) - np.median(first))
        if not math.isfinite(bound):
            return "unclear"
        if abs(gain) > max(bound, ALIKE):
            return "better" if gain > 0 else "worse"
        return "alike" if abs(gain) <= ALIKE and bound <= COARSE else "unclear"

    def told(self) -> str:
        """Return the noise, in words."""
        if math.isnan(self.deviation):
            return "one seed: the noise is not known"
        return f"standard deviation over seeds {self.deviation:.3f}"


def median(values: Sequence[float]) -> float:
    """Return the median of a point's seeds."""
    return float(np.median(values))


def told(axis: str, results: Results) -> str:
    """Return a study's numbers in a sentence.

    Args:
        axis: What its points are.
        results: Of its points.
    """
    if not results:
        return "Nothing was run for it."
    medians = ", ".join(f"{name}: {median(values):.3f}" for name, values in results.items())
    return f"Median fitness of champions at phase 1, by {axis}: {medians}; {Noise(results).told()}."


def agreement(relations: Iterable[str], good: set[str], bad: set[str]) -> str:
    """Return the verdict on a claim: every relation good: agrees; one bad: does not; else, or without any: cannot tell.

    Args:
        relations: As `Noise.compare` gives them.
        good: What the claim says they are.
        bad: What speaks against it.
    """
    found = set(relations)
    if found & bad:
        return DISAGREES
    return AGREES if found and found <= good else UNKNOWN


def _each_like_the_rest(results: Results) -> str:
    if len(results) < 2:
        return UNKNOWN
    noise = Noise(results)
    relations = [noise.compare([name], [other for other in results if other != name]) for name in results]
    return agreement(relations, {"alike"}, {"better", "worse"})


def population(results: Results) -> list[ClaimVerdict]:
    """M < 200 fails; from 200 on the size matters little.

    Rule: each population below 200 is clearly worse than those of 200 and more together; one of them alike or better:
    does not agree. And each of 200 or more is alike the others of them together; one clearly better or worse: does not
    agree.
    """
    noise = Noise(results)
    small = [name for name in results if int(name) < 200]
    large = {name: values for name, values in results.items() if int(name) >= 200}
    relations = [noise.compare([name], large) for name in small] if large else []
    return [
        ClaimVerdict(
            "population",
            "Populations under 200 do not converge to good fitness.",
            agreement(relations, {"worse"}, {"alike", "better"}),
            told("M", results),
        ),
        ClaimVerdict(
            "population",
            "From 200 individuals on, the population size makes little difference.",
            _each_like_the_rest(large),
            told("M", large),
        ),
    ]


def generations(results: Results) -> list[ClaimVerdict]:
    """G = 30 is best.

    Rule: no other number of generations is clearly better, one at least is clearly worse, and none is unclear. One
    clearly better, or all alike: does not agree.
    """
    noise = Noise(results)
    relations = [noise.compare(["30"], [name]) for name in results if name != "30"] if "30" in results else []
    if "worse" in relations or (relations and set(relations) == {"alike"}):
        verdict = DISAGREES
    else:
        verdict = AGREES if "better" in relations and "unclear" not in relations else UNKNOWN
    return [ClaimVerdict("generations", "30 generations are best; more do not help.", verdict, told("G", results))]


def selection(results: Results) -> list[ClaimVerdict]:
    """Tournaments beat fitness-proportionate selection, and their size hardly matters.

    Rule: each size is clearly better than proportionate; one alike or worse: does not agree. And each size is alike the
    others together; one clearly better or worse: does not agree.
    """
    noise = Noise(results)
    sizes = {name: values for name, values in results.items() if name != "proportionate"}
    relations = [noise.compare([name], ["proportionate"]) for name in sizes] if "proportionate" in results else []
    return [
        ClaimVerdict(
            "selection",
            "Tournaments of any size beat fitness-proportionate selection.",
            agreement(relations, {"better"}, {"alike", "worse"}),
            told("selection", results),
        ),
        ClaimVerdict(
            "selection",
            "The size of the tournament hardly matters.",
            _each_like_the_rest(sizes),
            told("size", sizes),
        ),
    ]


def crossover(results: Results) -> list[ClaimVerdict]:
    """Pc >= 50 % is alike.

    Rule: each rate of 50 % or more is alike the others of them together; one clearly better or worse: does not agree.
    """
    high = {name: values for name, values in results.items() if int(name) >= 50}
    low = {name: values for name, values in results.items() if int(name) < 50}
    figures = told("Pc [%]", high)
    if low:
        figures += f" Below 50 %: {', '.join(f'{name}: {median(values):.3f}' for name, values in low.items())}."
    claim = "From 50 % on, the crossover rate does not matter much."
    return [ClaimVerdict("crossover", claim, _each_like_the_rest(high), figures)]


def tuned(results: Results) -> list[ClaimVerdict]:
    """The tuned run is as good for 37.5 % of the individuals.

    Rule: it is alike or clearly better; clearly worse: does not agree.
    """
    noise = Noise(results)
    relations = [noise.compare(["tuned"], ["first"])] if {"tuned", "first"} <= set(results) else []
    claim = "M = 250, G = 30, Pc = 80 % does as well as M = 400, G = 50, Pc = 90 %, for 37.5 % of the individuals."
    return [ClaimVerdict("tuned", claim, agreement(relations, {"alike", "better"}, {"worse"}), told("run", results))]


@dataclass(frozen=True)
class Shares:
    """What share of goals one seed's controller arrives at (see `ARRIVES`).

    Attributes:
        within: Of goals from 5 to 60 cm.
        beyond: Of goals from 65 to 120 cm; NaN where none was tried.
        own: Whether it arrives at 30 cm, the specific controller's own goal.
    """

    within: float
    beyond: float
    own: bool


def specific(found: Mapping[str, Sequence[Shares]]) -> list[ClaimVerdict]:
    """The specific controller is brittle.

    Rule: of the goals from 5 to 60 cm it arrives at less than half as many as the robust controller does (medians over
    seeds); at half or more: does not agree. Cannot tell with one seed, when half or fewer of the specific controllers
    arrive at their own goal, or when the robust ones arrive at less than a quarter of the goals.
    """
    claim = "A controller evolved for one action (30 cm forward) is brittle."
    own, robust = found.get("specific", ()), found.get("robust", ())
    if not own or not robust:
        return [ClaimVerdict("specific", claim, UNKNOWN, "Not both of the two were run.")]
    action, skill = (median([each.within for each in group]) for group in (own, robust))
    learnt = sum(each.own for each in own)
    verdict = AGREES if action < 0.5 * skill else DISAGREES
    if min(len(own), len(robust)) < 2 or 2 * learnt <= len(own) or skill < _YARDSTICK:
        verdict = UNKNOWN
    figures = (
        f"Of the goals from 5 to 60 cm the specific controllers arrive at {action:.0%}, the robust ones at {skill:.0%}"
        f" (medians over {len(own)} and {len(robust)} seeds); {learnt} of {len(own)} arrive at their own goal."
    )
    return [ClaimVerdict("specific", claim, verdict, figures)]


def distance(found: Mapping[str, Sequence[Shares]]) -> list[ClaimVerdict]:
    """The robust controller goes any distance.

    Rule: of the goals from 65 to 120 cm it arrives at 80 % or more of the share that it arrives at from 5 to 60 cm
    (medians over seeds), given time in proportion to the distance; at less than half of that share: does not agree.
    Cannot tell between the two, with one seed, or when it arrives at less than a quarter of the goals up to 60 cm.
    """
    claim = "The robust controller moves forward any distance."
    robust = found.get("robust", ())
    if not robust:
        return [ClaimVerdict("distance", claim, UNKNOWN, "Nothing was run for it.")]
    within, beyond = (median([getattr(each, name) for each in robust]) for name in ("within", "beyond"))
    verdict = AGREES if beyond >= 0.8 * within else DISAGREES if beyond < 0.5 * within else UNKNOWN
    if len(robust) < 2 or within < _YARDSTICK:
        verdict = UNKNOWN
    figures = (
        f"The robust controllers arrive at {within:.0%} of the goals from 5 to 60 cm and at {beyond:.0%} of those from"
        f" 65 to 120 cm (medians over {len(robust)} seeds)."
    )
    return [ClaimVerdict("distance", claim, verdict, figures)]


FITNESS_RULES: dict[str, Callable[[Results], list[ClaimVerdict]]] = {
    "population": population,
    "generations": generations,
    "selection": selection,
    "crossover": crossover,
    "tuned": tuned,
}
"""The rule of each study that compares fitness."""
GOAL_RULES: dict[str, Callable[[Mapping[str, Sequence[Shares]]], list[ClaimVerdict]]] = {
    "specific": specific,
    "distance": distance,
}
"""The rule of each study that tries controllers on other goals."""
