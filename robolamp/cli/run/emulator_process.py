"""The emulated lamp of `robolamp dry-run`: `robolamp emulate` in a process of its own, and what it says at its end."""

from __future__ import annotations

import json
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

from robolamp.errors import BusError, RobolampError
from robolamp.lateness import Lateness
from robolamp.runtime.stop import StopRequest

_QUICK = 3.0  # a start that takes longer is reported [s]
_START = 600.0  # how long a start may take: the first compiles, and this computer may be busy [s]
_LOOK = 0.2  # between two looks at requests to stop [s]
_END = 10.0  # how long it has to end by itself [s]


class EmulatorProcess:
    """An emulated lamp in a process of its own; as a context manager it is started, and ended.

    Args:
        options: Of `robolamp emulate`.
        stop: Requests to stop; the second ends a start that is not over.
        waiting: Called once where the start takes its time.

    Attributes:
        servo_port: Its servo port.
        foot_port: Its foot port.
        late: When this computer let it serve the ports late; known once it has ended, and only if it could say so.
        failed: What went wrong in it while it served; None: nothing did.
    """

    def __init__(self, options: Sequence[str], stop: StopRequest, waiting: Callable[[], None]) -> None:
        self._command = [sys.executable, "-m", "robolamp", "emulate", "--json", "--lateness", *options]
        self._stop = stop
        self._waiting = waiting
        self.servo_port = self.foot_port = ""
        self.late = Lateness()
        self.failed: RobolampError | None = None

    def __enter__(self) -> EmulatorProcess:
        # A session of its own: Ctrl-C lands the lamp first, and only then is the emulator ended.
        self._process = subprocess.Popen(self._command, bufsize=0, stdout=subprocess.PIPE, start_new_session=True)
        try:
            line = self._first_line()
            said = _object(line) or {"error": f"did not start (it said {line.decode(errors='replace').strip()!r})"}
            if "error" in said:
                raise BusError(said["error"], said.get("where") or "emulator")
        except BaseException:
            self._end()
            raise
        self.servo_port, self.foot_port = said["servo_port"], said["foot_port"]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def _first_line(self) -> bytes:
        """Return what it says when it is ready, or when it cannot be."""
        stdout = self._process.stdout
        assert stdout is not None
        began, told = time.monotonic(), False
        while not select.select([stdout], [], [], _LOOK)[0]:
            waited = time.monotonic() - began
            if self._stop.requests > 1 or waited > _START:
                raise BusError(f"was not ready after {waited:.0f} s", "emulator")
            if waited > _QUICK and not told:
                told = True
                self._waiting()
        return stdout.readline()

    def _end(self) -> None:
        process = self._process
        if process.poll() is not None:
            how = f"signal {-process.returncode}" if process.returncode < 0 else f"exit code {process.returncode}"
            self.failed = BusError(f"ended in the midst of the run ({how})", "emulator")
        process.terminate()
        process.send_signal(signal.SIGCONT)  # one that was stopped could not say how late that made it
        try:
            rest, _ = process.communicate(timeout=_END)
        except subprocess.TimeoutExpired:
            process.kill()
            rest, _ = process.communicate()
        for said in map(_object, rest.splitlines()):
            if said and "late" in said:
                self.late = Lateness((due, done) for due, done in said["late"])
            elif said and "error" in said:
                self.failed = RobolampError(said["error"], said.get("where", ""))


def _object(line: bytes) -> dict[str, Any] | None:
    """Return a line's JSON object; None where it is none."""
    try:
        found = json.loads(line)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None
