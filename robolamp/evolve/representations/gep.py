"""Gene expression programming: chromosomes, one gene for each joint (Ferreira 2001; EMOT, section 4.2 and Table 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.gene import CONSTANT, Gene, parse_gene, tail_length
from robolamp.controller.primitives import PRIMITIVES
from robolamp.errors import ExpressionError
from robolamp.evolve.representations.gep_operators import (
    Symbols,
    between,
    brought_first,
    first_function,
    reading_frame,
    swap,
    transposed,
)
from robolamp.evolve.representations.representation import Plan
from robolamp.evolve.representations.tree import Genome
from robolamp.evolve.selection import draw_tournament
from robolamp.evolve.tasks.task import Task

_FUNCTION_SHARE = 0.5  # of symbols in heads are functions: among many terminals there would be few (as geppy has it)
_CONSTANT_SHARE = 0.25  # of terminals are `?`, as of the leaves of trees
_LONGEST = 4  # a transposon has 1 to 4 symbols (EMOT, Table 2)
_TUNING_STEP = 0.1  # standard deviation of tuning, of the constants' range; chosen: the paper does not say
_ELITES = 1  # Ferreira 2001, section 4: simple elitism


@dataclass(frozen=True, eq=False)
class Chromosome:
    """One gene a joint.

    Attributes:
        symbols: Numbers of the symbols of head, tail and domain, shape (genes, h + t + t).
        constants: What `?` may stand for, shape (genes, constants).
    """

    symbols: Symbols
    constants: NDArray[np.float64]

    @cached_property
    def _content(self) -> bytes:
        return self.symbols.tobytes() + self.constants.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Chromosome) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)


class Genes:
    """Chromosomes as a representation; see `robolamp.evolve.representations.representation.Representation`.

    Symbols are numbered: primitives, terminals, `?`. In a domain a number is that of a constant.

    Args:
        task: Rates, lengths, selection, and the range of constants.
        terminals: What genes may read.
        joints: The joints' names: a gene each.
    """

    def __init__(self, task: Task, terminals: Sequence[str], joints: Sequence[str]) -> None:
        self._gp, self._gep, self._range = task.gp, task.gp.gep, task.constants
        self._joints, self._terminals = tuple(joints), tuple(terminals)
        self._names = (*PRIMITIVES, *terminals, CONSTANT)
        self._number = {name: number for number, name in enumerate(self._names)}
        self._arity = np.array([PRIMITIVES[name].arity if name in PRIMITIVES else 0 for name in self._names])
        self._head = self._gep.head
        self._body = self._head + tail_length(self._head)
        self._length = self._body + tail_length(self._head)

    def _drawn(self, rng: np.random.Generator, count: int) -> Symbols:
        """Draw symbols for every place of many chromosomes."""
        shape = (count, len(self._joints), self._length)
        functions = len(PRIMITIVES)
        leaf = rng.integers(functions, functions + len(self._terminals), size=shape)
        symbols = np.where(rng.random(shape) < _CONSTANT_SHARE, len(self._names) - 1, leaf)
        function = rng.integers(functions, size=shape)
        inner = (rng.random(shape) < _FUNCTION_SHARE) & (np.arange(self._length) < self._head)
        symbols = np.where(inner, function, symbols)
        numbers = rng.integers(self._gep.constants, size=shape)
        return np.where(np.arange(self._length) < self._body, symbols, numbers).astype(np.int16)

    def _drawn_constants(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        return np.round(rng.uniform(*self._range, (count, len(self._joints), self._gep.constants)), 4)

    def population(self, rng: np.random.Generator, count: int) -> list[Chromosome]:
        """Return a first generation, every symbol drawn at random."""
        symbols, constants = self._drawn(rng, count), self._drawn_constants(rng, count)
        return [Chromosome(symbols[index], constants[index]) for index in range(count)]

    def seeded(self, rng: np.random.Generator, phenotype: Genome, where: str) -> Chromosome:
        """Return a chromosome that expresses a controller; what is not expressed is drawn at random.

        Raises:
            ExpressionError: It needs a longer head or more constants than the task's genes have.
        """
        return self._carrying(self.population(rng, 1)[0], phenotype, where)

    def carrying(self, genotype: Chromosome, phenotype: Genome) -> Chromosome:
        """Return a chromosome that expresses other expressions; what is not expressed stays as it is."""
        return self._carrying(genotype, phenotype, "")

    def _carrying(self, genotype: Chromosome, phenotype: Genome, where: str) -> Chromosome:
        genes = []
        for joint, gene, expression in zip(self._joints, self._genes(genotype), phenotype, strict=True):
            try:
                genes.append(gene.carrying(expression))
            except ExpressionError as error:
                hint = "set gp.gep.head and gp.gep.constants so that it fits"
                raise ExpressionError(f"joints.{joint}: {error}; {hint}", where) from None
        return self._packed(genes)

    def plan(self, rng: np.random.Generator) -> Plan:
        """Draw the tournaments of everybody but the elite."""
        parents, tournaments = self._gp.population - _ELITES, None
        if self._gp.selection == "tournament":
            drawn = [draw_tournament(rng, self._gp.population, self._gp.tournament) for _ in range(parents)]
            tournaments = np.array(drawn, np.int64).reshape(parents, self._gp.tournament)
        return Plan(parents, tournaments, elites=_ELITES)

    def breed(
        self, rng: np.random.Generator, plan: Plan, parents: Sequence[Chromosome], count: int
    ) -> tuple[list[Chromosome], list[int]]:
        """Replicate the parents and apply every operator in turn, but for the elites (Ferreira 2001, Figure 1)."""
        symbols = np.stack([parent.symbols for parent in parents])
        constants = np.stack([parent.constants for parent in parents])
        self.vary(rng, symbols[plan.elites :], constants[plan.elites :])
        children = [Chromosome(symbols[index], constants[index]) for index in range(count)]
        return children, list(range(count))

    def vary(self, rng: np.random.Generator, symbols: Symbols, constants: NDArray[np.float64]) -> None:
        """Apply every operator in turn, in place: mutation, transpositions, recombinations, constants.

        Args:
            rng: Where randomness comes from.
            symbols: Shape (chromosomes, genes, h + t + t).
            constants: Shape (chromosomes, genes, constants).
        """
        rates = self._gep
        struck = rng.random(symbols.shape) < rates.mutation
        symbols[:] = np.where(struck, self._drawn(rng, len(symbols)), symbols)
        self._transpose(rng, symbols, rates.is_transposition, root=False)
        self._transpose(rng, symbols, rates.ris_transposition, root=True)
        self._transpose_genes(rng, symbols, constants)
        self._recombine(rng, symbols, constants)
        struck = rng.random(constants.shape) < rates.constant_mutation
        constants[:] = np.where(struck, self._drawn_constants(rng, len(constants)), constants)
        self._tune(rng, symbols, constants)

    def _transpose(self, rng: np.random.Generator, symbols: Symbols, rate: float, *, root: bool) -> None:
        rows = np.flatnonzero(rng.random(len(symbols)) < rate)
        count, genes = len(rows), len(self._joints)
        receiver = rng.integers(genes, size=count)
        donor = receiver if root else rng.integers(genes, size=count)
        length = rng.integers(1, _LONGEST + 1, size=count)
        if root:
            point = rng.integers(self._head, size=count)
            start = first_function(symbols[rows, donor, : self._head] < len(PRIMITIVES), point)
            place = np.zeros(count, np.int64)
        else:
            start = rng.integers(self._body - length + 1)
            place = rng.integers(1, self._head, size=count)
        sound = start >= 0
        rows, donor, receiver = rows[sound], donor[sound], receiver[sound]
        symbols[rows, receiver] = transposed(
            symbols[rows, receiver], symbols[rows, donor], start[sound], length[sound], place[sound], self._head
        )

    def _transpose_genes(self, rng: np.random.Generator, symbols: Symbols, constants: NDArray[np.float64]) -> None:
        rows = np.flatnonzero(rng.random(len(symbols)) < self._gep.gene_transposition)
        genes = len(self._joints)
        if genes > 1:
            order = brought_first(rng.integers(1, genes, size=len(rows)), genes)
            symbols[rows], constants[rows] = symbols[rows[:, None], order], constants[rows[:, None], order]

    def _recombine(self, rng: np.random.Generator, symbols: Symbols, constants: NDArray[np.float64]) -> None:
        genes, length = len(self._joints), self._length
        whole = genes * length
        for kind in ("one_point", "two_point", "gene_crossover"):
            order = rng.permutation(len(symbols))
            pairs = order[: 2 * (len(order) // 2)].reshape(-1, 2)
            pairs = pairs[rng.random(len(pairs)) < getattr(self._gep, kind)]
            count = len(pairs)
            if kind == "one_point":
                low, high = rng.integers(1, whole, size=count), np.full(count, whole)
            elif kind == "two_point":
                low, high = np.sort(rng.integers(whole + 1, size=(count, 2)), axis=1).T
            else:
                low = length * rng.integers(genes, size=count)
                high = low + length
            swap(symbols, constants, pairs[:, 0], pairs[:, 1], between(low, high, genes, length))

    def _tune(self, rng: np.random.Generator, symbols: Symbols, constants: NDArray[np.float64]) -> None:
        """Move one of the constants that a chromosome expresses."""
        body = symbols[:, :, : self._body]
        end = reading_frame(self._arity[body])
        used = ((body == len(self._names) - 1) & (np.arange(self._body) < end[:, :, None])).sum(axis=2)
        low, high = self._range
        for row in np.flatnonzero(rng.random(len(symbols)) < self._gep.constant_tuning):
            places = [(gene, place) for gene in range(used.shape[1]) for place in range(used[row, gene])]
            if places:
                gene, place = places[rng.integers(len(places))]
                number = symbols[row, gene, self._body + place]
                value = constants[row, gene, number]
                moved = value + _TUNING_STEP * (high - low) * rng.standard_normal()
                # A constant of a seed may lie outside the range: it may stay there, but goes no further.
                constants[row, gene, number] = float(f"{np.clip(moved, min(low, value), max(high, value)):.5g}")

    def _genes(self, genotype: Chromosome) -> list[Gene]:
        return [
            Gene(
                tuple(self._names[number] for number in symbols[: self._body]),
                tuple(symbols[self._body :].tolist()),
                tuple(constants.tolist()),
                self._head,
            )
            for symbols, constants in zip(genotype.symbols, genotype.constants, strict=True)
        ]

    def _packed(self, genes: Sequence[Gene]) -> Chromosome:
        symbols = [[*(self._number[symbol] for symbol in gene.symbols), *gene.domain] for gene in genes]
        return Chromosome(np.array(symbols, np.int16), np.array([gene.constants for gene in genes]))

    def decode(self, genotype: Chromosome) -> Genome:
        """Return what a chromosome expresses: one expression a joint."""
        return tuple(gene.expression for gene in self._genes(genotype))

    def dump(self, genotype: Chromosome) -> list[str]:
        """Return a chromosome as texts, a gene each."""
        return [str(gene) for gene in self._genes(genotype)]

    def load(self, texts: Sequence[str], where: str) -> Chromosome:
        """Return the chromosome that texts hold.

        Raises:
            ExpressionError: A gene does not parse, or is of other lengths than the task's.
        """
        genes = [parse_gene(text, self._terminals, where) for text in texts]
        shape = (len(self._joints), {(self._head, self._gep.constants)})
        if (len(genes), {(gene.head, len(gene.constants)) for gene in genes}) != shape:
            wanted = f"{len(self._joints)} with a head of {self._head} and {self._gep.constants} constants each"
            raise ExpressionError(f"genes are not those of the task: {wanted}", where)
        return self._packed(genes)

    def genes(self, genotype: Chromosome) -> Mapping[str, str]:
        """Return the text of each joint's gene."""
        return dict(zip(self._joints, self.dump(genotype), strict=True))
