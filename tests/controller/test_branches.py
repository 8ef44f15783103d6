"""Branches are counted where they are asked for, and laid out text is the same expression."""

from __future__ import annotations

from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.branch_counts import Branch, count_branches
from robolamp.controller.expression import Expression, parse, subtree_end
from robolamp.controller.expression_layout import lay_out

from .parts import ARITY, TERMINALS, evaluate, expressions, signal


def reference(expression: Expression, named: dict[str, float]) -> Counter[tuple[int, int]]:
    """Which (ifltz, argument) one tick takes, by recursion."""
    taken: Counter[tuple[int, int]] = Counter()
    tokens = expression.tokens

    def walk(start: int) -> None:
        token = tokens[start]
        arity = ARITY.get(token, 0) if isinstance(token, str) else 0
        starts, at = [], start + 1
        for _ in range(arity):
            starts.append(at)
            at = subtree_end(tokens, at)
        if token == "ifltz":
            side = 1 if evaluate(tokens[starts[0] : starts[1]], named) < 0 else 2
            taken[start, side] += 1
            starts = [starts[0], starts[side]]
        for argument in starts:
            walk(argument)

    walk(0)
    return taken


@given(expressions, st.lists(st.lists(signal, min_size=len(TERMINALS), max_size=len(TERMINALS)), max_size=4))
def test_branches_are_counted_as_a_lazy_evaluation_takes_them(expression: Expression, rows: list[list[float]]) -> None:
    expected: Counter[tuple[int, int]] = Counter()
    for row in rows:
        expected += reference(expression, dict(zip(TERMINALS, row, strict=True)))
    inputs = np.array(rows, float).reshape(len(rows), len(TERMINALS))
    counted = count_branches(expression, TERMINALS, inputs)
    assert [branch.index for branch in counted] == [i for i, token in enumerate(expression.tokens) if token == "ifltz"]
    for branch in counted:
        assert (branch.negative, branch.otherwise) == (expected[branch.index, 1], expected[branch.index, 2])


def test_a_branch_in_a_branch_counts_only_what_reaches_it() -> None:
    expression = parse("(ifltz (- t 2) (ifltz (- t 1) 1 2) (ifltz t 3 4))", ("t",))
    counted = count_branches(expression, ("t",), np.arange(5.0)[:, None])
    assert counted == (Branch(0, 2, 3), Branch(4, 1, 1), Branch(10, 0, 3))


@given(expressions, st.integers(30, 100))
def test_lines_join_to_the_same_expression_and_fit(expression: Expression, width: int) -> None:
    lines = lay_out(expression, width)
    assert parse("\n".join(line.text for line in lines), TERMINALS) == expression
    for line in lines:
        words = line.text.split()
        assert len(line.text) <= width or len(words) <= 2 or line.text.startswith(" " * (width // 4))


@given(expressions)
def test_every_branch_begins_on_a_line_of_its_own(expression: Expression) -> None:
    lines = lay_out(expression, 90)
    begun = [line.begins for line in lines if line.begins is not None]
    sides = [(index, side) for index, token in enumerate(expression.tokens) if token == "ifltz" for side in (1, 2)]
    assert sorted(begun) == sides


def test_a_layout_to_look_at() -> None:
    text = "(ifltz (- t 1) (+ a0 (ifltz a1 2 3)) (ifltz (ifltz t 1 2) 0 (* -0.2 goal_dist)))"
    assert [line.text for line in lay_out(parse(text, TERMINALS), 60)] == [
        "(ifltz (- t 1)",
        "  (+ a0",
        "    (ifltz a1",
        "      2",
        "      3))",
        "  (ifltz",
        "      (ifltz t",
        "        1",
        "        2)",
        "    0",
        "    (* -0.2 goal_dist)))",
    ]
