"""Where the process begins, in any surroundings: closed streams, no home folder, signals to end it."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from robolamp.caches import settle_libraries
from robolamp.cli.screen.streams import settle_streams

_NO_DISPLAY = "0"
"""MUJOCO_GL unless it is given. Else MuJoCo asks glfw for a display as it loads, in a process that Ctrl-C hits, too;
what robolamp draws, it draws without one (`robolamp.twin.pictures.render`)."""

_ENDS = (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)  # what else asks a process to end
_SIGNALLED = 128  # and the signal's number: as a shell reports a process that a signal ended


def main() -> None:
    """Run the command line and exit the process with its code."""
    signal.signal(signal.SIGINT, _interrupt)
    for number in _ENDS:
        if signal.getsignal(number) is signal.SIG_DFL:  # not ignored, as under nohup
            signal.signal(number, _interrupt)
    settle_streams()
    settle_libraries()
    if sys.platform == "linux" and not os.environ.get("MUJOCO_GL"):
        os.environ["MUJOCO_GL"] = _NO_DISPLAY
    try:
        from robolamp.cli.main import main as run

        run()
    except KeyboardInterrupt as interrupt:
        sys.exit(interrupt.args[0] if interrupt.args else _SIGNALLED + signal.SIGINT)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt with the exit code, so that what is half-written goes; whatever the signal.

    Not into an import: a library's C code makes an ImportError of it.
    """
    if number in _ENDS:
        signal.signal(number, signal.SIG_DFL)  # a second one does not wait
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            os._exit(_SIGNALLED + number)
        frame = frame.f_back
    raise KeyboardInterrupt(_SIGNALLED + number)
