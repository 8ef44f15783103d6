"""Genes: expressions in the linear form of gene expression programming (Ferreira 2001; EMOT, section 4.2 and Figure 2).

A gene is a head of any symbols, a tail of terminals, a domain, and constants. Read from its start, head and tail hold a
K-expression: the nodes of a tree level by level. Where the K-expression ends, the rest is not expressed. The symbol `?`
stands for a constant: the first `?` that is expressed takes the constant whose number is first in the domain, and so on
(Ferreira 2006, chapter 5). A tail of 2 h + 1 symbols for a head of h has room for the arguments of any head, because no
primitive takes more than three.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from robolamp.controller.expression import Expression, Token, subtree_end
from robolamp.controller.primitives import PRIMITIVES
from robolamp.errors import ExpressionError

CONSTANT = "?"
"""The symbol that stands for a constant."""
HEADS = (2, 150)
"""Shortest and longest head: a transposon goes behind the root, and what is expressed must be readable as a file."""
_ARITY = max(primitive.arity for primitive in PRIMITIVES.values())
_PARTS = ("head", "tail", "domain", "constants")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")


def tail_length(head: int) -> int:
    """Return how long a tail is: h (n - 1) + 1, n being the longest arity, 3 (Ferreira 2001, equation 3.4)."""
    return head * (_ARITY - 1) + 1


def _arity(symbol: str) -> int:
    return PRIMITIVES[symbol].arity if symbol in PRIMITIVES else 0


def expressed(symbols: Sequence[str]) -> int:
    """Return how many of a gene's symbols its K-expression takes: its open reading frame."""
    end = 1
    for index, symbol in enumerate(symbols):
        if index == end:
            break
        end += _arity(symbol)
    return end


@dataclass(frozen=True)
class Gene:
    """One joint's gene.

    Attributes:
        symbols: Head and tail: names of primitives and terminals, and `?`, shape (h + 2 h + 1,).
        domain: Numbers of constants, as many as the tail has symbols.
        constants: What `?` may stand for.
        head: Length of the head, h.
    """

    symbols: tuple[str, ...]
    domain: tuple[int, ...]
    constants: tuple[float, ...]
    head: int

    @property
    def expression(self) -> Expression:
        """The tree that the gene expresses."""
        end = expressed(self.symbols)
        supply = iter(self.domain)
        nodes: list[Token] = [
            self.constants[next(supply)] if symbol == CONSTANT else symbol for symbol in self.symbols[:end]
        ]
        first, children = 1, []
        for symbol in self.symbols[:end]:
            children.append(range(first, first + _arity(symbol)))
            first = children[-1].stop
        tokens, pending = [], [0]
        while pending:
            node = pending.pop()
            tokens.append(nodes[node])
            pending.extend(reversed(children[node]))
        return Expression(tuple(tokens))

    def __str__(self) -> str:
        parts = (
            self.symbols[: self.head],
            self.symbols[self.head :],
            (str(number) for number in self.domain),
            (str(Expression((value,))) for value in self.constants),
        )
        return " | ".join(" ".join(part) for part in parts)

    def carrying(self, expression: Expression, where: str = "") -> Gene:
        """Return this gene with another tree expressed; what is not expressed stays as it is.

        Args:
            expression: The tree.
            where: What it came from, for the message.

        Raises:
            ExpressionError: It does not fit: it needs a longer head, or more different constants.
        """
        level, symbols, values = [0], [], []
        tokens = expression.tokens
        while level:
            below: list[int] = []
            for at in level:
                token = tokens[at]
                symbols.append(token if isinstance(token, str) else CONSTANT)
                if not isinstance(token, str):
                    values.append(token)
                child = at + 1
                for _ in range(_arity(symbols[-1])):
                    below.append(child)
                    child = subtree_end(tokens, child)
            level = below
        head = 1 + max((index for index, symbol in enumerate(symbols) if symbol in PRIMITIVES), default=-1)
        different = list(dict.fromkeys(values))
        if head > self.head:
            raise ExpressionError(f"needs a head of {head} symbols; a gene has one of {self.head}", where)
        if len(different) > len(self.constants):
            raise ExpressionError(f"needs {len(different)} constants; a gene has {len(self.constants)}", where)
        numbers = tuple(different.index(value) for value in values)
        return Gene(
            (*symbols, *self.symbols[len(symbols) :]),
            (*numbers, *self.domain[len(numbers) :]),
            (*different, *self.constants[len(different) :]),
            self.head,
        )


def parse_gene(text: str, terminals: Iterable[str], where: str = "") -> Gene:
    """Return the gene that a text holds: head | tail | domain | constants, symbols with spaces between.

    Args:
        text: As `str` of a gene gives it.
        terminals: Names it may read.
        where: What the text came from, for messages.

    Raises:
        ExpressionError: It is no gene; the message gives the part, the symbol, what was found and what was expected.
    """
    known = (*terminals, CONSTANT)
    parts = [part.split() for part in text.split("|")]
    if len(parts) != len(_PARTS):
        raise ExpressionError(f"has {len(parts)} parts with | between; expected 4: {' | '.join(_PARTS)}", where)
    head, tail, domain, constants = parts
    if not HEADS[0] <= len(head) <= HEADS[1]:
        raise ExpressionError(f"head: {len(head)} symbols; expected {HEADS[0]} to {HEADS[1]}", where)
    length = tail_length(len(head))
    for name, part in (("tail", tail), ("domain", domain)):
        if len(part) != length:
            expected = f"expected 2 x {len(head)} + 1 = {length} for a head of {len(head)}"
            raise ExpressionError(f"{name}: {len(part)} symbols; {expected}", where)
    if not constants:
        raise ExpressionError("constants: none; expected one at least", where)
    for name, part, legal in (("head", head, (*PRIMITIVES, *known)), ("tail", tail, known)):
        for number, symbol in enumerate(part, 1):
            if symbol not in legal:
                kind = "a terminal" if name == "tail" else "a function or a terminal"
                found = f"{name}: {symbol[:40]!r} is symbol {number}"
                raise ExpressionError(f"{found}; expected {kind} ({' '.join(legal)})", where)
    numbers = []
    for number, symbol in enumerate(domain, 1):
        if not (symbol.isascii() and symbol.isdigit() and int(symbol[:9]) < len(constants)):
            found = f"domain: {symbol[:40]!r} is symbol {number}"
            raise ExpressionError(f"{found}; expected the number of a constant, 0 to {len(constants) - 1}", where)
        numbers.append(int(symbol[:9]))
    values = []
    for number, symbol in enumerate(constants, 1):
        if not _NUMBER.match(symbol) or not math.isfinite(float(symbol)):
            raise ExpressionError(f"constants: {symbol[:40]!r} is symbol {number}; expected a finite number", where)
        values.append(float(symbol))
    return Gene((*head, *tail), tuple(numbers), tuple(values), len(head))
