"""The text of a CSV recording, as columns of numbers: `# key = value` lines, a header, a row a sample."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import FileError
from robolamp.files import shown

Array = NDArray[np.float64]

COLUMNS: Mapping[str, str] = {
    "time_s": "when the angle was sampled",
    "goal_rad": "the goal",
    "angle_rad": "the angle",
    "goal_time_s": "when the goal was sent; without it, time_s",
    "velocity_rad_s": "measured velocity",
    "current_a": "Present Current",
    "duty": "Present PWM as a share of full duty, -1 to 1",
    "voltage_v": "supply voltage as read",
    "temperature_c": "temperature",
    "torque": "Torque Enable, 0 or 1; without it, 1",
    "p_gain": "Position P Gain register (84), where it is not one for the whole file",
}
"""Columns of a CSV recording; the first three are required."""

KEYS = ("servo", "joint", "p_gain", "mass", "length", "arm_mass", "trajectory")
"""Keys of the lines before the header."""

_REQUIRED = tuple(COLUMNS)[:3]
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True)
class RecordingTable:
    """A CSV recording.

    Attributes:
        path: The file.
        keys: What the lines before the header say.
        columns: By name, k samples; an empty cell is NaN, shape (k,).
        count: How many samples, k.
    """

    path: Path
    keys: Mapping[str, str]
    columns: Mapping[str, Array]
    count: int

    def positive(self, key: str, *, zero: bool = False) -> float | None:
        """Return a key's number; None where the file does not give it.

        Args:
            key: The key.
            zero: Whether it may be 0.

        Raises:
            FileError: It is not a number above 0.
        """
        if key not in self.keys:
            return None
        value = float(self.keys[key]) if _NUMBER.fullmatch(self.keys[key]) else math.nan
        if not (0 < value < math.inf or (zero and value == 0)):
            least = "0 or " if zero else ""
            raise FileError(f"{key}: {shown(self.keys[key])} is not {least}a number above 0", str(self.path))
        return value

    def column(self, name: str, default: float) -> Array:
        """Return a column; where the file has none, the default for each sample, shape (k,)."""
        return self.columns.get(name, np.full(self.count, default))


def parse_table(text: str, path: Path) -> RecordingTable:
    """Read the text of a CSV recording.

    Args:
        text: The text.
        path: The file that it came from.

    Raises:
        FileError: It is malformed; the message names the line.
    """
    lines = text.splitlines()
    keys: dict[str, str] = {}
    start = 0
    for start, line in enumerate(lines):
        match = re.fullmatch(r"#\s*(\w+)\s*=\s*(.*?)\s*", line)
        if match and match[1] not in KEYS:
            raise FileError(f"line {start + 1}: unknown key {shown(match[1])}; expected {', '.join(KEYS)}", str(path))
        if match and match[1] in keys:
            raise FileError(f"line {start + 1}: the key {match[1]} a second time", str(path))
        if match:
            keys[match[1]] = match[2]
        elif line.strip() and not line.startswith("#"):
            break
    reader = csv.reader(io.StringIO("\n".join(lines[start:])))
    rows: list[list[float]] = []
    header: list[str] = []
    try:
        for row in reader:
            where = f"line {start + reader.line_num}"
            if not header:
                header = _header(row, where, path)
            elif row:
                rows.append(_row(row, header, where, path))
    except csv.Error as error:
        raise FileError(f"line {start + reader.line_num}: {error}", str(path)) from None
    header = header or _header([], f"line {start + 1}", path)
    numbers = np.array(rows, dtype=np.float64).reshape(-1, len(header))
    return RecordingTable(path, keys, dict(zip(header, numbers.T, strict=True)), len(numbers))


def _header(row: list[str], where: str, path: Path) -> list[str]:
    names = [cell.strip() for cell in row]
    if len(names) == 1 and re.search(r"[;\t]", names[0]):
        raise FileError(f"{where}: parted by semicolons or tabs; expected commas, and points in numbers", str(path))
    for place, name in enumerate(names):
        if name not in COLUMNS:
            raise FileError(f"{where}: unknown column {shown(name)}; expected {', '.join(COLUMNS)}", str(path))
        if name in names[:place]:
            raise FileError(f"{where}: the column {name} stands twice; expected it once", str(path))
    for name in _REQUIRED:
        if name not in names:
            raise FileError(f"{where}: no column {name}", str(path))
    return names


def _row(row: list[str], header: list[str], where: str, path: Path) -> list[float]:
    if len(row) != len(header):
        comma = " (a comma inside a number?)" if len(row) > len(header) else ""
        raise FileError(f"{where}: {len(row)} values, expected {len(header)}{comma}", str(path))
    values = []
    for name, cell in zip(header, map(str.strip, row), strict=True):
        if cell and not _NUMBER.fullmatch(cell):
            raise FileError(f"{where}: {name}: {shown(cell)} is not a number, as 0.25", str(path))
        values.append(float(cell) if cell else math.nan)
        if name == "torque" and values[-1] not in (0.0, 1.0):
            raise FileError(f"{where}: torque: {shown(cell)} is not 0 or 1", str(path))
    return values
