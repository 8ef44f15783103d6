"""Where what libraries work out once may be kept: the user's cache, or a folder of the user's among temporary files."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from pathlib import Path


def usable(folder: Path) -> bool:
    """Return whether files can be made in a folder, which is made where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def user_cache() -> Path | None:
    """Return the user's cache folder for robolamp (XDG Base Directory Specification); None: there is none to be had."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not base.startswith("/"):  # what is relative is to be ignored, says the specification
        home = os.path.expanduser("~")  # noqa: PTH111 (Path's raises where there is no home)
        base = f"{home}/.cache" if home.startswith("/") else ""
    folder = Path(base, "robolamp")
    return folder if base and usable(folder) else None


def cache_folder(name: str) -> Path | None:
    """Return a folder to keep things in from one run to the next.

    Args:
        name: Of what is kept, a folder's name.

    Returns:
        A folder that this user alone writes to; None where no place can be written.
    """
    if (own := user_cache()) is not None and usable(own / name):
        return own / name
    with contextlib.suppress(OSError):
        shared = Path(tempfile.gettempdir(), f"robolamp-{os.getuid()}")
        with contextlib.suppress(FileExistsError):
            shared.mkdir(mode=0o700)
        found = shared.lstat()  # somebody else's, or a link of theirs: code must not be loaded from it
        private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o022
        if private and found.st_uid == os.getuid() and usable(shared / name):
            return shared / name
    return None


def settle_libraries() -> None:
    """Tell libraries that keep things in a home when there is none to write to; else they complain at each start."""
    for variable, name in (("XDG_CONFIG_HOME", ".config"), ("XDG_CACHE_HOME", ".cache")):  # where they look
        folder = os.path.abspath(os.environ.get(variable) or os.path.expanduser(f"~/{name}"))  # noqa: PTH100, PTH111
        while not os.path.exists(folder):  # noqa: PTH110 (Path's raises where a folder above may not be entered)
            folder = os.path.dirname(folder)  # noqa: PTH120
        if not os.access(folder, os.W_OK | os.X_OK):
            if (fonts := cache_folder("matplotlib")) is not None:
                os.environ.setdefault("MPLCONFIGDIR", str(fonts))
            # https://docs.mesa3d.org/envvars.html: compiled shaders; what is drawn here needs few
            os.environ.setdefault("MESA_SHADER_CACHE_DISABLE", "true")
            return
