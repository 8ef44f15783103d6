"""Tells log and display what happens in a run; one that fails is not told again, and does not stop the lamp."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from robolamp.signals import Tick


class Reporter:
    """Hands out ticks and events.

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
