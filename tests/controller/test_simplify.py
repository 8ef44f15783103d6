"""Simplification: never another value, never more nodes, and what a reader would expect of it."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.expression import Expression, parse
from robolamp.controller.interval import RANGES, WHOLE
from robolamp.controller.program import Program, ProgramSet, compile_program
from robolamp.controller.simplify import simplify

from .parts import NASTY, TERMINALS, bits, evaluate, expressions

READ = ("t", "a0", "a1", "contact", "hops", "goal_dist")  # few, so that subtrees repeat
FINITE = [value for value in NASTY if np.isfinite(value)]


def tree(rng: np.random.Generator, depth: int) -> tuple[str | float, ...]:
    """A tree full of what there are rules for: conditions on a threshold, ones and zeros, the same thing twice."""
    if depth == 0 or rng.random() < 0.15:
        pick = rng.random()
        if pick < 0.6:
            return (READ[rng.integers(len(READ))],)
        return (float(rng.choice([*FINITE, 2.0, 0.5])) if pick < 0.8 else round(float(rng.normal()), 1),)
    name = str(rng.choice(["+", "-", "*", "%", "ifltz"], p=[0.15, 0.3, 0.15, 0.1, 0.3]))
    if name != "ifltz":
        left = tree(rng, depth - 1)
        return (name, *left, *(left if rng.random() < 0.1 else tree(rng, depth - 1)))
    condition = ("-", *tree(rng, 0), *tree(rng, 0)) if rng.random() < 0.4 else tree(rng, depth - 1)
    return (name, *condition, *tree(rng, depth - 1), *tree(rng, depth - 1))


def signals(rng: np.random.Generator, lanes: int) -> np.ndarray:
    """Terminal values of every size, inside their ranges, shape (lanes, len(READ))."""
    sizes = 10.0 ** rng.integers(-320, 308, (lanes, len(READ)))
    plain = rng.normal(size=(lanes, len(READ)))
    values = np.where(rng.random(plain.shape) < 0.5, plain, plain * sizes)
    values = np.where(rng.random(plain.shape) < 0.4, rng.choice(FINITE, plain.shape), values)
    for column, name in enumerate(READ):
        if name in WHOLE:
            values[:, column] = rng.integers(0, 2 if name == "contact" else 6, lanes)
        elif name in RANGES:
            values[:, column] = np.maximum(np.abs(values[:, column]), RANGES[name][0])
    return values


def run(programs: list[Program], inputs: np.ndarray) -> np.ndarray:
    """Every program on every row, shape (programs, rows); zeros are positive."""
    program = np.repeat(np.arange(len(programs)), len(inputs))
    rows = np.tile(inputs, (len(programs), 1))
    outputs = ProgramSet(programs).run(program, rows, np.empty((len(rows), 1)))
    return outputs.reshape(len(programs), -1) + 0.0


@pytest.mark.parametrize("seed", range(4))
def test_thousands_of_expressions_keep_their_value_to_the_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before = [Expression(tree(rng, int(rng.integers(1, 7)))) for _ in range(1000)]
    after = [simplify(expression) for expression in before]
    inputs = signals(rng, 200)
    first, second = (run([compile_program([part], READ) for part in parts], inputs) for parts in (before, after))
    wrong = np.flatnonzero((bits(first) != bits(second)).any(axis=1))
    assert not len(wrong), f"{before[wrong[0]]} became {after[wrong[0]]}"
    assert np.isnan(first).any()
    assert np.isinf(first).any()
    assert all(len(b.tokens) <= len(a.tokens) for a, b in zip(before, after, strict=True))
    assert sum(len(part.tokens) for part in after) < 0.7 * sum(len(part.tokens) for part in before)
    assert [simplify(part) for part in after] == after


_values = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.floats(-2, 2), st.sampled_from(FINITE))


@given(expressions, st.lists(_values, min_size=len(TERMINALS), max_size=len(TERMINALS)))
def test_any_expression_keeps_its_value_on_any_finite_signals(expression: Expression, values: list[float]) -> None:
    named = dict(zip(TERMINALS, values, strict=True))
    for name, (low, high, _) in RANGES.items():
        named[name] = min(max(abs(named[name]), low), high)
    for name in WHOLE:
        named[name] = float(np.floor(named[name]))
    simple = simplify(expression)
    expected, found = evaluate(expression.tokens, named) + 0.0, evaluate(simple.tokens, named) + 0.0
    assert bits([found]).tolist() == bits([expected]).tolist()
    ran = compile_program([simple], TERMINALS).run([named[name] for name in TERMINALS])[0] + 0.0
    assert bits([ran]).tolist() == bits([expected]).tolist()
    assert parse(str(simple), TERMINALS) == simple


@pytest.mark.parametrize(
    ("text", "simple"),
    [
        ("(+ t 0)", "t"),
        ("(- t -0)", "t"),
        ("(* 1 t)", "t"),
        ("(% t 1)", "t"),
        ("(% (- a0 a1) 0)", "1"),
        ("(% a0 a0)", "1"),
        ("(% 0 goal_dist)", "0"),  # never 0: it is commanded
        ("(% 0 a0)", "(% 0 a0)"),  # 1 where a0 is 0
        ("(- a0 a0)", "0"),
        ("(* 0 a0)", "0"),
        ("(- (* a0 a0) (* a0 a0))", "(- (* a0 a0) (* a0 a0))"),  # NaN where the square overflows
        ("(* 0 (* a0 a1))", "(* 0 (* a0 a1))"),
        ("(- 0 (- a0 a1))", "(- a1 a0)"),
        ("(- a0 (- 0 a1))", "(+ a0 a1)"),
        ("(+ (- 0 a0) a1)", "(- a1 a0)"),
        ("(+ a1 a0)", "(+ a0 a1)"),
        ("(* (+ a1 a0) 3)", "(* 3 (+ a0 a1))"),
        ("(+ a0 a0)", "(* 2 a0)"),
        ("(* 0.5 (+ 0.25 (- 3 2)))", "0.625"),
        ("(- 0.3 0.1)", "0.19999999999999998"),  # as the interpreters compute it
        ("(* 1e300 1e300)", "(* 1e+300 1e+300)"),  # no constant says infinity
        ("(ifltz -1 a0 a1)", "a0"),
        ("(ifltz 0 a0 a1)", "a1"),
        ("(ifltz a2 (+ t 0) (- t 0))", "t"),
        ("(ifltz t a0 a1)", "a1"),
        ("(ifltz (* (- a0 a1) (- a0 a1)) a0 a1)", "a1"),  # a square is not below 0, nor is NaN
        ("(ifltz (- a0 a1) (ifltz (- a0 a1) t 1) (ifltz (- a0 a1) 2 a2))", "(ifltz (- a0 a1) t a2)"),
        ("(ifltz (- a0 a1) (ifltz (- a1 a0) t 1) a2)", "(ifltz (- a0 a1) 1 a2)"),
        ("(ifltz (- t 1) (ifltz (- t 2) a0 a1) (ifltz (- t 0.5) a0 a1))", "(ifltz (- t 1) a0 a1)"),
        ("(ifltz (- contact 0.3) (+ contact a0) (* contact a1))", "(ifltz (- contact 1) a0 a1)"),
        ("(ifltz (- hops 2.3) (ifltz (- hops 3) a0 a1) (ifltz (- 2.5 hops) t 0))", "(ifltz (- hops 3) a0 t)"),
        ("(ifltz (+ goal_met -1) 0 (- goal_met 1))", "0"),
    ],
)
def test_rules(text: str, simple: str) -> None:
    assert str(simplify(parse(text, TERMINALS))) == simple


def test_it_is_quick_enough_to_tell_twins_apart_by() -> None:
    rng = np.random.default_rng(11)
    trees = [e for e in (Expression(tree(rng, 5)) for _ in range(4000)) if 20 <= len(e.tokens) <= 40][:400]
    assert len(trees) == 400
    began = time.process_time()
    for expression in trees:
        simplify(expression)
    assert (time.process_time() - began) / len(trees) < 0.5e-3  # about 0.04 ms on a machine with nothing else to do
