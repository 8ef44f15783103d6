"""A pseudo-terminal as a serial port that can be unplugged, with a name that survives it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
import termios
import tty
from pathlib import Path

from robolamp.errors import FileError

_TCGETS2 = 0x802C542A  # asm-generic/ioctls.h: _IOR('T', 0x2A, struct termios2)
_TERMIOS2 = struct.Struct("4IB19s2I")  # asm-generic/termbits.h: flags, line, control characters, input, output speed


class PseudoTerminal:
    """One end of a pseudo-terminal in raw mode; the other has a name that a client opens like a serial port.

    Args:
        link: A symbolic link to keep pointing at the client's end; None: there is none.

    Attributes:
        name: What a client opens: the link, or the client's end itself, as "/dev/pts/3".
        descriptor: Our end, not blocking; -1 while it is unplugged.

    Raises:
        FileError: The link cannot be made.
    """

    def __init__(self, link: Path | None = None) -> None:
        self._link = link
        self.descriptor = self._client = -1
        self.device = ""
        self.plug()
        self.name = str(link) if link else self.device

    @property
    def baud(self) -> int:
        """The rate that the client set, any number [1/s]: what it sends with, so c_ospeed."""
        state = fcntl.ioctl(self._client, _TCGETS2, bytes(_TERMIOS2.size))
        return _TERMIOS2.unpack(state)[-1]

    @property
    def unread(self) -> int:
        """Bytes that the client has not read yet."""
        return struct.unpack("i", fcntl.ioctl(self._client, termios.FIONREAD, b"\0" * 4))[0]

    def forget(self) -> None:
        """Throw away what the client has not read."""
        termios.tcflush(self._client, termios.TCIFLUSH)

    def read(self, most: int) -> bytes:
        """Return what the client has written; what is left makes a client that goes on writing wait.

        Args:
            most: Bytes at most.
        """
        try:
            return os.read(self.descriptor, most)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Send to the client; what its buffer cannot take is lost, as on a line that nobody reads."""
        if self.descriptor >= 0:
            with contextlib.suppress(BlockingIOError):
                os.write(self.descriptor, data)

    def plug(self) -> None:
        """Make the port, if there is none."""
        if self.descriptor >= 0:
            return
        descriptor, client = os.openpty()  # the client's end stays open, or its first close would be our EIO
        tty.setraw(client)
        os.set_blocking(descriptor, False)
        self.descriptor, self._client = descriptor, client
        self.device = os.ttyname(client)
        if self._link:
            try:
                self._point(self._link)
            except FileError:
                self._hang_up()
                raise

    def unplug(self) -> None:
        """Take the port away: a client that has it open gets an error, as from a USB adapter that is pulled out."""
        if self.descriptor >= 0:
            self._hang_up()
            self._unlink()

    def close(self) -> None:
        """Close both ends and remove the link."""
        self.unplug()

    def _hang_up(self) -> None:
        os.close(self.descriptor)
        os.close(self._client)
        self.descriptor = self._client = -1

    def _point(self, link: Path) -> None:
        new = link.with_name(f".{link.name}.{os.getpid()}")
        try:
            if link.exists() and not link.is_symlink():
                raise FileError("is in the way; expected nothing, or a link, there", str(link))
            link.parent.mkdir(parents=True, exist_ok=True)
            new.unlink(missing_ok=True)
            new.symlink_to(self.device)
            new.replace(link)
        except OSError as error:
            raise FileError(f"cannot be made: {error.strerror or error}", str(link)) from None

    def _unlink(self) -> None:
        if self._link:
            with contextlib.suppress(OSError):
                if str(self._link.readlink()) == self.device:  # not another emulator's
                    self._link.unlink()
