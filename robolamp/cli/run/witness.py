"""Watches a run from between loop and lamp: was it the lamp that fell silent, or this computer that was late?"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from robolamp.dynamixel.bus import ATTEMPTS
from robolamp.errors import BusError, RobolampError
from robolamp.lateness import Lateness
from robolamp.robot.robot_lamp import WATCHDOG
from robolamp.runtime.health import ANGLE_AGE, FOOT_AGE_STOP
from robolamp.signals import Command, LampBackend, LampProxy, Observation

_SHARE = 0.5  # of a silence that the host must have been late for, to have caused it. Chosen: most of it

_FALL = 1.0  # what was late within this time before a fall may have caused it [s]. Chosen: a hop takes 0.6 s


@dataclass(frozen=True)
class Silence:
    """A time in which the lamp did not answer, long enough to end a run.

    Attributes:
        begin: Since when [s].
        end: When that was found [s].
        patience: How long an answer might have been late [s].
        landing: Whether the lamp was being landed already.
    """

    begin: float
    end: float
    patience: float
    landing: bool


@dataclass
class Watch:
    """What was seen of a run in real time; times are those of the monotonic clock.

    Attributes:
        loop: When the loop itself was late.
        began: When the lamp was first spoken to [s]; None: never, or not in real time.
        ended: When it was last spoken to [s].
        landing: Whether it is being landed.
        silence: The first that can have ended the run; None: there was none.
    """

    loop: Lateness = field(default_factory=Lateness)
    began: float | None = None
    ended: float = 0.0
    landing: bool = False
    silence: Silence | None = None

    def silent(self, since: float, patience: float) -> None:
        """Take note that the lamp does not answer, and has not since a time [s]."""
        if self.silence is None:
            self.silence = Silence(since, time.monotonic(), patience, self.landing)


@dataclass(frozen=True)
class Busy:
    """How late this computer was during a run.

    Attributes:
        late: The longest lateness [s].
        who: What was late: "emulator" or "loop".
        ended_it: Whether that is what ended the run, or let the lamp fall.
    """

    late: float = 0.0
    who: str = ""
    ended_it: bool = False

    def __str__(self) -> str:
        return f"This computer was busy: {self.who} late by {self.late * 1e3:.0f} ms"


def judged(watch: Watch, emulator: Lateness, ended: str, patience: float, fell: float | None = None) -> Busy:
    """Return how late this computer was in a run, and whether that ended it.

    It did where the lamp fell silent, something was late by more than the patience in force meanwhile, and most of
    the silence is explained by what was late; or where something was late by more than that as the lamp fell.

    Args:
        watch: What was seen of the run.
        emulator: When the emulator was late; empty where there is none.
        ended: How the run ended, as in `RunResult`.
        patience: How late an answer in the loop might be [s].
        fell: When the lamp fell [s]; None: it did not, or nobody knows.
    """
    if watch.began is None:
        return Busy()
    silence = watch.silence
    if fell is not None and ended == "finished":
        falling = _worst(watch, emulator, fell - _FALL, fell)
        return Busy(falling.late, falling.who, falling.late > patience)
    if silence is None or not (ended == "cut" or (ended == "guard" and not silence.landing)):
        return _worst(watch, emulator, watch.began, watch.ended)
    found = _worst(watch, emulator, silence.begin, silence.end)
    total = Lateness([*watch.loop.spans, *emulator.spans]).total(silence.begin, silence.end)
    explained = found.late > silence.patience and total >= _SHARE * (silence.end - silence.begin)
    return Busy(found.late, found.who, explained)


def _worst(watch: Watch, emulator: Lateness, begin: float, end: float) -> Busy:
    who = {"emulator": emulator.worst(begin, end), "loop": watch.loop.worst(begin, end)}
    name = max(who, key=lambda each: who[each])
    return Busy(who[name], name)


class Witness(LampProxy):
    """A lamp backend that passes everything on to another, and takes note of silences and of its caller's lateness.

    Args:
        backend: The lamp.
        watch: Where to note it.
        period: The loop's [s].
        patience: How long an answer may be late in the loop before it is a gap [s].
        opening: The same while the lamp is opened and its torque turned on [s].
    """

    def __init__(self, backend: LampBackend, watch: Watch, period: float, patience: float, opening: float) -> None:
        super().__init__(backend)
        self._watch = watch
        self._period = period
        self._patience, self._opening = patience, opening
        self._looked = self._used = math.nan  # when the last look began, and the CPU time used by then [s]

    def open(self) -> None:
        """Connect and check that everything is there."""
        self._watch.began = time.monotonic()
        self._patiently(self._backend.open)

    def torque(self, on: bool) -> None:
        """Turn torque on or off."""
        self._looked = math.nan  # this takes as long as it takes
        if on:
            self._patiently(lambda: self._backend.torque(True))
        else:
            self._backend.torque(False)

    def observe(self) -> Observation:
        """Read every sensor once.

        A look that begins late, but for the CPU time used since the last, or takes longer than one waits for answers,
        was held up by the host.
        """
        now, used = time.monotonic(), time.thread_time()
        if not math.isnan(self._looked):
            self._watch.loop.note(self._looked + self._period + used - self._used, now)
        seen = self._backend.observe()
        done = self._watch.ended = time.monotonic()
        whole = bool(np.isfinite(seen.angle).all())
        waits = 1 if whole and not seen.faults else 2 + len(seen.angle)  # for all; then in two readings and for each
        self._watch.loop.note(now + waits * self._patience, done)
        self._looked, self._used = (now, used) if whole else (math.nan, used)  # waiting for what is lost takes time
        age = max(float(seen.angle_age.max()), seen.foot_age if seen.foot_age > FOOT_AGE_STOP else 0.0)
        if age > ANGLE_AGE:
            self._watch.silent(max(done - age, self._watch.began or 0.0), self._patience)
        return seen

    def command(self, command: Command) -> None:
        """Send goals."""
        began = self._watch.ended
        try:
            self._backend.command(command)
        except RobolampError:
            self._watch.silent(began - WATCHDOG, self._patience)
            raise

    def _patiently(self, call: Callable[[], None]) -> None:
        began = time.monotonic()
        try:
            call()
        except BusError:
            self._watch.silent(max(began, time.monotonic() - ATTEMPTS * self._opening), self._opening)
            raise
        finally:
            self._watch.ended = time.monotonic()
