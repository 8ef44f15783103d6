"""What every test must leave behind: nothing."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("MUJOCO_GL", "disabled")  # side views: OpenGL in software is slow; tests of it ask for it

settings.register_profile("robolamp", deadline=None)  # numba compiles on first use, and machines are busy
settings.load_profile("robolamp")

_PROC = Path("/proc")
_GRACE = 2.0  # how long a process or thread that is ending may take [s]
_MUJOCO_LOG = Path("MUJOCO_LOG.TXT")


def _children() -> set[str]:
    """Process ids of this process's children, zombies included."""
    found = set()
    for stat in _PROC.glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except OSError:  # it ended meanwhile
            continue
        name, rest = text.rsplit(")", 1)
        if int(rest.split()[1]) == os.getpid():
            found.add(name.replace("(", ""))
    return found


def _terminals() -> set[str]:
    """Open pseudo-terminals of this process, as "descriptor -> device"."""
    found = set()
    for descriptor in (_PROC / "self" / "fd").glob("*"):
        try:
            device = str(descriptor.readlink())
        except OSError:  # the descriptor of this very listing
            continue
        if device.startswith(("/dev/ptmx", "/dev/pts/")):
            found.add(f"{descriptor.name} -> {device}")
    return found


def _threads() -> set[str]:
    return {f"{thread.name} ({thread.ident})" for thread in threading.enumerate()}


@pytest.fixture(autouse=True)
def _nothing_left_behind() -> Iterator[None]:
    """Fail a test that leaves a child process, a thread, an open pseudo-terminal, or MuJoCo's log in the cwd.

    Fixtures of a wider scope are set up before this one, so what they hold open is not counted.
    """
    kinds = {"processes": _children, "threads": _threads, "pseudo-terminals": _terminals}
    before = {kind: look() for kind, look in kinds.items()}
    log = _MUJOCO_LOG.exists()
    yield
    deadline = time.monotonic() + _GRACE
    left = {kind: look() - before[kind] for kind, look in kinds.items()}
    while any(left.values()) and time.monotonic() < deadline:
        time.sleep(0.02)
        left = {kind: look() - before[kind] for kind, look in kinds.items()}
    problems = [f"{kind} left behind: {', '.join(sorted(names))}" for kind, names in left.items() if names]
    if _MUJOCO_LOG.exists() and not log:
        problems.append(f"{_MUJOCO_LOG} written to {Path.cwd()}")
    assert not problems, "; ".join(problems)


@pytest.fixture
def opengl(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether a test draws with OpenGL, as its parameter says."""
    if request.param:
        monkeypatch.setenv("MUJOCO_GL", "0")
    return request.param
