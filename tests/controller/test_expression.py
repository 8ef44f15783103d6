from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.expression import Expression, depth, parse, parse_list, subtree_end
from robolamp.errors import ExpressionError

from .parts import ARITY, TERMINALS, expressions

FIGURE_3 = """(list (- (ifltz a0 pz a2) (% a1 t))
  (ifltz (- (- (ifltz a0 pz a2) (% a1 t)) (ifltz (+ a2 15.4963) (ifltz a0 pz a2) (% a1 a2)))
    (ifltz (% (- s0 vx) (+ a2 s0)) (% (- s0 vx) (+ a2 s0)) (+ (- a1 a1) (- a1 t)))
    (% (+ a1 vz) (ifltz (* pz a1) (% a0 pz) (% px a0))))
  (- (ifltz s0 (ifltz (- (% vx a0) (% vx vx)) (- (% vx a0) (- (+ -28.4382 t) (% a1 t))) (* 16.5266 s0)) vz) (+ a1 vz)))
"""  # Gritz & Hahn 1997, Figure 3, its lost brackets put back


@given(expressions)
def test_printed_text_parses_back_to_the_same_tokens(expression: Expression) -> None:
    back = parse(str(expression), TERMINALS)
    assert [repr(token) for token in back.tokens] == [repr(token) for token in expression.tokens]


@given(expressions, st.sampled_from([" ", "\n", "\t", " ; a comment (with ) brackets\n"]))
def test_white_space_and_comments_change_nothing(expression: Expression, space: str) -> None:
    spaced = {" ": space, "(": f"({space}", ")": f"{space})"}
    text = re.sub("[ ()]", lambda found: spaced[found[0]], str(expression))
    assert str(parse(f"{space}{text}{space}", TERMINALS)) == str(expression)


@given(st.text(alphabet="()+-*%; \nat0.1e9ifltz", max_size=40))
def test_any_text_parses_or_is_refused_in_one_line(text: str) -> None:
    try:
        expression = parse(text, TERMINALS, "here")
    except ExpressionError as error:
        message = str(error)
    else:
        assert parse(str(expression), TERMINALS) == expression
        return
    assert re.fullmatch(r"here: found .* at line \d+, column \d+; expected .*", message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found the end at line 1, column 1; expected an expression"),
        ("(+ 1", "found the end at line 1, column 5; expected an expression"),
        ("(+ 1 2", "found the end at line 1, column 7; expected `)` after 2 arguments of +"),
        ("(+ 1)", "found ')' at line 1, column 5; expected 2 arguments of +, not 1"),
        ("(ifltz a0\n  t)", "found ')' at line 2, column 4; expected 3 arguments of ifltz, not 2"),
        ("(+ 1 2 3)", "found '3' at line 1, column 8; expected `)` after 2 arguments of +"),
        ("(foo 1)", "found 'foo' at line 1, column 2; expected a function (+ - * % ifltz)"),
        ("()", "found ')' at line 1, column 2; expected a function"),
        ("(+ 1 qq)", "found 'qq' at line 1, column 6; expected a number, a list, or a terminal (t a0"),
        (")", "found ')' at line 1, column 1; expected an expression"),
        ("1 2", "found '2' at line 1, column 3; expected nothing after the expression"),
        ("nan", "found 'nan' at line 1, column 1; expected a number"),
        ("-inf", "found '-inf'"),
        ("1e999", "found '1e999' at line 1, column 1; expected a number that fits a double"),
        ("0x10", "found '0x10'"),
        ("(list 1 2)", "found 'list' at line 1, column 2; expected a function"),
        ("(+ " * 300, "expected no more than 200 nested lists"),
    ],
)
def test_errors_point_at_the_character_and_say_what_was_expected(text: str, message: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse(text, TERMINALS, "hop.toml: joints.knee")
    assert caught.value.message.startswith(message) or caught.value.message.endswith(message)
    assert caught.value.where == "hop.toml: joints.knee"


def test_the_papers_controller_is_three_expressions() -> None:
    parts = parse_list(FIGURE_3, TERMINALS)
    assert len(parts) == 3
    assert [depth(part.tokens) for part in parts] == [2, 4, 6]
    assert parts[1].terminals == {"a0", "a1", "a2", "pz", "px", "t", "s0", "vx", "vz"}
    assert parts[1].tokens.count("ifltz") == 6
    assert "-28.4382" in str(parts[2])
    assert parse_list(f"(list {' '.join(map(str, parts))})", TERMINALS) == parts


def test_a_list_of_none_an_open_list_and_words_after_it_are_refused() -> None:
    for text, message in (
        ("(list)", "expected one expression a joint"),
        ("(list 1 2", "found the end"),
        ("(list 1) 2", "expected nothing after the list"),
    ):
        with pytest.raises(ExpressionError, match=message):
            parse_list(text, TERMINALS)
    assert parse_list("(+ 1 t)", TERMINALS) == (parse("(+ 1 t)", TERMINALS),)


@given(expressions)
def test_subtrees_are_slices_that_partition_the_tree(expression: Expression) -> None:
    tokens = expression.tokens
    assert subtree_end(tokens, 0) == len(tokens)
    for index, token in enumerate(tokens):
        end = index + 1
        if isinstance(token, str) and token in ARITY:
            for _ in range(ARITY[token]):
                end = subtree_end(tokens, end)
        assert subtree_end(tokens, index) == end


@given(expressions)
def test_depth_is_the_deepest_nesting_of_brackets(expression: Expression) -> None:
    level = deepest = 0
    for character in str(expression):
        level += {"(": 1, ")": -1}.get(character, 0)
        deepest = max(deepest, level)
    assert depth(expression.tokens) == deepest
