"""What several verbs take: distances with a unit, ranges of goals, files by path or name."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration, load_calibration
from robolamp.controller.controller_file import Controller, load_controller
from robolamp.errors import RobolampError
from robolamp.figure import LAMP, Driven, Figure
from robolamp.lamp import Lamp, load_lamp

_LENGTH = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(mm|cm|m)?")
_COUNT = re.compile(r"[0-9]{1,6}")
_UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, None: 1.0}
NOMINAL = "nominal"
"""The calibration of a lamp of which nothing was measured."""
MAX_GOAL = 5.0
"""Furthest goal that a lamp on a desk may be sent to [m]."""


def seconds(low: float, high: float) -> Callable[[type, float | None], None]:
    """Return a check for a length of time that an option takes; not-a-number is refused too, none given is not.

    Args:
        low: Shortest [s].
        high: Longest [s].
    """

    def check(_: type, value: float | None) -> None:
        if value is not None and not low <= value <= high:
            raise ValueError(f"Must be a number from {low:g} to {high:g} (seconds).")

    return check


DURATION = Parameter(validator=seconds(0.5, 600.0))
"""How long a controller may drive [s]."""


GOAL_TIME = Parameter(validator=seconds(0.1, 600.0))
"""Time that a controller may be given for the way [s]."""


def length(text: str, option: str, low: float = 0.0, high: float = MAX_GOAL) -> float:
    """Return a length in metres: "0.30", "30cm", "300 mm".

    Args:
        text: What was typed.
        option: Where, for the message.
        low: Smallest allowed [m]; must be exceeded.
        high: Largest allowed [m].

    Raises:
        RobolampError: It is no length, or out of range.
    """
    match = _LENGTH.fullmatch(text.strip())
    value = float(match[1]) * _UNITS[match[2]] if match else float("nan")
    if not low < value <= high:
        raise RobolampError(f"{text!r} is not a length above {low:g} m and up to {high:g} m, as 0.30 or 30cm", option)
    return value


def goal_range(text: str, option: str) -> NDArray[np.float64]:
    """Return goals from "LOW:HIGH:COUNT" (metres), or from one length.

    Args:
        text: What was typed.
        option: Where, for the message.

    Raises:
        RobolampError: It is neither.
    """
    parts = text.split(":")
    if len(parts) == 1:
        return np.array([length(text, option)])
    if len(parts) != 3 or not _COUNT.fullmatch(parts[2]) or not 1 <= int(parts[2]) <= 100_000:
        raise RobolampError(f"{text!r} is not LOW:HIGH:COUNT, as 0.05:0.60:56", option)
    low, high = length(parts[0], option), length(parts[1], option)
    if low > high:
        raise RobolampError(f"{text!r}: {low:g} m is above {high:g} m", option)
    return np.linspace(low, high, int(parts[2]))


@dataclass(frozen=True)
class Setup:
    """The lamp that a verb works with.

    Attributes:
        assets: Where data files are.
        lamp: Its description.
        calibration: Its calibration.
        words: What gives another verb the same lamp: "--lamp FOLDER --calibration NAME", of those that were named.
    """

    assets: Assets
    lamp: Lamp
    calibration: Calibration
    words: tuple[str, ...] = ()

    @classmethod
    def of(cls, folder: Path | None, calibration: str) -> Setup:
        """Return the setup for `--lamp FOLDER --calibration NAME`.

        Raises:
            FileError: A file is missing or malformed.
        """
        assets = Assets.of(folder)
        own = () if folder is None else ("--lamp", str(folder))
        numbers = () if calibration == NOMINAL else ("--calibration", calibration)
        return cls(assets, load_lamp(assets), load_calibration(assets, calibration), (*own, *numbers))

    def controller(self, name: str, *, on_board: bool = False, driven: Driven | None = None) -> Controller:
        """Return a controller by path or shipped name.

        Args:
            name: A path, or the name of a file in the figure's folder of controllers.
            on_board: Refuse terminals that only the twin knows.
            driven: What it is to drive; None: the lamp.

        Raises:
            FileError: It is missing or malformed.
            ExpressionError: It does not parse, or needs what the lamp has not.
        """
        folder = driven.name if isinstance(driven, Figure) else LAMP
        path = self.assets.named(name, f"sim/{folder}/controllers", "controller")
        return load_controller(path, driven or self.lamp, on_board=on_board)
