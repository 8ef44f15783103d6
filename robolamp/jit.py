"""numba's njit, its compiled code kept where it can be: beside the source, in a cache folder, or nowhere."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import config

from robolamp.caches import cache_folder, usable


def _settle() -> bool:
    """Choose where compiled code is kept; return whether there is such a place."""
    if config.CACHE_DIR or usable(Path(__file__).parent / "__pycache__"):
        return True  # NUMBA_CACHE_DIR, or numba's own choice
    folder = cache_folder("numba")
    config.CACHE_DIR = str(folder or "")
    return folder is not None


_KEPT = _settle()


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function at its first call, and keeps what comes of it where it can.

    Args:
        **options: Those of `numba.njit`, but for `cache`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=_KEPT, **options)(function)
        except RuntimeError:  # "cannot cache function: no locator available"
            return numba.njit(**options)(function)

    return decorate
