"""Simplification that keeps the protected semantics: the same double for whatever the terminals can be.

Terminals are finite and inside their ranges (`robolamp.controller.interval.RANGES`); what is computed from them may
overflow or be NaN, so algebra holds only where intervals prove that it does: (- x x) is 0 unless x can be infinite.
Only the sign of a zero may change, which no primitive can tell. Sums are not reassociated: that would round elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from robolamp.controller import interval
from robolamp.controller.expression import Expression, Token
from robolamp.controller.interval import EVERYTHING, FINITE, RANGES, WHOLE, Interval
from robolamp.controller.primitives import PRIMITIVES

_Node = Token | tuple
"""A constant, a terminal, or (primitive, argument, ...)."""
_Facts = Mapping[_Node, Interval]
"""What is known of subexpressions inside a branch, because of the condition that led there."""

_INFINITE = math.inf
_NEGATIVE: Interval = (-_INFINITE, interval.below(0.0), False)
_POSITIVE: Interval = (interval.above(0.0), _INFINITE, False)
_NOT_NEGATIVE: Interval = (0.0, _INFINITE, True)
_NOT_POSITIVE: Interval = (-_INFINITE, 0.0, True)
_ARITHMETIC = {"+": interval.add, "-": interval.subtract, "*": interval.multiply, "%": interval.divide}


def simplify(expression: Expression) -> Expression:
    """Return an expression that gives the same values with no more nodes; equal ones for many that are alike.

    Constants are folded as the interpreters compute, identities of the four operations applied, arguments of sums and
    products put into one order, and branches dropped that cannot be taken: because of the ranges of the terminals, or
    of the conditions of the branches around them.

    Args:
        expression: What to simplify.
    """
    node, _ = _simplified(_tree(expression.tokens), {})
    tokens: list[Token] = []
    _flatten(node, tokens)
    return Expression(tuple(tokens))


def _tree(tokens: Sequence[Token]) -> _Node:
    stack: list[_Node] = []
    for token in reversed(tokens):
        own = PRIMITIVES.get(token) if isinstance(token, str) else None
        if own is None:
            stack.append(token)
        elif own.arity == 2:
            stack.append((token, stack.pop(), stack.pop()))
        else:
            stack.append((token, *(stack.pop() for _ in range(own.arity))))
    return stack[0]


def _flatten(node: _Node, tokens: list[Token]) -> None:
    if isinstance(node, tuple):
        tokens.append(node[0])
        for part in node[1:]:
            _flatten(part, tokens)
    else:
        tokens.append(node)


def _simplified(node: _Node, facts: _Facts) -> tuple[_Node, Interval]:
    """Return a simpler node and what it can be."""
    if isinstance(node, str):
        return _narrowed(node, RANGES.get(node, FINITE), facts)
    if not isinstance(node, tuple):
        return node + 0.0, (node, node, False)  # -0.0 + 0.0 is 0.0
    if len(node) == 4:
        return _branched(node, facts)
    operator = node[0]
    (a, a_values), (b, b_values) = _simplified(node[1], facts), _simplified(node[2], facts)
    values = _ARITHMETIC[operator](a_values, b_values)
    if a == b:
        values = _of_equals(operator, values)
    if values[0] == values[1] and not values[2] and -_INFINITE < values[0] < _INFINITE:
        return values[0] + 0.0, values
    simple = _operation(operator, a, b, values[2])
    if not isinstance(simple, tuple):  # more may be known of it than of what it came from
        return _simplified(simple, facts)
    return _narrowed(simple, values, facts) if facts else (simple, values)


def _narrowed(node: _Node, values: Interval, facts: _Facts) -> tuple[_Node, Interval]:
    """Apply what is known of a node; a value that is the only possible one is a constant."""
    known = facts.get(node) if facts else None
    if known is not None:
        values = interval.both(values, known)
        if values[0] == values[1] and not values[2] and -_INFINITE < values[0] < _INFINITE:
            return values[0] + 0.0, values
    return node, values


def _of_equals(operator: str, values: Interval) -> Interval:
    """Return what an operation on two equal arguments can be, which their ranges alone do not tell."""
    if operator == "-":
        return 0.0, 0.0, values[2]
    if operator == "%":
        return 1.0, 1.0, values[2]
    return values if operator == "+" else (max(values[0], 0.0), values[1], values[2])


def _operation(operator: str, a: _Node, b: _Node, nan: bool) -> _Node:
    """Return the shortest node for an operation of two simple ones; `nan` tells whether its value may be NaN."""
    if operator == "+":
        if a == 0.0:
            return b
        if b == 0.0:
            return a
        if a == b:
            return _operation("*", 2.0, a, nan)
        if (negated := _negated(b)) is not None:
            return _operation("-", a, negated, nan)
        if (negated := _negated(a)) is not None:
            return _operation("-", b, negated, nan)
    elif operator == "-":
        if b == 0.0:
            return a
        if a == b and not nan:
            return 0.0
        if (negated := _negated(b)) is not None:
            return _operation("+", a, negated, nan)
        if a == 0.0 and isinstance(b, tuple):
            if b[0] == "-":
                return _operation("-", b[2], b[1], nan)
            if b[0] == "*" and isinstance(b[1], float):
                return _operation("*", 0.0 - b[1], b[2], nan)
        return operator, a, b
    elif operator == "%":
        if b == 1.0:
            return a
        return _operation("-", 0.0, a, nan) if b == -1.0 else (operator, a, b)
    elif a in (1.0, -1.0):
        return b if a == 1.0 else _operation("-", 0.0, b, nan)
    elif b in (1.0, -1.0):
        return a if b == 1.0 else _operation("-", 0.0, a, nan)
    return (operator, b, a) if _comes_before(b, a) else (operator, a, b)


def _negated(node: _Node) -> _Node | None:
    """Return x where the node is (- 0 x)."""
    return node[2] if isinstance(node, tuple) and node[0] == "-" and node[1] == 0.0 else None


def _comes_before(a: _Node, b: _Node) -> bool:
    """Tell whether a comes first in the order of arguments: constants, terminals, operations."""
    try:
        return a < b  # type: ignore[operator]
    except TypeError:  # of different kinds, or somewhere inside
        kinds = [0 if isinstance(node, float) else 1 if isinstance(node, str) else 2 for node in (a, b)]
        return kinds[0] < kinds[1] if kinds[0] != kinds[1] else repr(a) < repr(b)


def _branched(node: tuple, facts: _Facts) -> tuple[_Node, Interval]:
    """Simplify (ifltz condition negative otherwise)."""
    condition, values = _simplified(node[1], facts)
    if values[1] < 0.0 and not values[2]:
        return _simplified(node[2], facts)
    if values[0] >= 0.0 or node[2] == node[3]:  # NaN is not below 0 either
        return _simplified(node[3], facts)
    condition = _at_whole_numbers(condition)
    if_negative, if_not = dict(facts), dict(facts)
    _assume(condition, if_negative, if_not)
    (a, a_values), (b, b_values) = _simplified(node[2], if_negative), _simplified(node[3], if_not)
    values = interval.union(a_values, b_values)
    return _narrowed(a if a == b else ("ifltz", condition, a, b), values, facts)


def _at_whole_numbers(condition: _Node) -> _Node:
    """Return a condition with the same sign, its threshold for a whole number made whole: hops < 2.3 is hops < 3."""
    if not isinstance(condition, tuple) or condition[0] not in "+-":
        return condition
    operator, a, b = condition
    if operator == "+" and b in WHOLE and isinstance(a, float):
        return "-", b, float(math.ceil(-a)) + 0.0
    if operator == "-" and a in WHOLE and isinstance(b, float):
        return "-", a, float(math.ceil(b)) + 0.0
    if operator == "-" and b in WHOLE and isinstance(a, float):
        return "-", float(math.floor(a)) + 0.0, b
    return condition


def _assume(condition: _Node, negative: dict[_Node, Interval], otherwise: dict[_Node, Interval]) -> None:
    """Add what follows where a condition is below 0, and where it is not.

    A difference of doubles has the sign of the exact one (it cannot underflow to 0), so a - b < 0 just where a < b.
    """
    _learn(negative, condition, _NEGATIVE)
    _learn(otherwise, condition, _NOT_NEGATIVE)
    if not isinstance(condition, tuple) or condition[0] not in "+-":
        return
    operator, a, b = condition
    (a_low, a_high, a_nan), (b_low, b_high, b_nan) = _leaf_range(a, negative), _leaf_range(b, negative)
    if operator == "-":
        _learn(negative, ("-", b, a), _POSITIVE)
        _learn(otherwise, ("-", b, a), _NOT_POSITIVE)
        _learn(negative, a, (-_INFINITE, interval.below(b_high), False))
        _learn(negative, b, (interval.above(a_low), _INFINITE, False))
        if not b_nan:
            _learn(otherwise, a, (b_low, _INFINITE, True))
        if not a_nan:
            _learn(otherwise, b, (-_INFINITE, a_high, True))
    else:
        _learn(negative, a, (-_INFINITE, interval.below(-b_low), False))
        _learn(negative, b, (-_INFINITE, interval.below(-a_low), False))
        if not b_nan:
            _learn(otherwise, a, (-b_high, _INFINITE, True))
        if not a_nan:
            _learn(otherwise, b, (-a_high, _INFINITE, True))


def _leaf_range(node: _Node, facts: _Facts) -> Interval:
    if isinstance(node, float):
        return node, node, False
    if isinstance(node, str):
        return _narrowed(node, RANGES.get(node, FINITE), facts)[1]
    return EVERYTHING


def _learn(facts: dict[_Node, Interval], node: _Node, values: Interval) -> None:
    if isinstance(node, float):
        return
    known = facts.get(node, RANGES.get(node, FINITE) if isinstance(node, str) else EVERYTHING)
    values = interval.both(known, values)
    facts[node] = interval.whole(values) if node in WHOLE else values
