"""Limits of hardware/lamp.toml that a lamp's stops would meet; no kernel needed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from description import ShapeError

MARGIN = 0.02
"""Of a limit inside its stop [rad], so that the servo holds a joint at its limit."""


def fitted(path: Path, stops: Mapping[str, tuple[float, float]]) -> str:
    """Return the text of a lamp's description, with no limit closer than `MARGIN` to a stop, nor a rest to a limit.

    Args:
        path: hardware/lamp.toml.
        stops: Range of each joint [rad].

    Raises:
        OSError: It cannot be read.
        ShapeError: It is no description of a lamp.
    """
    try:
        document = tomlkit.parse(path.read_text(encoding="utf-8"))
        joints: Any = document["joint"]
        for joint in joints:
            if joint["name"] not in stops:
                continue
            low, high = stops[joint["name"]]
            low, high = round(low + MARGIN, 3), round(high - MARGIN, 3)
            for key, least, most in (("lower", low, high), ("upper", low, high), ("rest", low + MARGIN, high - MARGIN)):
                value = float(joint.get(key, 0.0))
                if not least <= value <= most:
                    joint[key] = round(min(max(value, least), most), 3)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        said = " ".join(str(error).split())
        raise ShapeError(f"{path}: cannot be read as the description of a lamp: {said}") from None
    return document.as_string()
