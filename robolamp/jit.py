"""numba's njit, its compiled code kept where it can be: beside the source, in a cache folder, or nowhere."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import config

from robolamp.caches import cache_folder, usable

_PACKAGE = Path(__file__).parent


def _settle() -> bool:
    """Choose where compiled code is kept; return whether there is such a place."""
    if config.CACHE_DIR or usable(_PACKAGE / "__pycache__"):
        return True  # NUMBA_CACHE_DIR, or numba's own choice
    folder = cache_folder("numba")
    config.CACHE_DIR = str(folder or "")
    return folder is not None


def _stamp() -> str:
    """Return the SHA-256 of all modules that compile functions, and of those that these import."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(_PACKAGE.rglob("*.py"))}
    compiling = [path for path, text in texts.items() if "njit" in text]
    names = {name for path in compiling for name in re.findall(r"^from (robolamp[\w.]*) import", texts[path], re.M)}
    imported = {_PACKAGE.parent / f"{name.replace('.', '/')}.py" for name in names}
    digest = hashlib.sha256()
    for path, text in texts.items():
        if path in imported or path in compiling:
            digest.update(text.encode())
    return digest.hexdigest()


_KEPT, _STAMP = _settle(), _stamp()


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function at its first call, and keeps what comes of it where it can.

    Args:
        **options: Those of `numba.njit`, but for `cache`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            compiled = numba.njit(cache=_KEPT, **options)(function)
        except RuntimeError:  # "cannot cache function: no locator available"
            return numba.njit(**options)(function)
        # numba looks at the function's own file alone, and would keep code into which it put an older callee.
        kept = getattr(compiled._cache, "_cache_file", None)
        if kept is not None:
            kept._source_stamp = kept._source_stamp, _STAMP
        return compiled

    return decorate
