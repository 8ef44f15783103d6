"""What servos say of themselves in one reading: from the bytes of their registers to arrays in SI units."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.registers import Model, Name, Register

COLUMNS = (
    Name.PRESENT_POSITION,
    Name.PRESENT_VELOCITY,
    Name.PRESENT_CURRENT,
    Name.PRESENT_PWM,
    Name.PRESENT_INPUT_VOLTAGE,
    Name.PRESENT_TEMPERATURE,
    Name.GOAL_POSITION,
    Name.TORQUE_ENABLE,
    Name.HARDWARE_ERROR_STATUS,
)
"""The registers of an answer, in the order of its values."""

UNKNOWN = (math.nan,) * 7 + (-1,) * 2
"""Those of an answer that has none of them."""

VOLTAGE = COLUMNS.index(Name.PRESENT_INPUT_VOLTAGE)
"""Which of them the supply's voltage is."""

_MEASURED, _GOAL, _TORQUE, _FLAGS = slice(0, 6), 6, 7, slice(7, 10)  # of COLUMNS and the ERR byte after them
_CODES = {1: "b", 2: "h", 4: "i"}  # of the struct module, signed


@dataclass
class ServoState:
    """What the servos measured, in servo terms, shape (n,) each; a servo that did not answer has NaN and -1.

    Attributes:
        position: Servo angle, 0 to 2 pi over its turn [rad].
        velocity: [rad/s].
        current: [A]; NaN for a model that does not measure it.
        pwm: Duty, -1 to 1.
        voltage: [V].
        temperature: [degC].
        torque: Torque Enable: 1, 0, or -1 unknown.
        hardware_error: Hardware Error Status bits, or -1 unknown.
        error: ERR byte of its answer, or -1: bit 7 is the hardware alert.
        asked_again: Whether it answered only when asked a second time.
        goal_lost: Whether its torque is on and its Goal Position is not what was sent last.
        goal_known: Whether that could be told: its torque is on, and both are known; only the health block tells.
        fine: Whether all of them answered when first asked, with a position and Torque Enable, ERR 0, and no goal lost.
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    current: NDArray[np.float64]
    pwm: NDArray[np.float64]
    voltage: NDArray[np.float64]
    temperature: NDArray[np.float64]
    torque: NDArray[np.int64]
    hardware_error: NDArray[np.int64]
    error: NDArray[np.int64]
    asked_again: NDArray[np.bool_]
    goal_lost: NDArray[np.bool_]
    goal_known: NDArray[np.bool_]
    fine: bool

    @classmethod
    def unknown(cls, n: int) -> ServoState:
        """Return the state of n servos of which nothing is known."""
        gaps, flags, no = np.full((6, n), np.nan), np.full((3, n), -1), np.zeros((3, n), np.bool_)
        return cls(*gaps, *flags, *no, fine=False)


class Answer(NamedTuple):
    """What one servo answered.

    Attributes:
        error: The ERR byte.
        values: The registers of COLUMNS [counts]; as in UNKNOWN where one was not read.
    """

    error: int
    values: tuple[float, ...]


_GAP = Answer(-1, UNKNOWN)


class Layout:
    """Where in some bytes of a servo its registers are.

    Args:
        rows: Each register of COLUMNS with its first byte and how many of its low bytes are there; in any order.
    """

    def __init__(self, rows: Sequence[tuple[Register, int, int]]) -> None:
        code, at = "<", 0
        ordered = sorted(rows, key=lambda row: row[1])
        for register, begin, size in ordered:
            kind = _CODES[size]
            code += f"{begin - at}x{kind if register.signed else kind.upper()}"
            at = begin + size
        names = [register.name for register, _, _ in ordered]
        self._struct = struct.Struct(code)
        self._pick = itemgetter(
            *(names.index(name) if name in names else len(names) + at for at, name in enumerate(COLUMNS))
        )

    def values(self, data: bytes) -> tuple[float, ...]:
        """Return the registers of COLUMNS in some bytes [counts]; as in UNKNOWN where one is not there."""
        return self._pick(self._struct.unpack_from(data) + UNKNOWN)


class Scales:
    """The units of several servos.

    Args:
        models: Their models.
    """

    def __init__(self, models: Sequence[Model]) -> None:
        scales = [[model[name].scale if name in model.registers else math.nan for model in models] for name in COLUMNS]
        self._scale = np.array(scales[_MEASURED])

    def state(self, found: Sequence[Answer | None], again: Sequence[bool], sent: Sequence[float]) -> ServoState:
        """Return what n servos answered, in SI units.

        Args:
            found: Their answers; None where there is none.
            again: Whether each was asked twice.
            sent: The goal that each should have [counts]; NaN: not known.
        """
        answers = [answer or _GAP for answer in found]
        counts = np.array([(*answer.values, answer.error) for answer in answers]).T
        off = [  # by how much the goal is not what was sent [counts]; NaN: not known
            abs(answer.values[_GOAL] - goal) if answer.values[_TORQUE] == 1 else math.nan
            for answer, goal in zip(answers, sent, strict=True)
        ]
        lost, known = [value > 0 for value in off], [value >= 0 for value in off]
        asked = [twice and answer is not None for twice, answer in zip(again, found, strict=True)]
        # In Python: for so few numbers it is quicker.
        fine = all(
            answer.error == 0 and answer.values[_TORQUE] >= 0 and math.isfinite(answer.values[0]) for answer in answers
        ) and not (any(lost) or any(asked))
        return ServoState(
            *(counts[_MEASURED] * self._scale),
            *counts[_FLAGS].astype(np.int64),
            *np.array([asked, lost, known]),
            fine=fine,
        )
