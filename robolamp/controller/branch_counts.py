"""Branches: how often each side of each `ifltz` is taken, over recorded signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.expression import Expression, subtree_end
from robolamp.controller.primitives import PRIMITIVES


@dataclass(frozen=True)
class Branch:
    """One `ifltz` of an expression.

    Attributes:
        index: Its token in the expression.
        negative: Ticks at which its second argument was taken.
        otherwise: Ticks at which its third argument was taken.
    """

    index: int
    negative: int
    otherwise: int


def count_branches(expression: Expression, terminals: Sequence[str], inputs: NDArray[np.float64]) -> tuple[Branch, ...]:
    """Count, for each `ifltz`, how often each side of it gave the value; what was not asked for is not counted.

    Args:
        expression: What to evaluate.
        terminals: Names of the inputs; all that it reads.
        inputs: Terminal values, shape (ticks, terminals).

    Returns:
        One for each `ifltz`, in the order they are written.
    """
    columns = {name: inputs[:, index] for index, name in enumerate(terminals)}
    taken = {index: np.zeros(len(inputs), np.int8) for index, token in enumerate(expression.tokens) if token == "ifltz"}
    with np.errstate(all="ignore"):  # controllers may overflow and divide as they like
        _evaluate(expression, 0, np.arange(len(inputs)), columns, taken)
    return tuple(Branch(index, int((sides < 0).sum()), int((sides > 0).sum())) for index, sides in taken.items())


def _evaluate(
    expression: Expression,
    start: int,
    ticks: NDArray[np.int64],
    columns: dict[str, NDArray[np.float64]],
    taken: dict[int, NDArray[np.int8]],
) -> NDArray[np.float64]:
    """Return the value of the subtree at `start` at some ticks; each `ifltz` in it notes which side it took there."""
    tokens = expression.tokens
    token = tokens[start]
    if not isinstance(token, str):
        return np.full(len(ticks), token)
    if token not in PRIMITIVES:
        return columns[token][ticks]
    first = start + 1
    second = subtree_end(tokens, first)
    a = _evaluate(expression, first, ticks, columns, taken)
    if token == "ifltz":
        negative = a < 0.0
        taken[start][ticks] = np.where(negative, -1, 1)
        values = np.empty(len(ticks))
        values[negative] = _evaluate(expression, second, ticks[negative], columns, taken)
        third = subtree_end(tokens, second)
        values[~negative] = _evaluate(expression, third, ticks[~negative], columns, taken)
        return values
    b = _evaluate(expression, second, ticks, columns, taken)
    if token == "%":
        return np.where(b == 0.0, 1.0, a / b)
    return {"+": np.add, "-": np.subtract, "*": np.multiply}[token](a, b)
