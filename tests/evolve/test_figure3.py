"""The controller that Gritz & Hahn 1997 print in their Figure 3, its lost brackets put back."""

from __future__ import annotations

import numpy as np

from robolamp.controller.expression import Expression, parse_list, subtree_end
from robolamp.controller.program import compile_program
from robolamp.controller.simplify import simplify
from robolamp.controller.terminals import all_terminals
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.fleet import Fleet, Job

from .parts import ASSETS, CALIBRATION, LAMP

FIGURE_3 = """
(list
  (- (ifltz a0 pz a2) (% a1 t))
  (ifltz (- (- (ifltz a0 pz a2) (% a1 t)) (ifltz (+ a2 15.4963) (ifltz a0 pz a2) (% a1 a2)))
         (ifltz (% (- s0 vx) (+ a2 s0)) (% (- s0 vx) (+ a2 s0)) (+ (- a1 a1) (- a1 t)))
         (% (+ a1 vz) (ifltz (* pz a1) (% a0 pz) (% px a0))))
  (- (ifltz s0
            (ifltz (- (% vx a0) (% vx vx)) (- (% vx a0) (- (+ -28.4382 t) (% a1 t))) (* 16.5266 s0))
            vz)
     (+ a1 vz)))
"""
TERMINALS = all_terminals(3)


def arguments(expression: Expression, start: int) -> int:
    """How many subtrees a function's own holds."""
    at, count = start + 1, 0
    while at < subtree_end(expression.tokens, start):
        at, count = subtree_end(expression.tokens, at), count + 1
    return count


def test_it_is_three_expressions_with_ifltz_of_three_arguments_throughout() -> None:
    parts = parse_list(FIGURE_3, TERMINALS)
    assert len(parts) == 3
    branches = [(part, i) for part in parts for i, token in enumerate(part.tokens) if token == "ifltz"]
    assert len(branches) == 1 + 6 + 2
    assert {arguments(part, index) for part, index in branches} == {3}
    assert parse_list(f"(list {' '.join(map(str, parts))})", TERMINALS) == parts
    assert " ".join(FIGURE_3.split()) == f"(list {' '.join(map(str, parts))})"


def test_simplified_it_loses_what_cancels() -> None:
    parts = parse_list(FIGURE_3, TERMINALS)
    simple = [simplify(part) for part in parts]
    assert simple[0] == parts[0]
    assert "(- a1 t)" in str(simple[1])
    assert "(- a1 a1)" not in str(simple[1])
    assert "(- (% vx a0) 1)" in str(simple[2])


def test_it_runs_on_the_twin_and_whatever_it_does_is_a_finite_outcome() -> None:
    program = compile_program(parse_list(FIGURE_3, TERMINALS), TERMINALS)
    outcome = Fleet([build(LAMP, CALIBRATION, ASSETS)], 0.02).run([program], [Job(0, 0, 0.3)], 5.0)
    assert np.isfinite(outcome.error).all()
    assert np.isfinite(outcome.angles).all()
    assert not outcome.unstable.any()
    assert abs(outcome.error[0]) < 5.0
