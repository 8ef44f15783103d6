"""The calibrated lamp, and controllers to drive it with."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.expression import parse
from robolamp.controller.program import Program, compile_program
from robolamp.controller.terminals import all_terminals
from robolamp.lamp import load_lamp
from robolamp.twin.judges.lamp_judge import Outcome
from robolamp.twin.lamp_model import Bend, TwinModel, build

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)
TWIN = build(LAMP, CALIBRATION, ASSETS)
N = len(LAMP.joints)
PERIOD = 0.02
TERMINALS = all_terminals(N)

HEAVY = build(LAMP, CALIBRATION, ASSETS, Bend(strength=np.array([0.9, 1.1, 1.0]), friction=1.3, mass=1.05, supply=-0.3))

# Nods and sways with every kind of signal, and stays on its foot.
SWAY = (
    "(* 0.25 (ifltz (- (% t 0.3) (+ 1 hops)) 1 -1))",
    "(ifltz (- s0 1.5) 0.2 (- (* 0.1 a2) 0.1))",
    "(+ (* 0.02 w0) (- goal_dist ground_time))",
)
STAND = ("0", "0", "0")
FALL = ("0.6", "-1", "0")


def program(*texts: str) -> Program:
    return compile_program([parse(text, TERMINALS) for text in texts], TERMINALS)


def bent(bend: Bend) -> TwinModel:
    return build(LAMP, CALIBRATION, ASSETS, bend)


def rows(outcome: Outcome) -> np.ndarray:
    """Everything of an outcome but its trace, a row a lane, as bits."""
    columns = [
        np.asarray(getattr(outcome, item.name), float).reshape(len(outcome.goal), -1)
        for item in fields(outcome)
        if item.name != "trace"
    ]
    return np.concatenate(columns, axis=1).view(np.int64)
