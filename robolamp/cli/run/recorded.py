"""A gesture recorded by hand: the run in which a person moves the lamp, and the gesture made of its log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive, drive
from robolamp.cli.run.outcome import ended, tidying
from robolamp.cli.run.stages import BY_HAND, SOFT
from robolamp.errors import RobolampError, SafetyError
from robolamp.lamp import Lamp
from robolamp.log.reader import read_run
from robolamp.pose.hand_pilot import BAND, HandPilot
from robolamp.pose.recording import Simplified, simplify
from robolamp.robot.connection import Connection
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.stop import StopRequest


@dataclass(frozen=True)
class Hand:
    """A person who moves the lamp, where a controller would.

    Attributes:
        band: As for `HandPilot`.
    """

    band: float
    name: str = "your hand"
    planned: bool = False

    @property
    def texts(self) -> Mapping[str, str]:
        """There are none."""
        return {}

    def pilot(self, lamp: Lamp) -> HandPilot:
        """Return what follows the hand.

        Args:
            lamp: Limits and slew.
        """
        return HandPilot(lamp, self.band)


def recorded(
    setup: Setup,
    name: str,
    ports: tuple[str, str] | Connection,
    log: Path,
    seconds: float,
    soft: bool,
    tolerance: float,
    frames: int,
    quiet: bool,
) -> Simplified:
    """Record what a hand does to the lamp, and return a gesture of few key frames that does the same.

    Args:
        setup: The lamp.
        name: What to call the gesture.
        ports: Serial ports of servos and foot sensor, or what they are reached by.
        log: The log to write.
        seconds: How long it is recorded [s].
        soft: Whether the servos carry the lamp's weight; else torque is off.
        tolerance: How far a joint may be off the recording [rad].
        frames: Most key frames.
        quiet: No live view.

    Raises:
        BusError: A port does not exist or does not answer, or a servo is missing.
        SafetyError: The lamp is in no state for it, the run ended for a fault, or nothing was moved.
        FileError: The log cannot be written.
    """
    reached = ports if isinstance(ports, Connection) else Connection.real(*ports, MonotonicClock())
    stage = SOFT if soft else BY_HAND
    plan = Drive(setup, Hand(BAND if soft else 0.0), math.nan, seconds, "lamp", log, stage=stage, clamped=True)
    try:
        with tidying(plan), StopRequest() as stop:
            result = drive(plan, reached, stop, quiet)
        if result.ended not in ("finished", "stopped") or not plan.phases["run"]:
            raise SafetyError(f"{ended(result)}; nothing is recorded", name)
        run = read_run(log)
        rows = run.phase == "run"
        return simplify(name, run.measured_at[rows], run.angle[rows], setup.lamp, tolerance, frames)
    except RobolampError:
        log.unlink(missing_ok=True)  # it would be in the way of the next try
        raise
