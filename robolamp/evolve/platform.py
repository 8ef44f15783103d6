"""What a run's last bit depends on: the processor, and the versions of everything that computes."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

_CPUINFO = Path("/proc/cpuinfo")
_NAMED = ("model name", "CPU implementer", "CPU part")  # the first on x86, the others on ARM
_COMPUTING = ("mujoco", "numpy", "numba", "robolamp")


def _processor() -> str:
    try:
        lines = _CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:  # no Linux
        lines = []
    found: dict[str, str] = {}
    for line in lines:
        key, _, value = line.partition(":")
        found.setdefault(key.strip(), value.strip())
    named = " ".join(found[key] for key in _NAMED if key in found)
    return named or platform.processor() or "unknown"


def machine() -> dict[str, str]:
    """Return the processor's model, the architecture, and the versions of what computes, by name."""
    return {
        "processor": _processor(),
        "architecture": platform.machine(),
        "python": platform.python_version(),
        **{name: version(name) for name in _COMPUTING},
    }


def differences(own: Mapping[str, str], others: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return in words how other machines differ from this one; results may differ there in the last bit.

    Args:
        own: `machine` here.
        others: `machine` elsewhere, by a name for the place ("tcp://10.0.0.2:4100", "where the run began").

    Returns:
        A phrase for each value that differs, as "numpy 2.4.6 here, 2.3.0 there (tcp://10.0.0.2:4100)".
    """
    places: dict[tuple[str, str], list[str]] = {}
    for place, other in others.items():
        for key in (*own, *(key for key in other if key not in own)):
            if other.get(key) != own.get(key):
                places.setdefault((key, other.get(key, "none")), []).append(place)
    phrase = "{} {} here, {} there ({})".format
    return [phrase(key, own.get(key, "none"), value, ", ".join(at)) for (key, value), at in places.items()]
