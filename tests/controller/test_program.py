from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.expression import Expression, parse
from robolamp.controller.primitives import PRIMITIVES, Primitive
from robolamp.controller.program import Program, ProgramSet, compile_program
from robolamp.errors import ExpressionError

from .parts import NASTY, TERMINALS, bits, evaluate, expressions, random_tokens, signal


def many(programs: list[Program], program: list[int], inputs: np.ndarray) -> np.ndarray:
    outputs = np.full((len(program), len(programs[0].ends)), 77.0)
    return ProgramSet(programs).run(np.array(program), inputs, outputs)


@given(
    st.lists(expressions, min_size=1, max_size=3), st.lists(signal, min_size=len(TERMINALS), max_size=len(TERMINALS))
)
def test_both_interpreters_and_a_recursive_evaluation_agree_to_the_bit(
    parts: list[Expression], values: tuple[float, ...]
) -> None:
    program = compile_program(parts, TERMINALS)
    named = dict(zip(TERMINALS, values, strict=True))
    one = program.run(values)
    lanes = many([program], [0], np.array([values]))[0]
    assert bits(one).tolist() == bits(lanes).tolist()
    assert bits(one).tolist() == bits([evaluate(part.tokens, named) for part in parts]).tolist()


def test_many_random_programs_agree_to_the_bit_on_nasty_lanes() -> None:
    rng = np.random.default_rng(7)
    trees = [[Expression(random_tokens(rng, int(rng.integers(0, 9)))) for _ in range(3)] for _ in range(400)]
    programs = [compile_program(parts, TERMINALS) for parts in trees]
    lanes = 6000
    program = rng.integers(len(programs), size=lanes)
    inputs = np.where(
        rng.random((lanes, len(TERMINALS))) < 0.3,
        rng.choice(NASTY, (lanes, len(TERMINALS))),
        rng.normal(size=(lanes, len(TERMINALS))),
    )
    together = many(programs, program.tolist(), inputs)
    alone = np.array([programs[own].run(row) for own, row in zip(program, inputs.tolist(), strict=True)])
    assert (bits(together) == bits(alone)).all()
    assert np.isnan(together).any()
    assert np.isinf(together).any()
    for lane in range(0, lanes, 7):
        named = dict(zip(TERMINALS, inputs[lane].tolist(), strict=True))
        expected = [evaluate(part.tokens, named) for part in trees[program[lane]]]
        assert bits(expected).tolist() == bits(alone[lane]).tolist()


@pytest.mark.parametrize(
    ("text", "t", "expected"),
    [
        ("(% t 0)", 3.0, 1.0),
        ("(% 0 0)", 0.0, 1.0),
        ("(% t -0)", math.nan, 1.0),
        ("(% 1 t)", math.inf, 0.0),
        ("(% 1 t)", 5e-324, math.inf),
        ("(* t t)", 1e300, math.inf),
        ("(- t t)", math.inf, math.nan),
        ("(- t 3)", 1.0, -2.0),
        ("(ifltz t 1 2)", -5e-324, 1.0),
        ("(ifltz t 1 2)", -0.0, 2.0),
        ("(ifltz t 1 2)", math.nan, 2.0),
        ("(ifltz 1 (% t 0) 2)", math.nan, 2.0),
    ],
)
def test_protected_semantics(text: str, t: float, expected: float) -> None:
    program = compile_program([parse(text, ["t"])], ["t"])
    assert bits(program.run([t])).tolist() == bits([expected]).tolist()
    assert bits(many([program], [0], np.array([[t]]))[0]).tolist() == bits([expected]).tolist()


def test_each_lane_runs_its_own_program_on_its_own_row() -> None:
    texts = [("t", "1"), ("(+ t 10)", "2"), ("(* t t)", "(% t 2)")]
    programs = [compile_program([parse(text, ["t"]) for text in pair], ["t"]) for pair in texts]
    inputs = np.arange(6.0)[:, None]
    result = many(programs, [2, 1, 0, 0, 1, 2], inputs)
    assert result.tolist() == [[0, 0], [11, 2], [2, 1], [3, 1], [14, 2], [25, 2.5]]


def test_a_terminal_that_is_not_supplied_is_refused_by_name() -> None:
    with pytest.raises(ExpressionError, match=r"terminal 'px' is not supplied; supplied are: t a0"):
        compile_program([parse("(+ px t)", TERMINALS)], ["t", "a0"])


@pytest.mark.parametrize("name", PRIMITIVES)
@given(st.data())
def test_every_primitive_is_closed_over_the_floats(name: str, data: st.DataObject) -> None:
    arguments = data.draw(st.tuples(*[signal] * PRIMITIVES[name].arity))
    assert isinstance(PRIMITIVES[name].function(*arguments), float)


def test_a_primitive_that_is_not_closed_is_refused_when_made() -> None:
    for function in (lambda a, b: a / b, lambda a, b: (a - 1.0) ** 0.5, lambda a: a):
        with pytest.raises(ExpressionError, match="primitive bad: "):
            Primitive("bad", 2, function)
