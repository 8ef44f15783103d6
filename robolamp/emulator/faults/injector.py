"""What carries a fault script out: damages packets, silences servos, and keeps the log of what it did.

Whether and how a packet is damaged follows from the script's seed, its stream and its number in it alone, never from
when it comes: the same packets meet the same faults, in lockstep and on pseudo-terminals.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from robolamp.emulator.faults.script import DAMAGES, STREAMS, Event, Faults, Rates

_ALL = Rates()


@dataclass(frozen=True)
class Injection:
    """One fault that was injected.

    Attributes:
        time: When, since the emulator started [s].
        what: One of `faults.EVENTS`, or that with " over" when it has passed.
        where: The stream and packet number, the servo, or the port that was hit.
    """

    time: float
    what: str
    where: str

    def line(self) -> str:
        """Return it as one line of JSON."""
        return json.dumps({"time": round(self.time, 6), "what": self.what, "where": self.where})


class Injector:
    """Carries a fault script out.

    Args:
        faults: The script.
        ids: Ids of the servos at the start, in their order.
        act: Called with the index of a servo and the event that hits it once: reboot, id_lost, overload.

    Attributes:
        injections: All so far, in order.
        report: Called with each injection as it happens; None: nothing is.
    """

    def __init__(
        self,
        faults: Faults,
        ids: Sequence[int],
        act: Callable[[int, Event, float], None],
    ) -> None:
        self.injections: list[Injection] = []
        self._faults = faults
        self._ids = list(ids)
        self._act = act
        self.report: Callable[[Injection], None] | None = None
        self._numbers: dict[str, int] = dict.fromkeys(STREAMS, 0)
        self._pending = sorted(
            (event for event in faults.events if event.what not in DAMAGES), key=lambda event: event.at
        )
        self._lasting: list[Event] = []
        self._unplugged = [event for event in faults.events if event.what == "unplugged"]
        self._left = {id(event): event.packets for event in faults.events if event.what in DAMAGES}

    def poll(self, time: float) -> None:
        """Let events happen whose moment has come, and end those that have lasted.

        Args:
            time: Now [s].
        """
        while self._pending and self._pending[0].at <= time:
            event = self._pending.pop(0)
            self._note(event.at, event.what, _where(event))
            if event.lasts:
                self._lasting.append(event)
            elif event.servo in self._ids:
                self._act(self._ids.index(event.servo), event, event.at)
        for event in [event for event in self._lasting if event.at + event.lasts <= time]:
            self._lasting.remove(event)
            self._note(event.at + event.lasts, f"{event.what} over", _where(event))

    def silent(self, index: int, time: float) -> bool:
        """Return whether a servo neither hears nor answers at a time [s]."""
        self.poll(time)
        return any(event.what == "silent" and event.servo == self._ids[index] for event in self._lasting)

    def sag(self) -> float:
        """Return by how much the supply sags now [V]."""
        return sum(event.volts for event in self._lasting if event.what == "sag")

    def unplugged(self, port: str, time: float) -> bool:
        """Return whether a port, one of `faults.PORTS`, is unplugged at a time.

        Args:
            port: Which.
            time: The client's [s]: the servos may be ahead of it, at the end of a packet that is still on the line.
        """
        return any(event.port == port and event.at <= time < event.at + event.lasts for event in self._unplugged)

    def foot(self, what: str) -> bool:
        """Return whether the foot sensor is "silent", "stuck" or sends "rubbish" now."""
        return any(event.what == f"foot_{what}" for event in self._lasting)

    def noise(self, length: int) -> bytes:
        """Return bytes that mean nothing: a rubbish frame, other for each frame."""
        return self._random("foot", self._numbers["foot"]).bytes(length)

    def packet(self, stream: str, data: bytes, time: float) -> list[tuple[float, bytes]]:
        """Return what arrives of a packet: none, one or two pieces, each with how much later it comes [s].

        Args:
            stream: One of `faults.STREAMS`.
            data: The whole packet.
            time: When it should arrive [s].
        """
        self._numbers[stream] += 1
        number = self._numbers[stream]
        rates = self._faults.rates.get(stream, _ALL)
        found = self._planned(stream, number, time)
        if found is None and not rates.any:
            return [(0.0, data)]
        random = self._random(stream, number)
        what, late_by = found or (_drawn(rates, float(random.random())), rates.late_by)
        if not what:
            return [(0.0, data)]
        self._note(time, what, f"{stream} {number}")
        if what == "dropped":
            return []
        if what == "duplicated":
            return [(0.0, data), (0.0, data)]
        if what == "late":
            return [(late_by, data)]
        if what == "truncated":
            return [(0.0, data[: int(random.integers(1, len(data)))])]
        damaged = bytearray(data)
        damaged[int(random.integers(len(data)))] ^= 1 << int(random.integers(8))
        return [(0.0, bytes(damaged))]

    def _planned(self, stream: str, number: int, time: float) -> tuple[str, float] | None:
        """Return the damage that an event holds for a packet, and by how much it makes it late [s]."""
        for event in self._faults.events:
            if self._left.get(id(event), 0) and event.stream == stream:
                due = event.packet <= number if event.packet else event.at <= time
                if due:
                    self._left[id(event)] -= 1
                    return event.what, event.lasts
        return None

    def _random(self, stream: str, number: int) -> np.random.Generator:
        return np.random.default_rng([self._faults.seed, STREAMS.index(stream), number])

    def _note(self, time: float, what: str, where: str) -> None:
        injection = Injection(time, what, where)
        self.injections.append(injection)
        if self.report:
            self.report(injection)


def _drawn(rates: Rates, chance: float) -> str:
    for damage in DAMAGES:
        chance -= getattr(rates, damage)
        if chance < 0.0:
            return damage
    return ""


def _where(event: Event) -> str:
    if event.what == "unplugged":
        return f"{event.port} port"
    if event.what.startswith("foot_"):
        return "foot sensor"
    return "supply" if event.what == "sag" else f"servo {event.servo}"
