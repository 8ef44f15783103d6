"""What a run tells: its ticks and events while it goes on, and what it came to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from robolamp.signals import Interventions, Tick, Way


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
        way: How far the lamp came by its odometer; None: it has none.
        replugs: How often the run went on after the servos' port had gone and come back.
        paused: Time between the goings and comings of that port in which the controller did not drive [s].
        faults: How many ticks showed each fault, by its text; a log or display that failed is one, too.
        log_error: Why the log ended before the run; empty: it did not, or there is none.
    """

    ended: str = "finished"
    reason: str = ""
    ticks: int = 0
    missed_ticks: int = 0
    held_ticks: int = 0
    hops: int = 0
    interventions: Interventions = field(default_factory=Interventions)
    way: Way | None = None
    replugs: int = 0
    paused: float = 0.0
    faults: dict[str, int] = field(default_factory=dict)
    log_error: str = ""


class Reporter:
    """Hands ticks and events to log and display; one that fails is not told again, and does not stop the lamp.

    Args:
        on_tick: Called with every tick; None: nobody is.
        on_event: Called with "info", "warning" or "error" and a line of text; None: nobody is.

    Attributes:
        broken: What a callback raised first; None while none has.
    """

    def __init__(self, on_tick: Callable[[Tick], None] | None, on_event: Callable[[str, str], None] | None) -> None:
        self._on_tick, self._on_event = on_tick, on_event
        self._announced = 0
        self.broken: Exception | None = None

    @property
    def failure(self) -> str:
        """That something failed and what it said; empty where nothing has."""
        if self.broken is None:
            return ""
        return f"the log or display failed ({str(self.broken) or type(self.broken).__name__})"

    def tick(self, tick: Tick) -> None:
        """Hand out a tick."""
        if self._on_tick:
            try:
                self._on_tick(tick)
            except Exception as error:  # whatever it is: the lamp is not dropped in mid-hop for it
                self._on_tick = None
                self.broken = self.broken or error

    def say(self, level: str, text: str) -> None:
        """Hand out an event."""
        if self._on_event:
            try:
                self._on_event(level, text)
            except Exception as error:
                self._on_event = None
                self.broken = self.broken or error

    def announce(self, faults: Mapping[str, int]) -> None:
        """Hand out those faults, of all so far in the order they came, that are new."""
        for text in list(faults)[self._announced :]:
            self.say("warning", text)
        self._announced = len(faults)
