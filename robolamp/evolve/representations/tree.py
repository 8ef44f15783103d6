"""Trees as genomes: birth and the operators of genetic programming (Koza 1992, chapter 6).

A genome is a tuple of expressions, one a joint: the branches of one tree whose root is `list` (Gritz & Hahn 1997,
Figure 2), so crossover may carry a subtree from one joint to another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robolamp.controller.expression import Expression, Token, depth, subtree_end
from robolamp.controller.primitives import PRIMITIVES
from robolamp.evolve.tasks.task import Task

Genome = tuple[Expression, ...]
"""One expression a joint."""

_INNER_SHARE = 0.9  # of crossover points are functions, where there are any (Koza 1992, section 6.4.1)
_CONSTANT_SHARE = 0.25  # of leaves at birth are constants; Koza's ephemeral constant is one terminal among many
_ATTEMPTS = 20  # to make a genome that is not there yet
_STEP_RELATIVE, _STEP_RANGE = 0.1, 0.01  # mutation of constants: of the value, and of the range
_POINT_SHARE = 0.05  # of nodes that point mutation replaces; at least one
_PEERS = {
    name: tuple(other.name for other in PRIMITIVES.values() if other.arity == own.arity and other.name != name)
    for name, own in PRIMITIVES.items()
}  # which may stand in for it


@dataclass(frozen=True)
class Breeder:
    """Makes genomes.

    Attributes:
        task: Limits of depth and size, and the range of constants.
        terminals: What leaves may read.
        joints: Expressions of a genome.
    """

    task: Task
    terminals: Sequence[str]
    joints: int

    def _leaf(self, rng: np.random.Generator) -> Token:
        if rng.random() < _CONSTANT_SHARE:
            return round(float(rng.uniform(*self.task.constants)), 4)
        return self.terminals[int(rng.integers(len(self.terminals)))]

    def _grow(self, rng: np.random.Generator, limit: int, full: bool, tokens: list[Token]) -> None:
        names = tuple(PRIMITIVES)
        choices = len(names) + len(self.terminals)
        if len(tokens) > self.task.gp.nodes:  # too large already: what is grown does not matter
            limit = 0
        if limit == 0 or (not full and tokens and rng.random() < len(self.terminals) / choices):
            tokens.append(self._leaf(rng))
            return
        name = names[int(rng.integers(len(names)))]
        tokens.append(name)
        for _ in range(PRIMITIVES[name].arity):
            self._grow(rng, limit - 1, full, tokens)

    def population(self, rng: np.random.Generator, count: int) -> list[Genome]:
        """Return a first generation by ramped half-and-half, without twins where they can be avoided.

        One that would be too large is born shallower.

        Args:
            rng: Where randomness comes from.
            count: How many genomes.
        """
        shortest, tallest = self.task.gp.depth_at_birth
        born: list[Genome] = []
        seen: set[Genome] = set()
        for index in range(count):
            limit, full = shortest + index % (tallest - shortest + 1), bool(index % 2)
            genome = self._born(rng, limit, full)
            for _ in range(_ATTEMPTS):
                if genome not in seen:
                    break
                genome = self._born(rng, limit, full)
            seen.add(genome)
            born.append(genome)
        return born

    def _born(self, rng: np.random.Generator, limit: int, full: bool) -> Genome:
        parts = []
        for _ in range(self.joints):
            tokens: list[Token] = []
            self._grow(rng, limit, full, tokens)
            parts.append(Expression(tuple(tokens)))
        if nodes(parts) > self.task.gp.nodes and limit:
            return self._born(rng, limit - 1, full)
        return tuple(parts)

    def _point(self, rng: np.random.Generator, genome: Genome) -> tuple[int, int]:
        nodes = [(joint, index) for joint, part in enumerate(genome) for index in range(len(part.tokens))]
        inner = [(joint, index) for joint, index in nodes if genome[joint].tokens[index] in PRIMITIVES]
        pool = inner if inner and rng.random() < _INNER_SHARE else nodes
        return pool[int(rng.integers(len(pool)))]

    def crossover(self, rng: np.random.Generator, mother: Genome, father: Genome) -> tuple[Genome, Genome]:
        """Swap one subtree; a child that grew too deep or too large is replaced by the parent it came from.

        Args:
            rng: Where randomness comes from.
            mother: One parent.
            father: The other.
        """
        (a, i), (b, j) = self._point(rng, mother), self._point(rng, father)
        first, second = mother[a].tokens, father[b].tokens
        i_end, j_end = subtree_end(first, i), subtree_end(second, j)
        son = self._replaced(mother, a, first[:i] + second[j:j_end] + first[i_end:])
        daughter = self._replaced(father, b, second[:j] + first[i:i_end] + second[j_end:])
        return son, daughter

    def _replaced(self, genome: Genome, joint: int, tokens: tuple[Token, ...]) -> Genome:
        child = (*genome[:joint], Expression(tokens), *genome[joint + 1 :])
        return genome if depth(tokens) > self.task.gp.depth or nodes(child) > self.task.gp.nodes else child

    def subtree_mutation(self, rng: np.random.Generator, genome: Genome) -> Genome:
        """Replace one subtree by a newly grown one (Koza 1992, section 6.5.1).

        The point is drawn as for crossover; the new subtree is at most as deep as a tree at birth. A child that grew
        too deep or too large is replaced by its parent.

        Args:
            rng: Where randomness comes from.
            genome: The parent.
        """
        joint, index = self._point(rng, genome)
        tokens = genome[joint].tokens
        grown: list[Token] = []
        self._grow(rng, int(rng.integers(self.task.gp.depth_at_birth[1] + 1)), False, grown)
        return self._replaced(genome, joint, (*tokens[:index], *grown, *tokens[subtree_end(tokens, index) :]))

    def point_mutation(self, rng: np.random.Generator, genome: Genome) -> Genome:
        """Replace nodes by others that take as many arguments (Poli, Langdon & McPhee 2008, section 2.4).

        Each node that has an alternative is replaced with a probability of 5 %; at least one is.

        Args:
            rng: Where randomness comes from.
            genome: The parent.
        """
        parts = [list(part.tokens) for part in genome]
        points = [(part, at) for part in parts for at, token in enumerate(part) if _PEERS.get(str(token), True)]
        struck = rng.random(len(points)) < _POINT_SHARE
        if not struck.any():
            struck[rng.integers(len(points))] = True
        for (part, at), hit in zip(points, struck, strict=True):
            if hit:
                part[at] = self._other(rng, part[at])
        return tuple(Expression(tuple(part)) for part in parts)

    def _other(self, rng: np.random.Generator, token: Token) -> Token:
        peers = _PEERS.get(str(token))
        if peers:
            return peers[int(rng.integers(len(peers)))]
        leaf = self._leaf(rng)
        while leaf == token:
            leaf = self._leaf(rng)
        return leaf

    def mutate_constants(self, rng: np.random.Generator, genome: Genome) -> Genome:
        """Return a genome whose constants have all taken a small Gaussian step.

        Args:
            rng: Where randomness comes from.
            genome: The parent.
        """
        low, high = self.task.constants
        values = constants(genome)
        steps = [_STEP_RELATIVE * abs(value) + _STEP_RANGE * (high - low) for value in values]
        moved = [v + s * float(rng.standard_normal()) for v, s in zip(values, steps, strict=True)]
        return with_constants(genome, moved)


def nodes(genome: Sequence[Expression]) -> int:
    """Return a genome's size: the nodes of all its joints together."""
    return sum(len(part.tokens) for part in genome)


def constants(genome: Genome) -> list[float]:
    """Return a genome's constants, in the order they are written."""
    return [token for part in genome for token in part.tokens if isinstance(token, float)]


def with_constants(genome: Genome, values: Sequence[float]) -> Genome:
    """Return a genome with its constants replaced, rounded to the 5 digits that a file shows.

    Args:
        genome: The genome.
        values: As many as it has, in the order they are written.
    """
    supply = iter(values)
    return tuple(
        Expression(tuple(float(f"{next(supply):.5g}") if isinstance(token, float) else token for token in part.tokens))
        for part in genome
    )
