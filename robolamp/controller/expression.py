"""S-expressions: a parser whose errors point at the character, and a printer whose text parses back to the same tree.

An expression is a flat list of tokens in prefix order: primitives and terminals by name, constants as floats. The arity
of the primitives gives the tree, so a subtree is a slice.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from robolamp.controller.primitives import PRIMITIVES
from robolamp.errors import ExpressionError

Token = str | float
"""A primitive's or terminal's name, or a constant."""

_LEXEME = re.compile(r"\s*(?:(?P<comment>;[^\n]*)|(?P<paren>[()])|(?P<atom>[^\s();]+))")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")
_NESTING_LIMIT = 200  # far above any evolved tree (17), far below Python's recursion limit


def subtree_end(tokens: Sequence[Token], start: int) -> int:
    """Return the index just past the subtree that begins at start (a slice [start:end] is that subtree)."""
    need, index = 1, start
    while need:
        token = tokens[index]
        need += (PRIMITIVES[token].arity if isinstance(token, str) and token in PRIMITIVES else 0) - 1
        index += 1
    return index


def depth(tokens: Sequence[Token]) -> int:
    """Return a tree's depth: 0 for a single terminal or constant (Koza 1992, section 6.2)."""
    deepest, pending = 0, [0]
    for token in tokens:
        level = pending.pop()
        deepest = max(deepest, level)
        if isinstance(token, str) and token in PRIMITIVES:
            pending.extend([level + 1] * PRIMITIVES[token].arity)
    return deepest


@dataclass(frozen=True)
class Expression:
    """One joint's controller.

    Attributes:
        tokens: The tree in prefix order.
    """

    tokens: tuple[Token, ...]

    @property
    def terminals(self) -> frozenset[str]:
        """Names of the terminals it reads."""
        return frozenset(token for token in self.tokens if isinstance(token, str) and token not in PRIMITIVES)

    def __str__(self) -> str:
        parts: list[str] = []
        closing: list[int] = []  # arguments still to come of each open list
        for token in self.tokens:
            if parts:
                parts.append(" ")
            if isinstance(token, str) and token in PRIMITIVES:
                parts.append(f"({token}")
                closing.append(PRIMITIVES[token].arity)
                continue
            parts.append(token if isinstance(token, str) else _number(token))
            while closing:
                closing[-1] -= 1
                if closing[-1]:
                    break
                closing.pop()
                parts.append(")")
        return "".join(parts)


def _number(value: float) -> str:
    text = repr(value)
    return text.removesuffix(".0") if abs(value) < 1e15 else text


class _Reader:
    def __init__(self, text: str, terminals: Iterable[str], where: str) -> None:
        self.text = text
        self.where = where
        self.terminals = tuple(terminals)
        self.lexemes: list[tuple[str, int]] = []
        position = 0
        while position < len(text):
            match = _LEXEME.match(text, position)
            if match is None:  # only white space is left
                break
            position = match.end()
            if match["comment"] is None:
                lexeme = match["paren"] or match["atom"]
                self.lexemes.append((lexeme, match.end() - len(lexeme)))
        self.index = 0

    def fail(self, expected: str, position: int | None = None) -> ExpressionError:
        at = len(self.text) if position is None else position
        line = self.text.count("\n", 0, at) + 1
        column = at - (self.text.rfind("\n", 0, at) + 1) + 1
        match = None if position is None else _LEXEME.match(self.text, position)
        found = "the end" if match is None else repr(match.group().strip()[:40])
        return ExpressionError(f"found {found} at line {line}, column {column}; expected {expected}", self.where)

    def next(self, expected: str) -> tuple[str, int]:
        if self.index >= len(self.lexemes):
            raise self.fail(expected)
        lexeme = self.lexemes[self.index]
        self.index += 1
        return lexeme

    def peek(self) -> str | None:
        return self.lexemes[self.index][0] if self.index < len(self.lexemes) else None

    def expression(self, tokens: list[Token], nesting: int = 0) -> None:
        lexeme, position = self.next("an expression")
        if lexeme == "(":
            if nesting >= _NESTING_LIMIT:
                raise self.fail(f"no more than {_NESTING_LIMIT} nested lists", position)
            functions = f"a function ({' '.join(PRIMITIVES)})"
            name, at = self.next(functions)
            if name not in PRIMITIVES:
                raise self.fail(functions, at)
            tokens.append(name)
            arity = PRIMITIVES[name].arity
            for count in range(arity):
                if self.peek() == ")":
                    raise self.fail(f"{arity} arguments of {name}, not {count}", self.lexemes[self.index][1])
                self.expression(tokens, nesting + 1)
            closing, at = self.next(f"`)` after {arity} arguments of {name}")
            if closing != ")":
                raise self.fail(f"`)` after {arity} arguments of {name}", at)
        elif lexeme == ")":
            raise self.fail("an expression", position)
        elif _NUMBER.match(lexeme):
            value = float(lexeme)
            if not math.isfinite(value):
                raise self.fail("a number that fits a double", position)
            tokens.append(value)
        elif lexeme in self.terminals:
            tokens.append(lexeme)
        else:
            raise self.fail(f"a number, a list, or a terminal ({' '.join(self.terminals)})", position)


def parse(text: str, terminals: Iterable[str], where: str = "") -> Expression:
    """Return the expression that a text holds.

    Args:
        text: One S-expression; `;` starts a comment.
        terminals: Names it may read.
        where: What the text came from, for messages.

    Raises:
        ExpressionError: It does not parse; the message gives line, column, what was found and what was expected.
    """
    reader = _Reader(text, terminals, where)
    tokens: list[Token] = []
    reader.expression(tokens)
    if reader.peek() is not None:
        raise reader.fail("nothing after the expression", reader.lexemes[reader.index][1])
    return Expression(tuple(tokens))


def parse_list(text: str, terminals: Iterable[str], where: str = "") -> tuple[Expression, ...]:
    """Return the expressions of `(list e1 e2 ...)`, one a joint (Gritz & Hahn 1997, Figure 2).

    Args:
        text: A list of S-expressions, or one S-expression.
        terminals: Names they may read.
        where: What the text came from, for messages.

    Raises:
        ExpressionError: It does not parse; the message gives line, column, what was found and what was expected.
    """
    reader = _Reader(text, terminals, where)
    words = [lexeme for lexeme, _ in reader.lexemes[:2]]
    if words != ["(", "list"]:
        return (parse(text, reader.terminals, where),)
    reader.index = 2
    expressions: list[Expression] = []
    while reader.peek() != ")":
        tokens: list[Token] = []
        reader.expression(tokens, 1)
        expressions.append(Expression(tuple(tokens)))
    reader.index += 1
    if reader.peek() is not None:
        raise reader.fail("nothing after the list", reader.lexemes[reader.index][1])
    if not expressions:
        raise reader.fail("one expression a joint", reader.lexemes[reader.index - 1][1])
    return tuple(expressions)
