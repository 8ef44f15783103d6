"""Representations: how a search writes individuals, and how it breeds them.

A genotype is what is bred and kept in checkpoints; what it expresses, its phenotype, is one expression a joint: what
is tried, cached and inherited. For trees the two are the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from robolamp.evolve.representations.tree import Genome

G = TypeVar("G")
"""A genotype: hashable, and equal to another that is written alike."""


@dataclass(frozen=True)
class Plan:
    """What will be bred, drawn before any individual is evaluated.

    Attributes:
        parents: How many parents are to be selected.
        tournaments: Individuals of the tournament for each of them, shape (parents, size); None where parents are
            chosen in another way.
        operators: For trees: one after the other.
        elites: How many of the best are parents besides, first and unselected, and live on unchanged.
    """

    parents: int
    tournaments: NDArray[np.int64] | None
    operators: tuple[str, ...] = ()
    elites: int = 0


class Representation(Protocol[G]):
    """What a run needs of a representation."""

    def population(self, rng: np.random.Generator, count: int) -> list[G]:
        """Return a first generation.

        Args:
            rng: Where randomness comes from.
            count: How many genotypes.
        """
        ...

    def seeded(self, rng: np.random.Generator, phenotype: Genome, where: str) -> G:
        """Return a genotype that expresses a given controller.

        Args:
            rng: Where the rest of it comes from.
            phenotype: One expression a joint.
            where: What it came from, for the message.

        Raises:
            ExpressionError: It does not fit.
        """
        ...

    def plan(self, rng: np.random.Generator) -> Plan:
        """Draw what makes the next generation, before any individual is evaluated.

        Args:
            rng: Where randomness comes from.
        """
        ...

    def breed(
        self, rng: np.random.Generator, plan: Plan, parents: Sequence[G], count: int
    ) -> tuple[list[G], list[int]]:
        """Make the next generation.

        Args:
            rng: Where randomness comes from.
            plan: What was drawn.
            parents: Elites and selected parents, as many as the plan says.
            count: How many children.

        Returns:
            The children, and which of the parents each has most from.
        """
        ...

    def decode(self, genotype: G) -> Genome:
        """Return what a genotype expresses: one expression a joint."""
        ...

    def carrying(self, genotype: G, phenotype: Genome) -> G:
        """Return a genotype that expresses another phenotype of the same shape: one whose constants were tuned."""
        ...

    def dump(self, genotype: G) -> list[str]:
        """Return a genotype as texts, one a joint."""
        ...

    def load(self, texts: Sequence[str], where: str) -> G:
        """Return the genotype that texts hold.

        Args:
            texts: As `dump` gives them.
            where: What they came from, for messages.

        Raises:
            ExpressionError: They do not parse.
        """
        ...

    def genes(self, genotype: G) -> Mapping[str, str]:
        """Return what a controller file keeps of a genotype besides its expressions: a text a joint, or nothing."""
        ...
