"""The limbo pole of `score` and `render`: --pole HEIGHT --pole-at X."""

from __future__ import annotations

from robolamp.cli.options import length
from robolamp.errors import RobolampError
from robolamp.twin.lamp_model import Pole

_AT = 0.20
"""Where a pole is unless `--pole-at` says [m]: 11 cm ahead of the standing lamp's head, before goals from 40 cm on."""
_NEAREST = 0.10  # the standing lamp reaches 9.2 cm ahead [m]
_LOWEST, _HIGHEST = 0.02, 1.0  # [m]


def pole_of(height: str | None, at: str | None) -> Pole | None:
    """Return the pole that the options describe.

    Args:
        height: `--pole`, height of its lower edge; None: no pole.
        at: `--pole-at`, its distance ahead of the lamp's start; None: 20 cm.

    Raises:
        RobolampError: One is no length or out of range, or there is a place but no pole.
    """
    if height is None:
        if at is not None:
            raise RobolampError("says where a pole is; give its height with --pole, too", "--pole-at")
        return None
    x = _AT if at is None else length(at, "--pole-at", _NEAREST)
    return Pole(length(height, "--pole", _LOWEST, _HIGHEST), x)
