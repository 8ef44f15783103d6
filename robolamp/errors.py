"""The one exception that every foreseeable failure of robolamp is reported with."""

from __future__ import annotations

import unicodedata

_UNSEEN = ("Cc", "Cf", "Zl", "Zp")  # Unicode's categories of what ends a line, turns it round, or steers a terminal


def on_one_line(text: str) -> str:
    """Return a text of whatever origin fit to be shown: what would end the line or steer a terminal is escaped."""
    return "".join(
        each.encode("unicode_escape").decode() if unicodedata.category(each) in _UNSEEN else each for each in text
    )


class RobolampError(Exception):
    """Something a user can mend: names the value, what was expected, and where it came from.

    Args:
        message: One line: the value found and the legal range or choices.
        where: The file (and line), argument, or port the value came from; empty if there is none.
    """

    def __init__(self, message: str, where: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.where = where

    def __str__(self) -> str:
        return on_one_line(f"{self.where}: {self.message}" if self.where else self.message)


class FileError(RobolampError):
    """A file that is missing, malformed, or holds a value outside its legal range."""


class ExpressionError(RobolampError):
    """A controller expression that does not parse, or needs what the lamp cannot supply."""


class BusError(RobolampError):
    """A serial port or servo that is absent, does not answer, or refuses."""


class SafetyError(RobolampError):
    """A condition under which the lamp must not move (or must not go on moving)."""
