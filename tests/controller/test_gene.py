"""Genes: what they express, their text, and trees put into them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.controller.controller_file import Controller, format_controller, load_controller
from robolamp.controller.expression import Expression, parse
from robolamp.controller.gene import Gene, expressed, parse_gene, tail_length
from robolamp.errors import ExpressionError, FileError

from .parts import ARITY, LAMP, TERMINALS, expressions

LEAVES = (*TERMINALS, "?")


@st.composite
def genes(draw: st.DrawFn) -> Gene:
    """Any gene of a head of up to 12."""
    head = draw(st.integers(2, 12))
    tail, count = tail_length(head), draw(st.integers(1, 6))
    inner = draw(st.lists(st.sampled_from((*ARITY, *LEAVES)), min_size=head, max_size=head))
    outer = draw(st.lists(st.sampled_from(LEAVES), min_size=tail, max_size=tail))
    domain = draw(st.lists(st.integers(0, count - 1), min_size=tail, max_size=tail))
    values = st.floats(allow_nan=False, allow_infinity=False)
    return Gene((*inner, *outer), tuple(domain), tuple(draw(st.lists(values, min_size=count, max_size=count))), head)


def test_a_k_expression_is_read_level_by_level() -> None:
    """Ferreira 2001, section 3.1."""
    text = "* ifltz - a0 + t a1 a2 t | w0 " + " ".join(["w1"] * 18) + " | " + " ".join(["0"] * 19) + " | 1"
    gene = parse_gene(text, TERMINALS)
    assert str(gene.expression) == "(* (ifltz a0 (+ t w0) t) (- a1 a2))"
    assert expressed(gene.symbols) == 10
    # A question mark takes the domain's numbers in the order in which the K-expression is read.
    text = "+ * ? ? | t t t t t t t t t | 2 0 1 1 1 1 1 1 1 | 10 20 30.5"
    assert str(parse_gene(text, TERMINALS).expression) == "(+ (* 10 t) 30.5)"
    # A head that begins with a terminal expresses that alone.
    assert str(parse_gene("t + | t t t t t | 0 0 0 0 0 | 1", TERMINALS).expression) == "t"


@given(genes())
def test_any_gene_expresses_a_tree_and_its_text_parses_back(gene: Gene) -> None:
    expression = gene.expression
    assert parse(str(expression), TERMINALS) == expression
    assert len(expression.tokens) == expressed(gene.symbols) <= len(gene.symbols)
    assert parse_gene(str(gene), TERMINALS) == gene


@given(genes(), expressions)
def test_a_tree_put_into_a_gene_is_what_it_then_expresses(gene: Gene, expression: Expression) -> None:
    try:
        carrying = gene.carrying(expression, "here")
    except ExpressionError as error:
        message = str(error)
    else:
        assert carrying.expression == expression
        assert len(carrying.symbols) == len(gene.symbols)
        assert carrying.carrying(gene.expression).expression == gene.expression
        end = len(expression.tokens)
        assert carrying.symbols[end:] == gene.symbols[end:]  # what is not expressed is as it was
        return
    assert re.fullmatch(r"here: needs (a head of|\d+ constants).*; a gene has (one of )?\d+", message)
    # It is refused only where there is no room: of n functions the last is among the first 3 n symbols.
    functions = sum(str(token) in ARITY for token in expression.tokens)
    constants = {token for token in expression.tokens if isinstance(token, float)}
    assert 3 * functions > gene.head or len(constants) > len(gene.constants)


GOOD = "+ ? | t t t t t | 0 0 1 0 1 | 0.5 -2"


@given(st.text(alphabet="+-*%?|t a01.5e\n", max_size=60))
def test_any_text_is_a_gene_or_is_refused_in_one_line(text: str) -> None:
    try:
        gene = parse_gene(text, TERMINALS, "here")
    except ExpressionError as error:
        message = str(error)
    else:
        assert parse_gene(str(gene), TERMINALS) == gene
        return
    assert re.fullmatch(r"here: .*expected .*", message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has 1 parts with | between; expected 4: head | tail | domain | constants"),
        (GOOD + " | 3", "has 5 parts with | between; expected 4"),
        ("+ | t t t | 0 0 0 | 1", "head: 1 symbols; expected 2 to 150"),
        (GOOD.replace("t t t t t", "t t t t"), "tail: 4 symbols; expected 2 x 2 + 1 = 5 for a head of 2"),
        (GOOD.replace("0 0 1 0 1", "0 0 1 0"), "domain: 4 symbols; expected 2 x 2 + 1 = 5 for a head of 2"),
        (GOOD.replace("0.5 -2", ""), "constants: none; expected one at least"),
        (GOOD.replace("+ ?", "+ 3"), "head: '3' is symbol 2; expected a function or a terminal (+ - * % ifltz t a0"),
        (GOOD.replace("t t t t t", "t + t t t"), "tail: '+' is symbol 2; expected a terminal (t a0"),
        (GOOD.replace("0 0 1", "0 2 1"), "domain: '2' is symbol 2; expected the number of a constant, 0 to 1"),
        (GOOD.replace("0 0 1", "0 -1 1"), "domain: '-1' is symbol 2; expected the number of a constant, 0 to 1"),
        (GOOD.replace("-2", "nan"), "constants: 'nan' is symbol 2; expected a finite number"),
        (GOOD.replace("-2", "1e999"), "constants: '1e999' is symbol 2; expected a finite number"),
    ],
)
def test_a_malformed_gene_is_one_clear_line(text: str, message: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_gene(text, TERMINALS, "here")
    assert str(caught.value).startswith(f"here: {message}")


def test_a_controller_file_keeps_its_genes_and_holds_them_to_its_expressions(tmp_path: Path) -> None:
    gene = parse_gene(GOOD, TERMINALS)
    path = tmp_path / "controller.toml"
    names = LAMP.names
    controller = Controller(
        "bred", "", "position", 0.02, (gene.expression,) * 3, names, genome=dict.fromkeys(names, str(gene))
    )
    text = format_controller(controller)
    path.write_text(text)
    loaded = load_controller(path, LAMP)
    assert loaded.genome == controller.genome
    assert loaded.expressions == controller.expressions
    assert str(gene.expression) == "(+ 0.5 t)"
    for old, new, message in (
        ("| 0 0 1", "| 0 7 1", "genome.ankle: domain: '7' is symbol 2; expected the number of a constant, 0 to 1"),
        ("(+ 0.5 t)", "(+ 0.6 t)", "genome.ankle: expresses (+ 0.5 t), not what [joints] says; remove [genome] if"),
        ("[genome]", "[genome]\nelbow = ''", "genome.elbow: unknown; expected one of ankle, knee, neck"),
    ):
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(FileError) as caught:
            load_controller(path, LAMP)
        assert str(caught.value).startswith(f"{path}: {message}")
