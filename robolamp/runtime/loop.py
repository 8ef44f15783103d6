"""The loop: soft start, the controller's run, soft landing, torque off, on an absolute schedule; any lamp backend."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.pilot import PilotStep
from robolamp.errors import BusError, RobolampError, SafetyError
from robolamp.lamp import Lamp
from robolamp.runtime.health import Guard, Verdict
from robolamp.runtime.result import RunResult
from robolamp.runtime.schedule import PERIOD, check_period
from robolamp.runtime.stop import StopRequest
from robolamp.signals import Command, LampBackend, Observation, Tick

Array = NDArray[np.float64]

START_MOVE = 1.5
"""Time from the present pose to the neutral one [s]."""

START_HOLD = 0.5
"""Time the neutral pose is held before the controller takes over [s]."""

LANDING = 1.0
"""Time from the last goal to the rest pose [s]."""

REPLUG_TIME = 10.0
"""How long a port that was unplugged has to come back [s]."""

_REPLUG_LOOK = 0.1  # s: between two attempts to open it
_REQUEST = "request to stop"
_LOOKS = 5  # observations taken to see every joint before torque goes on, and every torque off at the end


class Pilot(Protocol):
    """A controller ready to run: compiled, its envelope set to start from the neutral pose."""

    def step(self, observation: Observation, time: float) -> PilotStep:
        """Return what to do.

        Args:
            observation: One without a missing angle.
            time: Since the run phase began [s], by the schedule.
        """
        ...


def run(
    backend: LampBackend,
    pilot: Pilot,
    lamp: Lamp,
    *,
    period: float = PERIOD,
    duration: float = 5.0,
    on_tick: Callable[[Tick], None] | None = None,
    on_event: Callable[[str, str], None] | None = None,
    stop: StopRequest | None = None,
    powered: bool = True,
    reconnect: Callable[[], bool] | None = None,
) -> RunResult:
    """Run a controller on a lamp.

    Torque is off when this returns or raises, whatever happened. A first stop request or a guard lands the lamp; a
    second request, or a bus that nothing can be told to any more, turns torque off at once. A callback that raises is
    not called again and the lamp is landed; what it raised is raised again at the end.

    Args:
        backend: The lamp, open.
        pilot: The controller, ready: nothing is compiled once torque is on.
        lamp: Its description: limits, rest pose.
        period: Control period [s].
        duration: Length of the run phase [s].
        on_tick: Called with every tick after its goals were sent (log, display).
        on_event: Called with "info", "warning" or "error" and a line of text: phases, new faults, the end.
        stop: Watched for requests to stop.
        powered: False: torque is never turned on and the goals go nowhere (the backend's affair); the rest is the same.
        reconnect: Called every 0.1 s for up to REPLUG_TIME after the servos fell silent altogether (a port unplugged);
            once it returns True the run goes on: goal := present, torque on, softly back to the last goal. None: the
            run ends then, and the servos' watchdogs hold the lamp.

    Returns:
        How it went.

    Raises:
        SafetyError: The period is too long for the servos' watchdog or too short for the bus, or a joint is so far
            outside its limits that its first goal would jump; torque stays off.
        BusError: The lamp's pose cannot be read, or its torque cannot be turned on.
    """
    check_period(period, lamp)
    loop = _Loop(backend, lamp, period, on_tick, on_event, stop or StopRequest(), powered, reconnect)
    try:
        if loop.begin():
            loop.start()
            loop.pilot(pilot, duration)
            loop.land()
    except _Cut as cut:
        loop.cut(cut.reason)
    finally:
        backend.torque(False)
        loop.confirm()
    result = loop.end()
    if loop.broken:
        raise loop.broken
    return result


def smooth(share: float) -> float:
    """Return the minimum-jerk curve (Flash and Hogan 1985): 0 at 0, 1 at 1, at rest at both ends.

    Args:
        share: Elapsed share of the movement; held at the ends outside 0 to 1.
    """
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


class _Cut(Exception):
    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


@dataclass
class _Moment:
    scheduled: float
    began: float
    read_done: float
    observation: Observation


class _Loop:
    """One run: the schedule, and what every phase does with a tick.

    Attributes:
        broken: What a callback raised first; None while none has.
    """

    def __init__(
        self,
        backend: LampBackend,
        lamp: Lamp,
        period: float,
        on_tick: Callable[[Tick], None] | None,
        on_event: Callable[[str, str], None] | None,
        stop: StopRequest,
        powered: bool,
        reconnect: Callable[[], bool] | None,
    ) -> None:
        self._backend = backend
        self._clock = backend.clock
        self._lamp = lamp
        self._period = period
        self._on_tick = on_tick
        self._on_event = on_event
        self._stop = stop
        self._guard = Guard(lamp, powered=powered)
        self._watching = not powered
        self._reconnect = reconnect
        self._paused = 0.0  # time of the run phase in which the controller did not drive [s]
        self._result = RunResult()
        self._goal = np.zeros(len(lamp.joints))
        self._slot = 0
        self._origin = 0.0
        self._announced = 0
        self._contact = True
        self._landing = False
        self._powered = False  # whether torque may have been on
        self._holding: tuple[str, ...] = ()  # joints not confirmed to be without torque
        self.broken: Exception | None = None

    def begin(self) -> bool:
        """See where every joint is, then turn torque on, unless a stop has been asked for already."""
        angle = self._backend.observe().angle
        for _ in range(_LOOKS - 1):
            if np.isfinite(angle).all():
                break
            angle = self._backend.observe().angle
        if not np.isfinite(angle).all():
            silent = ", ".join(name for name, value in zip(self._lamp.names, angle, strict=True) if np.isnan(value))
            raise BusError(f"no angle from {silent} in {_LOOKS} readings; torque stays off")
        self._goal = np.clip(angle, self._lamp.lower, self._lamp.upper)
        self._check_first(angle)
        if self._stop.requests:
            self._finish("stopped", _REQUEST)
            return False
        self._power()
        self._origin = self._clock.now()
        return True

    def start(self) -> None:
        """Move softly to the neutral pose, and hold it."""
        self._move("start", np.zeros(len(self._goal)), START_MOVE, START_MOVE + START_HOLD)

    def pilot(self, pilot: Pilot, duration: float) -> None:
        """Let the controller drive."""
        if self._ended:
            return
        self._say("info", "run")
        begun: float | None = None
        while True:
            moment = self._next()
            if begun is None:
                begun = moment.scheduled - self._paused
            time = moment.scheduled - begun - self._paused
            if self._ended or time > duration - self._period / 2:
                self._close("landing", moment, self._goal)
                return
            if np.isfinite(moment.observation.angle).all():
                step = pilot.step(moment.observation, time)
                self._result.hops, self._contact = step.hops, step.contact
                self._result.interventions = step.interventions
                self._close("run", moment, step.goal, step.inputs, step.outputs)
            else:
                self._result.held_ticks += 1
                self._close("run", moment, self._goal)

    def land(self) -> None:
        """Move softly to the rest pose."""
        self._landing = True
        self._say("info", "landing")
        self._move("landing", self._lamp.rest, LANDING, LANDING)

    def cut(self, reason: str) -> None:
        """Take note that the run ends at once."""
        self._result.ended, self._result.reason = "cut", reason
        self._say("error", f"torque off at once: {reason}")

    def confirm(self) -> None:
        """See whether every servo's torque is off; say so aloud if it may not be."""
        torque = self._backend.observe().health.torque
        for _ in range(_LOOKS - 1):
            if not torque.any():
                return
            torque = self._backend.observe().health.torque
        holding: list[str] = []
        for name, state in zip(self._lamp.names, torque, strict=True):
            if state > 0 or (state < 0 and self._powered):
                holding.append(name)
                self._guard.faults[f"{name}: torque {'still' if state > 0 else 'perhaps still'} on at the end"] += 1
        self._holding = tuple(holding)
        if holding:
            names = ", ".join(holding)
            self._say("error", f"torque may still be on: {names}; switch the supply off, or `robolamp stop`")

    def end(self) -> RunResult:
        """Return how it went; a run after which torque may still be on did not end well."""
        self._announce()
        result = self._result
        result.faults = dict(self._guard.faults)
        if not self._holding:
            self._say("info", f"torque off; {result.ended}")
        elif result.ended != "cut":
            text = f"torque may still be on: {', '.join(self._holding)}"
            result.ended, result.reason = "cut", f"{result.reason}; {text}" if result.reason else text
        return result

    def _check_first(self, angle: Array) -> None:
        """Refuse a first goal that would jump: what is outside the limits is brought to them in one tick."""
        step = self._lamp.slew * max(self._period, PERIOD)
        for joint, value, goal, most in zip(self._lamp.joints, angle, self._goal, step, strict=True):
            if abs(goal - value) > most:
                raise SafetyError(
                    f"{joint.name} stands at {value:.2f} rad, outside {joint.lower:g} to {joint.upper:g} rad by more "
                    f"than the {most:.2f} rad that its slew limit allows a tick; put the lamp upright by hand",
                    str(self._lamp.path),
                )

    def _power(self) -> None:
        if self._watching:
            self._say("info", "watching, torque stays off")
            return
        self._powered = True
        self._backend.torque(True)
        self._say("info", "torque on")

    def _resume(self, reason: str, target: Array) -> None:
        """Wait for servos that fell silent altogether, and bring the lamp softly to where it was to be.

        Args:
            reason: Why it is asked.
            target: Goal from which the phase goes on, shape (n,) [rad].

        Raises:
            _Cut: They did not come back in time, or a stop was asked for meanwhile.
        """
        if self._reconnect is None or self._ended or self._stop.requests:
            raise _Cut(reason)
        lost = self._clock.now()
        self._say("error", f"{reason}; waiting up to {REPLUG_TIME:g} s for it to come back")
        while not self._reconnect():
            if self._clock.now() - lost > REPLUG_TIME or self._stop.requests:
                raise _Cut(reason)
            self._clock.sleep_until(self._clock.now() + _REPLUG_LOOK)
        angle = self._backend.observe().angle
        if not np.isfinite(angle).all():
            raise _Cut(f"{reason}; it came back without an angle")
        self._goal = np.clip(angle, self._lamp.lower, self._lamp.upper)
        try:
            self._check_first(angle)
            self._power()
        except RobolampError as error:
            raise _Cut(f"{reason}; it came back, but {error.message}") from None
        self._result.replugs += 1
        self._origin, self._slot = self._clock.now(), 0
        self._say("warning", f"back after {self._clock.now() - lost:.1f} s; going softly to where it was")
        self._move("start", target, START_MOVE, START_MOVE)
        self._paused += self._clock.now() - lost

    @property
    def _ended(self) -> bool:
        return self._result.ended != "finished"

    def _move(self, phase: str, target: Array, move: float, length: float) -> None:
        """Move from the last goal to a pose in `move` seconds; the phase takes `length`.

        Its time counts ticks run, not ticks due: after a stall the goal goes on from where it was.
        """
        source = self._goal
        time = 0.0
        while True:
            moment = self._next()
            time += self._period
            if self._ended and not self._landing:
                self._close(phase, moment, self._goal)
                return
            self._close(phase, moment, source + (target - source) * smooth(time / move))
            if time > length - self._period / 2:
                return

    def _next(self) -> _Moment:
        """Wait for the next tick that is not past, observe, and judge whether to go on."""
        scheduled = self._origin + self._slot * self._period
        self._clock.sleep_until(scheduled)
        began = self._clock.now()
        missed = int((began - scheduled) / self._period)
        self._result.missed_ticks += missed
        scheduled += missed * self._period
        self._slot += missed + 1
        observation = self._backend.observe()
        read_done = self._clock.now()
        verdict = self._guard.check(observation)
        self._announce()
        if verdict == Verdict.CUT:
            self._resume(self._guard.reason, self._goal)
            return self._next()
        if self._stop.requests > 1:
            raise _Cut("second request to stop")
        if not self._ended and verdict == Verdict.LAND:
            self._finish("guard", self._guard.reason)
        elif not self._ended and not self._landing and self._stop.requests:
            self._finish("stopped", _REQUEST)
        elif not self._ended and not self._landing and self.broken:
            self._finish("stopped", f"the log or display failed ({str(self.broken) or type(self.broken).__name__})")
        return _Moment(scheduled, began, read_done, observation)

    def _finish(self, ended: str, reason: str) -> None:
        self._result.ended, self._result.reason = ended, reason
        self._say("warning", f"{ended}: {reason}")

    def _close(
        self, phase: str, moment: _Moment, goal: Array, inputs: Array | None = None, outputs: Array | None = None
    ) -> None:
        """Send the goals and hand the tick out."""
        try:
            self._backend.command(Command(goal))
        except BusError as error:
            self._resume(str(error), goal)
            return
        except RobolampError as error:
            raise _Cut(str(error)) from None
        self._goal = goal
        tick = Tick(
            index=self._result.ticks,
            phase=phase,
            scheduled=moment.scheduled,
            began=moment.began,
            read_done=moment.read_done,
            write_done=self._clock.now(),
            observation=moment.observation,
            goal=goal,
            inputs=np.empty(0) if inputs is None else inputs,
            outputs=np.empty(0) if outputs is None else outputs,
            interventions=self._result.interventions,
            hops=self._result.hops,
            contact=self._contact,
        )
        self._result.ticks += 1
        if self._on_tick:
            try:
                self._on_tick(tick)
            except Exception as error:  # whatever it is: the lamp is not dropped in mid-hop for it
                self._on_tick = None
                self.broken = self.broken or error

    def _announce(self) -> None:
        """Report faults that are new."""
        for text in list(self._guard.faults)[self._announced :]:
            self._say("warning", text)
        self._announced = len(self._guard.faults)

    def _say(self, level: str, text: str) -> None:
        if self._on_event:
            try:
                self._on_event(level, text)
            except Exception as error:
                self._on_event = None
                self.broken = self.broken or error
