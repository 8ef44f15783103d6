"""A run as a table with one row for each tick, and the table as a file: CSV, or Parquet with the extra `parquet`."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.errors import FileError
from robolamp.files import suffix_of, write_atomic
from robolamp.log.reader import Run

_TIMES = ("scheduled", "began", "read_done", "write_done", "measured_at")
_ONE = {"foot_force": "foot_force_N", "foot_age": "foot_age_s", "contact": "contact", "hops": "hops"}
_JOINT = {
    "goal": "goal_rad", "angle": "angle_rad", "velocity": "velocity_rad_s", "current": "current_A",
    "angle_age": "angle_age_s", "pwm": "duty", "voltage": "voltage_V", "temperature": "temperature_degC",
    "torque": "torque_enable", "hardware_error": "hardware_error", "outputs": "output_rad",
}  # fmt: skip
_TOTALS = ("not_finite", "limited", "slewed")


def columns_of(run: Run) -> dict[str, NDArray[Any]]:
    """Return a run as columns of N values, ready for `pandas.DataFrame(...)`; a missing value is NaN.

    Times are on the run's own clock, counted from when the first tick began. "<joint>_goal_rad" and its like are the
    joint's, "input_<terminal>" the controller's inputs; `docs/logs.md` lists them all.

    Args:
        run: The run.
    """
    zero = run.began[0]
    columns: dict[str, NDArray[Any]] = {"tick": run.index, "unix_time_ns": run.log_time, "phase": run.phase}
    columns |= {f"{name.removesuffix('_at')}_s": getattr(run, name) - zero for name in _TIMES}
    for name, title in _JOINT.items():
        values = getattr(run, name)
        if values.shape[1] == len(run.joints):
            columns |= {f"{joint}_{title}": values[:, index] for index, joint in enumerate(run.joints)}
    columns |= {title: getattr(run, name) for name, title in _ONE.items()}
    if len(run.terminals) == run.inputs.shape[1]:
        columns |= {f"input_{name}": run.inputs[:, index] for index, name in enumerate(run.terminals)}
    columns |= {f"total_{name}": run.interventions[:, index] for index, name in enumerate(_TOTALS)}
    columns["faults"] = np.array(["; ".join(faults) for faults in run.faults], dtype=np.str_)
    return columns


def check_format(out: Path | str) -> None:
    """Refuse a file name that no table can have, before the work of reading a log.

    Raises:
        FileError: The name ends otherwise than in .csv or .parquet, or the extra `parquet` is missing.
    """
    path = Path(out)
    if suffix_of(path) not in _FORMATS:
        raise FileError(f"{path.suffix or 'no ending'!r} is no format of tables; expected .csv or .parquet", str(path))
    if suffix_of(path) == ".parquet":
        try:
            import arro3.core  # noqa: PLC0415 (the extra `parquet`)
            import arro3.io  # noqa: F401, PLC0415
        except ImportError:
            raise FileError(
                "needs the extra `parquet`: pip install 'robolamp[parquet]'; or write .csv", str(path)
            ) from None


def export(run: Run, out: Path | str) -> list[str]:
    """Write a run as a table, a row a tick.

    Args:
        run: The run.
        out: The file: .csv, or .parquet (whose metadata then hold the run's context).

    Returns:
        The columns' names.

    Raises:
        FileError: The name ends otherwise, the extra `parquet` is missing, or the file cannot be written.
    """
    check_format(out)
    path, columns = Path(out), columns_of(run)
    write_atomic(path, _FORMATS[suffix_of(path)](columns, run.context))
    return list(columns)


def _csv(columns: Mapping[str, NDArray[Any]], context: Mapping[str, str]) -> bytes:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(_cells(column) for column in columns.values()), strict=True))
    return stream.getvalue().encode()


def _cells(column: NDArray[Any]) -> list[Any]:
    if column.dtype == np.bool_:
        return column.astype(int).tolist()
    if column.dtype.kind == "f":
        return ["" if math.isnan(value) else value for value in column.tolist()]
    return column.tolist()


def _parquet(columns: Mapping[str, NDArray[Any]], context: Mapping[str, str]) -> bytes:
    from arro3.core import Array, DataType, Table  # noqa: PLC0415 (the extra `parquet`)
    from arro3.io import write_parquet  # noqa: PLC0415

    arrays = [
        Array(column.tolist(), DataType.string()) if column.dtype.kind == "U"
        else Array.from_numpy(np.ascontiguousarray(column))
        for column in columns.values()
    ]  # fmt: skip
    stream = io.BytesIO()
    write_parquet(
        Table.from_arrays(arrays, names=list(columns)), stream, compression="zstd(3)", key_value_metadata=dict(context)
    )
    return stream.getvalue()


_FORMATS: dict[str, Callable[[Mapping[str, NDArray[Any]], Mapping[str, str]], bytes]] = {
    ".csv": _csv,
    ".parquet": _parquet,
}
