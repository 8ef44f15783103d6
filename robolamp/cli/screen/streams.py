"""Makes the three standard streams usable if some are closed, or if a terminal lacks characters."""

from __future__ import annotations

import codecs
import contextlib
import os
import sys
import unicodedata

_INSTEAD = {
    **dict.fromkeys("–—−‐", "-"),
    **dict.fromkeys("█▮━╸╺", "#"),
    **dict.fromkeys("“”", '"'),
    **dict.fromkeys("‘’", "'"),
    "░": ".",
    "·": ".",
    "×": "x",
    "±": "+/-",
    "°": " deg",
    "µ": "u",
    "→": "->",
}
"""What stands for a character that a stream cannot show, beyond letters without their accents."""

_UNDECODED = range(0xDC80, 0xDD00)  # bytes of file names that were no text, as Python keeps them (PEP 383)


def settle_streams() -> None:
    """Open the standard streams that are closed on nothing, and let none fail over a character it does not know.

    A file opened later would else take a closed stream's number, and be written into by whoever prints.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:  # it was closed as Python began
            mode = "w" if number else "r"
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115 (lives as long as we do)
    codecs.register_error("robolamp", _instead)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="robolamp")


def let_go_of_output() -> None:
    """Keep the interpreter from failing at its end because output cannot be written."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _instead(error: UnicodeError) -> tuple[str | bytes, int]:
    """Say what is written in place of characters that cannot be (`codecs.register_error`)."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    character = error.object[error.start]
    if ord(character) in _UNDECODED:
        return bytes([ord(character) - 0xDC00]), error.start + 1
    plain = _INSTEAD.get(character) or unicodedata.normalize("NFKD", character)
    return "".join(part for part in plain if part.isascii()) or "?", error.start + 1
