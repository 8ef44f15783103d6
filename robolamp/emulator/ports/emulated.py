"""What real time and lockstep need of an emulated lamp or of bare servos: one interface."""

from __future__ import annotations

from typing import Protocol

from robolamp.emulator.faults.injector import Injector
from robolamp.emulator.line.line import Line, Reply


class Emulated(Protocol):
    """Servos on a line, and perhaps a foot sensor, whose time the caller sets.

    Attributes:
        line: What connects the servos.
        injector: What lets things go wrong.
    """

    line: Line
    injector: Injector

    @property
    def time(self) -> float:
        """How far the physics has come [s]."""
        ...

    @property
    def timestep(self) -> float:
        """Physics step [s]."""
        ...

    def advance_to(self, time: float) -> None:
        """Let the physics run up to a time [s]."""
        ...

    def receive(self, data: bytes, time: float) -> list[Reply]:
        """Take bytes from the client at a time [s] and return the servos' answers."""
        ...

    def frames(self, time: float) -> bytes:
        """Return the foot sensor's frames up to a time [s] that were not yet handed out."""
        ...
