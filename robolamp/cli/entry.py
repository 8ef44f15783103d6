"""Where the process begins: Ctrl-C while the command line is still being loaded ends it quietly, too."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

_INTERRUPTED = 130  # as a shell reports a process that SIGINT ended


def main() -> None:
    """Run the command line and exit the process with its code."""
    signal.signal(signal.SIGINT, _interrupt)
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
