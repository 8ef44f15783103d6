from __future__ import annotations

from dataclasses import replace

import pytest

from robolamp.assets import Assets, shipped
from robolamp.controller.controller_file import load_controller
from robolamp.controller.expression import parse
from robolamp.controller.terminals import all_terminals
from robolamp.evolve.controller_origin import marks, origin_of
from robolamp.lamp import load_lamp

LAMP = load_lamp(Assets())
CYCLE, HOP, LUXO = (
    load_controller(shipped() / f"sim/lamp/controllers/{name}.toml", LAMP)
    for name in ("cycle", "hop-counting", "luxo-1997")
)


@pytest.mark.parametrize(
    ("seeds", "made", "origin"),
    [
        ([CYCLE], CYCLE, "by hand"),
        ([LUXO, CYCLE], HOP, "tuned"),  # hop-counting is the cycle with other numbers
        ([replace(CYCLE, origin="")], HOP, "tuned"),  # a file of 0.1.0
        ([HOP], HOP, "tuned"),
        ([CYCLE, HOP], HOP, "tuned"),
        ([HOP], CYCLE, "tuned"),
        ([LUXO], LUXO, "evolved"),
        ([CYCLE], LUXO, "evolved"),
        ([], CYCLE, "evolved"),
    ],
)
def test_how_the_best_of_a_run_was_made(seeds: list, made, origin: str) -> None:
    assert origin_of(made.expressions, marks(seeds)) == origin


def test_another_signal_is_not_another_number() -> None:
    expressions = (parse("(+ t 1)", all_terminals(3)), *CYCLE.expressions[1:])
    seed = replace(CYCLE, expressions=(parse("(+ a0 1)", all_terminals(3)), *CYCLE.expressions[1:]))
    assert origin_of(expressions, marks([seed])) == "evolved"
