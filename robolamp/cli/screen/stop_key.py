"""The stop key: q, Space or Esc in the terminal asks a run to stop, as Ctrl-C does."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Iterator
from types import TracebackType

KEYS = b"q \x1b"
"""q, Space, and Esc (which also begins what arrow and function keys send: in doubt, stop)."""

_CHUNK = 64  # bytes: more keys than a hand presses between two looks


class StopKeys:
    """Reads the terminal a key at a time, without echo, and puts its mode back on every way out.

    Only a terminal that this process is in the foreground of is touched: another one would stop the process.

    Attributes:
        listening: Whether there is such a terminal; without one, nothing is pressed.
    """

    def __init__(self) -> None:
        self.listening = False
        self._terminal = -1
        self._before: list[int | list[bytes | int]] = []

    def __enter__(self) -> StopKeys:
        with contextlib.suppress(OSError, ValueError, termios.error):  # closed, no file, or gone
            self._terminal = sys.stdin.fileno()
            if os.isatty(self._terminal) and self._foreground():
                self._before = termios.tcgetattr(self._terminal)
                tty.setcbreak(self._terminal, termios.TCSANOW)  # Ctrl-C still makes its signal
                self.listening = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before:
            with contextlib.suppress(OSError, termios.error), _undisturbed():
                termios.tcflush(self._terminal, termios.TCIFLUSH)  # keys pressed meanwhile are not for the shell
                termios.tcsetattr(self._terminal, termios.TCSANOW, self._before)
        self.listening, self._before = False, []

    def pressed(self) -> bool:
        """Return whether a stop key was pressed since the last look."""
        if not self.listening:
            return False
        try:
            if not self._foreground() or not select.select([self._terminal], [], [], 0)[0]:
                return False
            keys = os.read(self._terminal, _CHUNK)
        except OSError:
            keys = b""
        self.listening = bool(keys)  # readable and empty: the terminal went away
        return any(key in KEYS for key in keys)

    def _foreground(self) -> bool:
        return os.tcgetpgrp(self._terminal) == os.getpgrp()


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Set a terminal though this process may be in the background by now: SIGTTOU would stop it."""
    before = signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGTTOU, before)
