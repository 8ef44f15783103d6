"""Serial ports from outside: who holds one, and what one that cannot be opened is reported as."""

from __future__ import annotations

import errno
import os
import shlex
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from robolamp.errors import BusError

_PROC = Path("/proc")
_MASTERS = ("/dev/ptmx", "/dev/pts/ptmx")
_PSEUDO_TERMINALS = Path("/dev/pts")
_MOST = 80  # characters of a command


@dataclass(frozen=True)
class Holder:
    """A process that has a port open.

    Attributes:
        pid: Its id.
        user: Its user's id.
        command: What was started, as "robolamp deploy hop --goal 0.3"; a long one is cut.
        robolamp: Whether that is robolamp.
    """

    pid: int
    user: int
    command: str
    robolamp: bool

    def __str__(self) -> str:
        return f"process {self.pid} ({self.command})"


def holders(path: str) -> list[Holder]:
    """Return the other processes that have a port open, as far as this system names them (Linux, by /proc).

    Who keeps both ends of a pseudo-terminal is the device behind it (an emulator), and holds nothing.

    Args:
        path: The port.
    """
    processes = [int(folder.name) for folder in _PROC.glob("[0-9]*")]
    found = [_holder(pid) for pid in sorted(processes) if pid != os.getpid() and holds(pid, path)]
    return [holder for holder in found if holder]


def holds(pid: int, path: str) -> bool:
    """Return whether a process has a port open, as far as can be seen.

    Args:
        pid: The process.
        path: The port.
    """
    try:
        port = Path(path).resolve()
        device = port.stat()
    except (OSError, RuntimeError, ValueError):  # also: links in a circle, a name that cannot be one
        return False
    if not stat.S_ISCHR(device.st_mode):
        return False
    holding = False
    for descriptor, target in _descriptors(pid):
        if target in _MASTERS and port.parent == _PSEUDO_TERMINALS and _index(descriptor) == port.name:
            return False
        if not holding and target.startswith("/dev/"):
            try:
                opened = descriptor.stat()
            except OSError:
                continue
            holding = stat.S_ISCHR(opened.st_mode) and opened.st_rdev == device.st_rdev
    return holding


def check_serial(path: str, option: str) -> None:
    """Check that a path is a serial port, free or not: whoever has another file open must not be taken for its user.

    Args:
        path: The port.
        option: As for `open_error`.

    Raises:
        BusError: It is something else, or cannot be opened.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except (OSError, ValueError) as error:
        if getattr(error, "errno", None) == errno.EBUSY:  # a terminal that its user has claimed (TIOCEXCL)
            return
        raise open_error(path, error, option) from None
    try:
        if not os.isatty(descriptor):
            raise open_error(path, OSError(errno.ENOTTY, os.strerror(errno.ENOTTY)), option)
    finally:
        os.close(descriptor)


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
        said = _in_use(path, "bus.port" in option)
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


def _in_use(path: str, servos: bool) -> str:
    found = holders(path)
    if found:
        how = " (`robolamp stop --force` does, and frees the lamp)" if servos else ""
        return f"in use by another program: {', '.join(map(str, found))}; end it first{how}"
    return f"in use by another program, which cannot be named from here (`lsof {shlex.quote(path)}` may); end it first"


def _descriptors(pid: int) -> Iterator[tuple[Path, str]]:
    """Yield what a process has open, each with what it is; nothing of a process that may not be looked into."""
    try:
        descriptors = list((_PROC / str(pid) / "fd").iterdir())
    except OSError:
        return
    for descriptor in descriptors:
        try:
            yield descriptor, str(descriptor.readlink())
        except OSError:  # closed meanwhile
            continue


def _index(master: Path) -> str:
    """Return the number of the pseudo-terminal that an open master belongs to; empty: not known."""
    try:
        lines = (master.parents[1] / "fdinfo" / master.name).read_text().splitlines()
    except OSError:
        return ""
    return next((line.split()[1] for line in lines if line.startswith("tty-index:")), "")


def _holder(pid: int) -> Holder | None:
    try:
        raw = (_PROC / str(pid) / "cmdline").read_bytes()
        user = (_PROC / str(pid)).stat().st_uid
    except OSError:  # it ended meanwhile
        return None
    words = raw.decode(errors="replace").rstrip("\0").split("\0")
    ours = _arguments(words)
    command = shlex.join(words if ours is None else ["robolamp", *ours])
    command = "".join(letter if letter.isprintable() else "?" for letter in command)
    return Holder(pid, user, command if len(command) <= _MOST else f"{command[: _MOST - 3]}...", ours is not None)


def _arguments(words: list[str]) -> list[str] | None:
    """Return the arguments of robolamp, where that is what a command line starts; else None."""
    names = [Path(word).name for word in words]
    if names[0] == "robolamp":
        return words[1:]
    if not names[0].startswith("python"):
        return None
    if len(words) > 1 and names[1] == "robolamp":
        return words[2:]
    at = words.index("-m") if "-m" in words else len(words)
    return words[at + 2 :] if words[at + 1 : at + 2] == ["robolamp"] else None
