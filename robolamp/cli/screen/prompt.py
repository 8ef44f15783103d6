"""Waiting for a person at the terminal: any request to stop ends the wait at once."""

from __future__ import annotations

from collections.abc import Callable

from robolamp.runtime.stop import StopRequest

STOP = "q or Ctrl-C to stop"
"""What a prompt says of it."""

STOPPED = 130
"""Exit code of a verb that was stopped at a prompt, as a shell reports a process that Ctrl-C ended."""


def answered(read: Callable[[], str], stop: StopRequest) -> str:
    """Return the line that a person types.

    Args:
        read: Reads it.
        stop: Requests to stop.

    Raises:
        KeyboardInterrupt: A stop was asked for, by a signal or by typing q.
    """
    with stop.interrupting():
        line = read()
    if line.strip().lower() == "q":
        raise KeyboardInterrupt
    return line
