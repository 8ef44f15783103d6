"""The loop: soft start, the controller's run, soft landing, torque off, on an absolute schedule; any lamp backend."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.pilot import PilotStep
from robolamp.ease import EASES, MINIMUM_JERK
from robolamp.errors import BusError, RobolampError
from robolamp.lamp import Lamp
from robolamp.runtime.clock import PERIOD, Schedule, Sleep, check_period
from robolamp.runtime.health import Action, Guard
from robolamp.runtime.result import Reporter, RunResult
from robolamp.runtime.soft_start import first_goal, present_pose, still_held
from robolamp.runtime.stop import StopRequest
from robolamp.signals import Command, LampBackend, Observation, Tick, Way

Array = NDArray[np.float64]

START_MOVE = 1.5
"""Time from the present pose to the neutral one [s]."""

START_HOLD = 0.5
"""Time the neutral pose is held before the controller takes over [s]."""

LANDING = 1.0
"""Time from the last goal to the rest pose [s]."""

REPLUG_TIME = 10.0
"""How long a port that was unplugged has to come back [s]."""

AGAIN_TIME = 60.0
"""How long servos may fall silent again and again before the lamp is back where it was [s]: a plug that is loose."""

TORQUE_ON = "torque on"
"""The event once torque is on."""

_REQUEST = "request to stop"
_LOOK = 0.1  # s: between two attempts to go on with a port that was unplugged


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
    limp: float = 0.0,
    clamped: bool = False,
) -> RunResult:
    """Run a controller on a lamp.

    Torque is off when this returns or raises, whatever happened. A first stop request or a guard lands the lamp; a
    second request, a bus that nothing can be told to any more, or a computer that slept meanwhile, turns torque off at
    once. A callback that raises is not called again and the lamp is landed; what it raised is a fault of the result.

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
        reconnect: Called every 0.1 s for up to REPLUG_TIME after the servos fell silent altogether (a port unplugged),
            again where they do before the run goes on; returns False, or raises BusError with what is missing, while
            they are not there yet. Once it returns True the run goes on: goal := present, torque on, softly back to the
            last goal; its clock stood meanwhile. It raises SafetyError for a lamp that is back and not fit, which ends
            the run. None: the run ends at once, and the servos' watchdogs hold the lamp.
        limp: How long a run that finished is watched once its torque is off [s]: ticks of phase "limp", whose goals
            were not sent.
        clamped: Whether the base is clamped, so that the foot sensor is not asked whether to go on.

    Returns:
        How it went.

    Raises:
        SafetyError: The period is too long for the servos' watchdog or too short for the bus, or a joint is so far
            outside its limits that its first goal would jump; torque stays off.
        BusError: The lamp's pose cannot be read, or its torque cannot be turned on.
    """
    check_period(period, lamp, backend.traits.tick_time)
    reporter = Reporter(on_tick, on_event)
    loop = _Loop(backend, lamp, period, reporter, stop or StopRequest(), powered, reconnect, clamped)
    try:
        if loop.begin():
            loop.start()
            loop.pilot(pilot, duration)
            loop.land()
            if limp:
                loop.watch(limp)
    except _Cut as cut:
        loop.cut(cut.reason)
    finally:
        backend.torque(False)
        loop.confirm()
    return loop.end()


class _Gone(Exception):
    """The servos fell silent altogether once more, before the lamp was back where it was."""


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
    """One run: the schedule, and what every phase does with a tick."""

    def __init__(
        self,
        backend: LampBackend,
        lamp: Lamp,
        period: float,
        reporter: Reporter,
        stop: StopRequest,
        powered: bool,
        reconnect: Callable[[], bool] | None,
        clamped: bool,
    ) -> None:
        self._backend = backend
        self._clock = backend.clock
        self._lamp = lamp
        self._period = period
        self._reporter = reporter
        self._say = reporter.say
        self._stop = stop
        self._guard = Guard(lamp, backend.traits, powered=powered, clamped=clamped)
        self._watching = not powered
        self._reconnect = reconnect
        self._away = False  # whether the servos fell silent and the lamp is not back where it was
        self._kept = ""  # what keeps servos that are back from going on
        self._sleep = Sleep(backend.clock)
        self._result = RunResult()
        self._goal = np.zeros(len(lamp.joints))
        self._schedule = Schedule(backend.clock, period)
        self._contact = True
        self._landing = False
        self._powered = False  # whether torque may have been on
        self._holding = ""  # joints not confirmed to be without torque

    def begin(self) -> bool:
        """See where every joint is, then turn torque on, unless a stop has been asked for already."""
        self._goal = first_goal(present_pose(self._backend, self._lamp), self._lamp, self._period)
        if self._stop.requests:
            self._finish("stopped", _REQUEST)
            return False
        self._awake()
        self._power()
        self._schedule.begin()
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
                begun = moment.scheduled - self._result.paused
            time = moment.scheduled - begun - self._result.paused
            if self._ended or time > duration - self._period / 2:
                self._close("landing", moment, self._goal)
                return
            if np.isfinite(moment.observation.angle).all():
                step = pilot.step(moment.observation, time)
                self._result.hops, self._contact = step.hops, step.contact
                self._result.interventions = step.interventions
                self._measure(step.way)
                self._close("run", moment, step.goal, step.inputs, step.outputs)
            else:
                self._result.held_ticks += 1
                self._close("run", moment, self._goal)

    def land(self) -> None:
        """Move softly to the rest pose."""
        self._landing = True
        self._say("info", "landing")
        self._move("landing", self._lamp.rest, LANDING, LANDING)

    def watch(self, duration: float) -> None:
        """Turn torque off, unless the run ended early, and log how the joints move by themselves."""
        if self._ended:
            return
        self._backend.torque(False)
        self._say("info", "limp")
        for _ in range(round(duration / self._period)):
            scheduled, began, _ = self._schedule.wait()
            self._awake()
            if self._stop.requests:
                return
            observation = self._backend.observe()
            self._hand_out("limp", _Moment(scheduled, began, self._clock.now(), observation))

    def cut(self, reason: str) -> None:
        """Take note that the run ends at once."""
        self._result.ended, self._result.reason = "cut", reason
        self._say("error", f"torque off at once: {reason}")

    def confirm(self) -> None:
        """See whether every servo's torque is off; say so aloud if it may not be."""
        held = still_held(self._backend, powered=self._powered)
        self._guard.faults.update(f"{name}: torque {how} on at the end" for name, how in held.items())
        self._holding = ", ".join(held)
        if held:
            self._say("error", f"torque may still be on: {self._holding}; switch the supply off, or `robolamp stop`")

    def end(self) -> RunResult:
        """Return how it went; a run after which torque may still be on did not end well."""
        self._reporter.announce(self._guard.faults)
        result = self._result
        result.faults = dict(self._guard.faults)
        if not self._holding:
            self._say("info", f"torque off; {result.ended}")
        elif result.ended != "cut":
            text = f"torque may still be on: {self._holding}"
            result.ended, result.reason = "cut", f"{result.reason}; {text}" if result.reason else text
        if self._reporter.broken:
            result.faults[self._reporter.failure] = 1
        return result

    def _power(self) -> None:
        if self._watching:
            self._say("info", "watching, torque stays off")
            return
        self._powered = True
        self._backend.torque(True)
        self._say("info", TORQUE_ON)

    def _resume(self, reason: str, target: Array) -> None:
        """Wait for servos that fell silent altogether, and bring the lamp softly to where it was to be.

        The run's time stands from the tick that was lost to the one after the soft move, however often they fall silent
        again before that.

        Args:
            reason: Why it is asked.
            target: Goal from which the phase goes on, shape (n,) [rad].

        Raises:
            _Cut: They did not come back in time or not fit, or a stop was asked for meanwhile.
            _Gone: They fell silent while the lamp was brought to where it was; whoever does that waits again.
        """
        if self._away:
            raise _Gone(reason)
        due, lost = self._schedule.due, self._clock.now()
        self._away = True
        while self._away:
            self._wait_for_return(reason)
            try:
                self._move("start", target, START_MOVE, START_MOVE)
                self._away = False
            except _Gone as again:
                reason = str(again)
                if self._clock.now() - lost > AGAIN_TIME:
                    raise _Cut(f"{reason}; silent again and again for {AGAIN_TIME:g} s") from None
        paused = self._schedule.due - due
        self._result.paused += paused
        self._say("info", f"goes on after {self._clock.now() - lost:.1f} s; paused {paused:.4f} s")

    def _wait_for_return(self, reason: str) -> None:
        """Wait for servos that fell silent altogether, until each of them holds its joint where it is."""
        if self._reconnect is None or self._ended or self._stop.requests:
            raise _Cut(reason)
        lost, self._kept = self._clock.now(), ""
        self._say("error", f"{reason}; waiting up to {REPLUG_TIME:g} s for it to come back")
        try:
            end = self._clock.now() + REPLUG_TIME
            while not (back := self._hold_again()) and self._clock.now() <= end and not self._stop.requests:
                self._clock.sleep_until(self._clock.now() + _LOOK)
        except RobolampError as error:
            raise _Cut(f"{reason}; it came back, but {error.message}") from None
        if not back and self._stop.requests:
            raise _Cut(f"{_REQUEST} while waiting for it: {reason}")
        if not back:
            kept = f": {self._kept}" if self._kept else ""
            raise _Cut(f"{reason}; the lamp was not back in {REPLUG_TIME:g} s{kept}")
        self._result.replugs += 1
        self._guard.resume()
        self._schedule.begin()
        self._say("warning", f"back after {self._clock.now() - lost:.1f} s; going softly to where it was")

    def _hold_again(self) -> bool:
        """Try to reach the servos again, and to hold each joint where it is."""
        assert self._reconnect
        self._awake()
        self._kept = ""
        try:
            if not self._reconnect() or self._stop.requests:
                return False
            self._note_torque()
            self._goal = first_goal(present_pose(self._backend, self._lamp), self._lamp, self._period)
            self._power()
        except BusError as error:  # gone again, or not ready yet
            self._kept = str(error)
            return False
        return True

    def _note_torque(self) -> None:
        """Note whose torque went off meanwhile: where it hung is not where the run left it."""
        off = self._backend.observe().health.torque == 0
        for index in np.flatnonzero(off & self._powered):
            text = (
                f"{self._lamp.names[index]}: its torque was off when it came back; it was without supply or restarted"
            )
            self._say("warning", text)
            self._guard.faults[text] += 1

    def _awake(self) -> None:
        """End the run if the computer slept: the servos' watchdogs have stopped the lamp meanwhile.

        Raises:
            _Cut: It did.
        """
        if reason := self._sleep.reason():
            raise _Cut(reason)

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
            self._close(phase, moment, source + (target - source) * EASES[MINIMUM_JERK](time / move))
            if time > length - self._period / 2:
                return

    def _next(self) -> _Moment:
        """Wait for the next tick that is not past, observe, and judge whether to go on."""
        scheduled, began, missed = self._schedule.wait()
        self._awake()
        self._result.missed_ticks += missed
        observation = self._backend.observe()
        read_done = self._clock.now()
        verdict = self._guard.check(observation)
        self._reporter.announce(self._guard.faults)
        if verdict == Action.CUT:
            self._resume(self._guard.reason, self._goal)
            return self._next()
        if self._stop.requests > 1:
            raise _Cut("second request to stop")
        if not self._ended and verdict == Action.LAND:
            self._finish("guard", self._guard.reason)
        elif not self._ended and not self._landing and self._stop.requests:
            self._finish("stopped", _REQUEST)
        elif not self._ended and not self._landing and self._reporter.broken:
            self._finish("stopped", self._reporter.failure)
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
        self._hand_out(phase, moment, inputs, outputs)

    def _measure(self, way: Way | None) -> None:
        before = 0 if self._result.way is None else self._result.way.unlike
        self._result.way = way
        if way is not None and way.unlike > before:
            self._say("warning", f"a step unlike those that the odometer was learnt from, at {way.length * 100:.1f} cm")

    def _hand_out(self, phase: str, moment: _Moment, inputs: Array | None = None, outputs: Array | None = None) -> None:
        tick = Tick(
            index=self._result.ticks,
            phase=phase,
            scheduled=moment.scheduled,
            began=moment.began,
            read_done=moment.read_done,
            write_done=self._clock.now(),
            observation=moment.observation,
            goal=self._goal,
            inputs=np.empty(0) if inputs is None else inputs,
            outputs=np.empty(0) if outputs is None else outputs,
            interventions=self._result.interventions,
            hops=self._result.hops,
            contact=self._contact,
            way=self._result.way,
        )
        self._result.ticks += 1
        self._reporter.tick(tick)
