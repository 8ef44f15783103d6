"""What calibration files are written with: parameters on a line each, rounded numbers, covariances."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray
from tomlkit.items import InlineTable, Table

from robolamp.calibration import Parameter

_DIGITS = 6  # significant digits: a hundredth of any standard error here


def rounded(value: float) -> float:
    """Return a number as it is written."""
    return float(f"{value:.{_DIGITS}g}")


def lines(items: Iterable[Any]) -> Any:
    """Return an array with a line an item."""
    array = tomlkit.array().multiline(True)
    array.extend(items)
    return array


def row(values: Mapping[str, Any]) -> InlineTable:
    """Return a table on one line."""
    table = tomlkit.inline_table()
    table.update(values)
    return table


def parameter_row(parameter: Parameter) -> InlineTable:
    """Return a parameter on one line; what it has not is left out."""
    values = {
        "value": parameter.value,
        "unit": parameter.unit,
        "stderr": parameter.stderr,
        "identified": parameter.identified,
        "source": parameter.source,
    }
    return row({key: value for key, value in values.items() if value is not None})


def covariance_table(names: Sequence[str], matrix: NDArray[np.float64], at_bound: Sequence[str]) -> Table:
    """Return the covariance of parameters.

    Args:
        names: The parameters, n of them.
        matrix: Their covariance, in their units, shape (n, n).
        at_bound: Parameters that ended at the edge of what they may be.
    """
    table = tomlkit.table()
    table.add("parameters", lines(names))
    table.add("matrix", lines([rounded(float(value)) for value in values] for values in matrix))
    table.add("at_bound", list(at_bound))
    return table
