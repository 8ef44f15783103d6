"""Parameters of gene expression programming: the table [gp.gep] of a task."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from robolamp.controller.gene import HEADS
from robolamp.files import Table


@dataclass(frozen=True)
class GepSettings:
    """Parameters of gene expression programming; the defaults are EMOT's (Kwasnicka & Wozniak, Table 2).

    Rates are those of Ferreira (2001, section 5): of symbols for mutation, of constants for their mutation, of
    chromosomes for everything else.

    Attributes:
        head: Length of a gene's head.
        constants: Constants of a gene; 10 are chosen, as Ferreira (2006, section 5.3) has it: the paper does not say.
        mutation: Of a symbol into any that may stand there.
        is_transposition: Of a piece of a gene into a head, behind its root.
        ris_transposition: Of a piece that begins with a function to the root of its gene.
        gene_transposition: Of a whole gene to the first place.
        one_point: Recombination of a pair, at one point.
        two_point: ... between two points.
        gene_crossover: ... of one whole gene.
        constant_mutation: Of a constant into any of the task's range.
        constant_tuning: Of one constant that is expressed, by a Gaussian step of 0.1 x the range.
    """

    head: int = 10
    constants: int = 10
    mutation: float = 0.01
    is_transposition: float = 0.1
    ris_transposition: float = 0.1
    gene_transposition: float = 0.05
    one_point: float = 0.2
    two_point: float = 0.5
    gene_crossover: float = 0.1
    constant_mutation: float = 0.05
    constant_tuning: float = 0.9


_LENGTHS = {"head": HEADS, "constants": (1, 1000)}


def read_gep(table: Table) -> GepSettings:
    """Read [gp.gep]; every key may be left out.

    Raises:
        FileError: A key is unknown or out of range; the message says what was expected.
    """
    lengths = {
        name: table.integer(name, *legal, default=getattr(GepSettings, name)) for name, legal in _LENGTHS.items()
    }
    rates: dict[str, Any] = {
        field.name: table.number(field.name, 0.0, 1.0, default=field.default)
        for field in fields(GepSettings)
        if field.name not in _LENGTHS
    }
    table.done()
    return GepSettings(**lengths, **rates)
