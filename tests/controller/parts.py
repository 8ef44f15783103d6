"""Random expressions, and an evaluator of them that shares nothing with the interpreters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from hypothesis import strategies as st

from robolamp.assets import Assets
from robolamp.controller.expression import Expression, Token
from robolamp.controller.terminals import all_terminals
from robolamp.lamp import load_lamp

LAMP = load_lamp(Assets())
TERMINALS = all_terminals(3)
ARITY = {"+": 2, "-": 2, "*": 2, "%": 2, "ifltz": 3}

NASTY = (
    0.0, -0.0, 1.0, -1.0, 0.1, 1e300, -1e300, 1e-300, 5e-324, -5e-324, 2.2e-308,
    float("inf"), float("-inf"), float("nan"),
)  # fmt: skip

_constants = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.integers(-9, 9).map(float), st.just(-0.0))
_leaves = st.one_of(st.sampled_from(TERMINALS), _constants).map(lambda token: (token,))


def _branches(children: st.SearchStrategy[tuple[Token, ...]]) -> st.SearchStrategy[tuple[Token, ...]]:
    def node(name: str) -> st.SearchStrategy[tuple[Token, ...]]:
        parts = st.tuples(*[children] * ARITY[name])
        return parts.map(lambda parts: (name, *(token for part in parts for token in part)))

    return st.sampled_from(list(ARITY)).flatmap(node)


expressions = st.recursive(_leaves, _branches, max_leaves=40).map(Expression)
signal = st.one_of(st.sampled_from(NASTY), st.floats(), st.floats(-2, 2))


def random_tokens(rng: np.random.Generator, depth: int) -> tuple[Token, ...]:
    """A tree of at most that depth, thin and bushy ones alike."""
    if depth == 0 or rng.random() < 0.2:
        pick = rng.random()
        if pick < 0.6:
            return (TERMINALS[rng.integers(len(TERMINALS))],)
        if pick < 0.9:
            return (float(rng.normal()),)
        return (float(rng.choice([v for v in NASTY if np.isfinite(v)])),)
    name = list(ARITY)[rng.integers(len(ARITY))]
    tokens: list[Token] = [name]
    for _ in range(ARITY[name]):
        tokens += random_tokens(rng, depth - 1)
    return tuple(tokens)


def evaluate(tokens: Sequence[Token], signals: Mapping[str, float]) -> float:
    """The value of a tree, by recursion; only the branch of `ifltz` that is taken is evaluated."""

    def tree(index: int) -> tuple[object, int]:
        token = tokens[index]
        if not isinstance(token, str) or token not in ARITY:
            return token, index + 1
        parts, index = [], index + 1
        for _ in range(ARITY[token]):
            part, index = tree(index)
            parts.append(part)
        return (token, parts), index

    def value(node: object) -> float:
        if isinstance(node, float):
            return node
        if isinstance(node, str):
            return signals[node]
        name, parts = node  # type: ignore[misc]
        if name == "ifltz":
            return value(parts[1]) if value(parts[0]) < 0 else value(parts[2])
        a, b = value(parts[0]), value(parts[1])
        if name == "%":
            return a / b if b != 0 else 1.0
        return {"+": float.__add__, "-": float.__sub__, "*": float.__mul__}[name](a, b)

    root, end = tree(0)
    assert end == len(tokens)
    return value(root)


def bits(values: object) -> np.ndarray:
    """Doubles as integers, every NaN alike: equal where the values are equal to the bit."""
    array = np.array(values, float)
    return np.where(np.isnan(array), np.int64(-1), array.view(np.int64))
