"""What EMOT (Kwasnicka & Wozniak, section 5.1) says of its searches, and by which rule ours agree with it.

The rules were fixed before the runs; results, noise and what "clearly" means are those of
`robolamp.evolve.study.claims`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from robolamp.evolve.study.claims import AGREES, DISAGREES, UNKNOWN, ClaimVerdict, Noise, Results, agreement, told

_BEST = ("10", "15")  # lengths of the head that the paper found best
_POOR = ("3", "50")
_FEW = 50  # individuals, up to which the paper's populations fail
_ENOUGH = 100  # ... and from which they are as good as larger ones


def head(results: Results) -> list[ClaimVerdict]:
    """Heads of 10 and 15 are best, 3 and 50 poor.

    Rule: no other length is clearly better than 10 and 15 together, and one at least is clearly worse; one clearly
    better, or all alike: does not agree. And each of 3 and 50 is clearly worse than 10 and 15 together; one of them
    alike or better: does not agree.
    """
    noise = Noise(results)
    best = [name for name in _BEST if name in results]
    others = [name for name in results if name not in _BEST] if best else []
    relations = {name: noise.compare([name], best) for name in others}
    found = set(relations.values())
    verdict = AGREES if "worse" in found else UNKNOWN
    if "better" in found or found == {"alike"}:
        verdict = DISAGREES
    poor = [relation for name, relation in relations.items() if name in _POOR]
    figures = told("h", results)
    return [
        ClaimVerdict("head", "Heads of 10 and 15 symbols are best.", verdict, figures),
        ClaimVerdict(
            "head", "Heads of 3 and of 50 are poor.", agreement(poor, {"worse"}, {"alike", "better"}), figures
        ),
    ]


def population(results: Results) -> list[ClaimVerdict]:
    """50 individuals or fewer fail, 100 or more are no better than 100.

    Rule: each population of 50 or fewer is clearly worse than those of 100 and more together; one of them alike or
    better: does not agree. And each of more than 100 is alike 100, or clearly worse; one clearly better: does not
    agree.
    """
    noise = Noise(results)
    large = [name for name in results if int(name) >= _ENOUGH]
    few = [noise.compare([name], large) for name in results if int(name) <= _FEW] if large else []
    yardstick = [name for name in large if int(name) == _ENOUGH]
    more = [noise.compare([name], yardstick) for name in large if name not in yardstick] if yardstick else []
    figures = told("population", results)
    return [
        ClaimVerdict(
            "gep-population",
            "Populations of 50 or fewer do not evolve acceptable solutions.",
            agreement(few, {"worse"}, {"alike", "better"}),
            figures,
        ),
        ClaimVerdict(
            "gep-population",
            "More than 100 individuals give essentially no better controllers.",
            agreement(more, {"alike", "worse"}, {"better"}),
            figures,
        ),
    ]


def representation(results: Results) -> list[ClaimVerdict]:
    """Genes do as well as trees for the same physics.

    Rule: after as many physics steps as the shortest of the runs has, genes are alike or clearly better; clearly worse:
    does not agree.
    """
    noise = Noise(results)
    relations = [noise.compare(["gep"], ["tree"])] if {"gep", "tree"} <= set(results) else []
    claim = "Genes do as well as trees on the hop, for as many physics steps."
    verdict = agreement(relations, {"alike", "better"}, {"worse"})
    return [ClaimVerdict("representation", claim, verdict, told("representation", results))]


def success(found: Mapping[str, Sequence[bool]]) -> list[ClaimVerdict]:
    """Ten runs of ten succeed.

    Rule: ten runs or more were made, and the controller of each ends within the figure's radius of the point, upright,
    its head never hit; one that does not: does not agree.
    """
    runs = [succeeded for each in found.values() for succeeded in each]
    verdict = DISAGREES if not all(runs) else AGREES if len(runs) >= 10 else UNKNOWN
    figures = f"{sum(runs)} of {len(runs)} runs succeeded."
    return [ClaimVerdict("jumper", "All ten runs end with success.", verdict, figures)]


FITNESS_RULES: dict[str, Callable[[Results], list[ClaimVerdict]]] = {
    "head": head,
    "gep-population": population,
    "representation": representation,
}
"""The rule of each study that compares fitness."""
SUCCESS_RULES: dict[str, Callable[[Mapping[str, Sequence[bool]]], list[ClaimVerdict]]] = {"jumper": success}
"""The rule of each study that counts runs which succeed."""
