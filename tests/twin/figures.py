"""Figures as the tests take them apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robolamp.assets import Assets
from robolamp.controller.expression import parse
from robolamp.controller.program import Program, compile_program
from robolamp.controller.terminals import figure_terminals
from robolamp.figure import Figure, load_figure
from robolamp.twin.figure_model import FigureTwin, World, build_figure

ASSETS = Assets()
JUMPER, SPIDER = load_figure(ASSETS, "jumper"), load_figure(ASSETS, "spider")


def twin(figure: Figure = JUMPER, drive: str = "velocity", world: World | None = None) -> FigureTwin:
    """A compiled figure."""
    return build_figure(replace(figure, drive=drive), ASSETS, world)


def program(figure: Figure, *expressions: str) -> Program:
    """A controller over all terminals; joints without an expression ask for 0."""
    names = figure_terminals(figure)
    texts: Sequence[str] = [*expressions, *["0"] * (len(figure.joints) - len(expressions))]
    return compile_program([parse(text, names) for text in texts], names)


def sensed(twin: FigureTwin, **values: Sequence[float] | float) -> np.ndarray:
    """Sensor data of two lanes: of the sensors named, with these values; 0 elsewhere."""
    data = np.zeros((2, twin.model.nsensordata))
    for name, value in values.items():
        sensor = twin.model.sensor(name)
        data[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]] = value
    return data
