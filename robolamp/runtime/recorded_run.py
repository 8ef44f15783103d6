"""Recording a run: the lamp opened, the loop run, every tick and event logged, all closed, and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from robolamp.lamp import Lamp
from robolamp.log.run_context import settings_context
from robolamp.log.schemas import ANSWER_WIRE
from robolamp.log.writer import LogWriter
from robolamp.runtime.loop import TORQUE_ON, Pilot, run
from robolamp.runtime.result import RunResult
from robolamp.runtime.stop import StopRequest
from robolamp.signals import LampBackend, Tick


class RecordedPilot(Pilot, Protocol):
    """A pilot that knows how often it is asked."""

    control_period: float


class Inspected(Protocol):
    """A lamp that tells, once it is open, how its servos are read and set.

    Attributes:
        notices: What opening found that is not wrong, but could be better.
        mended: What opening mended.
    """

    notices: list[str]
    mended: list[str]

    @property
    def answer_wire_time(self) -> float:
        """How long a tick's questions and answers are on the line [s]."""
        ...

    def settings(self) -> Mapping[str, Mapping[str, int]]:
        """Return what the servos are set to, by joint and register, in counts."""
        ...


@dataclass(frozen=True)
class Audience:
    """Who hears of a run beside its log.

    Attributes:
        tick: Called with every tick once it is logged.
        event: Called with "info", "warning" or "error" and a line of text.
    """

    tick: Callable[[Tick], None] = lambda tick: None
    event: Callable[[str, str], None] = lambda level, text: None


@dataclass(frozen=True)
class RunLog:
    """Where a run is recorded.

    Attributes:
        path: The file.
        context: What it says of the run (see `robolamp.log.run_context`).
        epoch: Nanoseconds since the epoch at a virtual clock's 0; None: the run is in real time.
    """

    path: Path
    context: Mapping[str, str]
    epoch: int | None = None


def record_run(
    backend: LampBackend,
    pilot: RecordedPilot,
    lamp: Lamp,
    to: RunLog,
    *,
    duration: float,
    stop: StopRequest,
    inspected: Inspected | None = None,
    audience: Callable[[], AbstractContextManager[Audience]] = lambda: nullcontext(Audience()),
    powered: bool = True,
    reconnect: Callable[[], bool] | None = None,
    limp: float = 0.0,
    clamped: bool = False,
) -> RunResult:
    """Open a lamp, run a controller on it, log all of it, and close the lamp, whatever happens.

    Args:
        backend: The lamp, not yet opened.
        pilot: The controller, ready.
        lamp: The lamp's description.
        to: Where it is recorded.
        duration: Length of the run phase [s].
        stop: Watched for requests to stop.
        inspected: What tells of the lamp's servos, for the log; None: nothing does.
        audience: Makes who else hears of it, once the lamp is open.
        powered: As for `run`.
        reconnect: As for `run`.
        limp: As for `run`.
        clamped: As for `run`.

    Returns:
        How it went; a log that ended early or has gaps is among the faults.

    Raises:
        BusError: A port does not exist or does not answer, or a servo is missing.
        SafetyError: The lamp is in no state to be moved.
        FileError: The log cannot be written.
    """
    context = dict(to.context)
    try:
        backend.open()
        if inspected:
            context[ANSWER_WIRE] = repr(inspected.answer_wire_time)
        with (
            LogWriter(
                to.path, context=context, joints=lamp.names, epoch=to.epoch, lossless=to.epoch is not None
            ) as log,
            audience() as hears,
        ):
            stopped = ""

            def event(level: str, text: str) -> None:
                log.event(level, text, backend.clock.now())
                if inspected and text == TORQUE_ON:
                    log.context(settings_context(inspected.settings()))
                hears.event(level, text)

            def tick(entry: Tick) -> None:
                nonlocal stopped
                log.tick(entry)
                if log.error != stopped:
                    stopped = log.error
                    hears.event("error", f"logging stopped, the run goes on: {to.path}: {log.error}")
                hears.tick(entry)

            if inspected:
                for text in inspected.mended:
                    event("warning", f"mended: {text}")
                for text in inspected.notices:
                    event("info", text)
            result = run(
                backend, pilot, lamp, period=pilot.control_period, duration=duration, on_tick=tick, on_event=event,
                stop=stop, powered=powered, reconnect=reconnect, limp=limp, clamped=clamped,
            )  # fmt: skip
    finally:
        backend.close()
    result.log_error = log.error
    if log.error:
        result.faults[f"log: {log.error}"] = 1
    if log.dropped:
        result.faults["log: entries dropped, the disk did not keep up"] = log.dropped
    return result
