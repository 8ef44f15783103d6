"""Where the process begins, whatever surrounds it: closed streams, no home, Ctrl-C while it is still loading."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from robolamp.caches import settle_libraries
from robolamp.cli.streams import settle_streams

_NO_DISPLAY = "0"
"""MUJOCO_GL unless it is given. Else MuJoCo asks glfw for a display as it loads, in a process that Ctrl-C hits, too;
what robolamp draws, it draws without one (`robolamp.twin.render`)."""

_INTERRUPTED = 130  # as a shell reports a process that SIGINT ended


def main() -> None:
    """Run the command line and exit the process with its code."""
    signal.signal(signal.SIGINT, _interrupt)
    settle_streams()
    settle_libraries()
    if sys.platform == "linux" and not os.environ.get("MUJOCO_GL"):
        os.environ["MUJOCO_GL"] = _NO_DISPLAY
    try:
        from robolamp.cli.main import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)


def _interrupt(_: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, but not into an import: a library's C code makes an ImportError of it."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            os._exit(_INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt
