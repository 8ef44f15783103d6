"""What a verb prints for programs: JSON, in which NaN is null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from robolamp.controller.controller_file import Controller
from robolamp.errors import RobolampError


def jsonable(value: Any) -> Any:
    """Return a value as plain JSON types: arrays as lists, NaN and infinities as null, paths as text."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, np.generic):
        return jsonable(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return value


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object on one line of stdout.

    Raises:
        RobolampError: stdout cannot be written, as on a full disk.
        BrokenPipeError: Nobody reads it.
    """
    try:
        print(json.dumps(jsonable(value), allow_nan=False), flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise RobolampError(f"cannot be written: {error.strerror or error}", "stdout") from None


def called(controller: Controller) -> str:
    """Return a controller's name and, where its file says it, what made it: "hop (tuned)"."""
    return f"{controller.name} ({controller.origin})" if controller.origin else controller.name


def counted(count: int, thing: str) -> str:
    """Return "1 hop", "2 hops"."""
    return f"{count} {thing}{'' if count == 1 else 's'}"
