"""What a run came to."""

from __future__ import annotations

from dataclasses import dataclass, field

from robolamp.signals import Interventions


@dataclass
class RunResult:
    """How a run went.

    Attributes:
        ended: "finished", "stopped" (on request), "guard" (landed for a fault) or "cut" (torque off at once, or not
            confirmed to be off at the end).
        reason: Why, where it did not finish.
        ticks: Ticks that were run.
        missed_ticks: Ticks that were due and skipped because an earlier one took too long.
        held_ticks: Ticks of the run that held the last goal because an angle was missing.
        hops: Hops counted from the foot sensor.
        interventions: Totals of the envelope.
        replugs: How often the run went on after the servos' port had gone and come back.
        paused: Time between the goings and comings of that port in which the controller did not drive [s].
        faults: How many ticks showed each fault, by its text; a log or display that failed is one, too.
    """

    ended: str = "finished"
    reason: str = ""
    ticks: int = 0
    missed_ticks: int = 0
    held_ticks: int = 0
    hops: int = 0
    interventions: Interventions = field(default_factory=Interventions)
    replugs: int = 0
    paused: float = 0.0
    faults: dict[str, int] = field(default_factory=dict)
