"""The operators of gene expression programming on arrays of chromosomes (Ferreira 2001, section 5; EMOT, Table 2).

Random choices are made elsewhere: the functions here that take positions do one thing at given places. Symbols
have shape (chromosomes, genes, h + t + t): head, tail and domain of each gene, one after the other. A gene's constants
stand behind its domain: where a recombination takes over the end of a gene, it takes over its constants.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Symbols = NDArray[np.int16]
"""Numbers of symbols; see `robolamp.evolve.representations.gep.Alphabet`."""


def transposed(
    genes: Symbols, donors: Symbols, start: NDArray[np.int64], length: NDArray[np.int64], place: NDArray[np.int64],
    head: int,
) -> Symbols:  # fmt: skip
    """Insert a copy of a piece of one gene into the head of another; what is pushed out of the head is lost.

    With `place` 0 this is root transposition (RIS), else insertion-sequence transposition (IS).

    Args:
        genes: Genes to insert into, shape (n, h + t + t).
        donors: Genes that the pieces come from, shape (n, h + t + t).
        start: Where each piece begins, shape (n,).
        length: How long each is, shape (n,).
        place: Where each goes in the head, shape (n,).
        head: Length of the head, h.

    Returns:
        The changed genes, shape (n, h + t + t); tails and domains are as they were.
    """
    column = np.arange(head)[None, :]
    behind = column - place[:, None]
    inside = (behind >= 0) & (behind < length[:, None])
    piece = np.take_along_axis(donors, np.where(inside, start[:, None] + behind, 0), axis=1)
    shifted = np.take_along_axis(genes, np.where(behind >= length[:, None], column - length[:, None], column), axis=1)
    changed = genes.copy()
    changed[:, :head] = np.where(inside, piece, shifted)
    return changed


def first_function(is_function: NDArray[np.bool_], start: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first function at or after a place of each head; -1 where there is none.

    Args:
        is_function: Which symbols are functions, shape (n, h).
        start: Where to look from, shape (n,).
    """
    found = is_function & (np.arange(is_function.shape[1])[None, :] >= start[:, None])
    return np.where(found.any(axis=1), found.argmax(axis=1), -1)


def brought_first(gene: NDArray[np.int64], genes: int) -> NDArray[np.int64]:
    """Return the order of genes after one of them moved to the first place, shape (n, genes).

    Args:
        gene: Which moves, shape (n,).
        genes: Genes of a chromosome.
    """
    column = np.arange(genes)[None, :]
    return np.where(column == 0, gene[:, None], column - (column <= gene[:, None]))


def swap(
    symbols: Symbols, constants: NDArray[np.float64], first: NDArray[np.int64], second: NDArray[np.int64],
    mask: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Exchange parts of pairs of chromosomes, in place.

    Args:
        symbols: Of all chromosomes.
        constants: Of all chromosomes, shape (chromosomes, genes, constants).
        first: One of each pair, shape (n,).
        second: The other, shape (n,).
        mask: Which symbols change places, shape (n, genes, h + t + t); constants go with the last symbol of their gene.
    """
    for values, where in ((symbols, mask), (constants, mask[:, :, -1:])):
        one, other = values[first], values[second]
        values[first], values[second] = np.where(where, other, one), np.where(where, one, other)


def between(low: NDArray[np.int64], high: NDArray[np.int64], genes: int, length: int) -> NDArray[np.bool_]:
    """Return which symbols lie between two points of a chromosome, shape (n, genes, length).

    Args:
        low: The first of them, counted through all genes, shape (n,).
        high: The first that no longer does, shape (n,).
        genes: Genes of a chromosome.
        length: Symbols of a gene.
    """
    column = np.arange(genes * length)[None, :]
    return ((column >= low[:, None]) & (column < high[:, None])).reshape(-1, genes, length)


def reading_frame(arity: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many symbols each gene expresses: the length of its K-expression (Ferreira 2001, section 3.2).

    Args:
        arity: Of the symbols of heads and tails, shape (..., h + t).
    """
    ends = np.cumsum(arity, axis=-1) == np.arange(arity.shape[-1])
    return ends.argmax(axis=-1) + 1
