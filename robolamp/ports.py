"""What a serial port that cannot be opened is reported as: one line with the remedy."""

from __future__ import annotations

import errno

from robolamp.errors import BusError


def open_error(path: str, error: Exception, option: str) -> BusError:
    """Return (not raise) the error for a port that could not be opened.

    Args:
        path: The port.
        error: What the operating system or pyserial said.
        option: The option or key that gives the port, as "--port or bus.port in hardware/lamp.toml".
    """
    code = getattr(error, "errno", None)
    text = str(error)
    if code == errno.ENOENT:
        said = f"no such serial port; is it plugged in? Give another with {option}"
    elif code in (errno.EACCES, errno.EPERM):
        said = "permission denied; add yourself to the group that owns the port (`sudo usermod -aG dialout $USER`)"
    elif code in (errno.EBUSY, errno.EAGAIN) or "lock port" in text:
        said = "in use by another program; close it first"
    elif code in (errno.ENXIO, errno.ENODEV, errno.EIO):
        said = "nothing is behind this serial port; is it plugged in?"
    elif "Could not configure port" in text or code in (errno.ENOTTY, errno.EISDIR):
        said = f"not a serial port; give one with {option}"
    else:
        said = f"cannot be opened: {said_by(error)}"
    return BusError(said, path)


def said_by(error: Exception) -> str:
    """Return what the operating system said; a termios.error has it in its arguments, and no strerror."""
    return str(getattr(error, "strerror", None) or (error.args[-1] if error.args else error))
