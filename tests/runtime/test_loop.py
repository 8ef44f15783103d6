from __future__ import annotations

import dataclasses
from typing import NoReturn

import numpy as np
import pytest

from robolamp.errors import BusError, SafetyError
from robolamp.robot.robot_lamp import WATCHDOG, servo_traits
from robolamp.runtime.clock import MAX_PERIOD
from robolamp.runtime.health import ANGLE_AGE
from robolamp.runtime.loop import LANDING, REPLUG_TIME, START_HOLD, START_MOVE, run
from robolamp.runtime.soft_start import RELEASE_TIME
from robolamp.runtime.stop import StopRequest
from robolamp.signals import Command, Observation, Tick

from .fake import LAMP, FakeClock, FakeLamp, Wave

START_TICKS = round((START_MOVE + START_HOLD) / 0.02)


def phases(ticks: list[Tick]) -> list[str]:
    """The phases in order, without repeats."""
    return [tick.phase for i, tick in enumerate(ticks) if i == 0 or ticks[i - 1].phase != tick.phase]


def test_a_whole_run() -> None:
    lamp, pilot, ticks, events = FakeLamp(), Wave(), [], []
    result = run(lamp, pilot, LAMP, duration=1.0, on_tick=ticks.append, on_event=lambda *event: events.append(event))
    assert phases(ticks) == ["start", "run", "landing"]
    assert lamp.torques == [True, False]
    assert (result.ended, result.missed_ticks, result.faults) == ("finished", 0, {})
    assert result.ticks == len(ticks) == len(lamp.goals)
    assert [tick.index for tick in ticks] == list(range(len(ticks)))
    assert len([tick for tick in ticks if tick.phase == "run"]) == 50
    assert pilot.times == pytest.approx(np.arange(50) * 0.02)
    assert (result.hops, result.interventions.slewed) == (50, 1)
    assert np.diff([tick.scheduled for tick in ticks]) == pytest.approx(0.02)
    assert all(tick.scheduled <= tick.began <= tick.read_done <= tick.write_done for tick in ticks)
    assert [level for level, _ in events] == ["info"] * len(events)


def test_soft_start_and_landing() -> None:
    lamp, ticks = FakeLamp(), []
    run(lamp, Wave(), LAMP, duration=0.5, on_tick=ticks.append)
    start = np.array([tick.goal for tick in ticks if tick.phase == "start"])
    assert len(start) == START_TICKS
    assert start[0] == pytest.approx([0.3, -0.2, 0.1], abs=1e-3)
    assert np.abs(start[-round(START_HOLD / 0.02) :]).max() == pytest.approx(0.0, abs=1e-12)
    landing = np.array([tick.goal for tick in ticks if tick.phase == "landing"])
    assert landing[-1] == pytest.approx(LAMP.rest)
    assert len(landing) == pytest.approx(LANDING / 0.02, abs=1)
    fastest = np.abs(np.diff(np.concatenate([start, landing[-len(landing) :]]), axis=0))[: len(start) - 1].max() / 0.02
    assert fastest < 0.5  # 0.3 rad in 1.5 s with a peak of 15/8 of the mean


def test_goals_between_phases_do_not_jump() -> None:
    lamp = FakeLamp()
    run(lamp, Wave(), LAMP, duration=1.3)
    steps = np.abs(np.diff(np.array(lamp.goals), axis=0))
    assert steps.max() < 0.04  # the wave itself: 0.3 rad x 6 rad/s x 0.02 s


def test_a_pose_outside_the_limits_is_moved_in_from_the_limit() -> None:
    lamp, ticks = FakeLamp(), []
    lamp.angle = LAMP.upper + 0.1
    run(lamp, Wave(), LAMP, duration=0.1, on_tick=ticks.append)
    assert all((tick.goal <= LAMP.upper).all() and (tick.goal >= LAMP.lower).all() for tick in ticks)


@pytest.mark.parametrize("at", [3, START_TICKS + 5])
def test_a_request_lands_the_lamp(at: int) -> None:
    stop, ticks = StopRequest(), []

    def on_tick(tick: Tick) -> None:
        ticks.append(tick)
        if tick.index == at:
            stop.request()

    lamp = FakeLamp()
    result = run(lamp, Wave(), LAMP, on_tick=on_tick, stop=stop)
    assert result.ended == "stopped"
    assert ticks[-1].phase == "landing"
    assert ticks[-1].goal == pytest.approx(LAMP.rest)
    assert len(ticks) <= at + 3 + LANDING / 0.02
    assert lamp.torques == [True, False]


def test_a_request_before_the_start_keeps_torque_off() -> None:
    stop, lamp = StopRequest(), FakeLamp()
    stop.request()
    result = run(lamp, Wave(), LAMP, stop=stop)
    assert (result.ended, result.ticks) == ("stopped", 0)
    assert True not in lamp.torques


def test_a_second_request_cuts() -> None:
    stop, ticks = StopRequest(), []

    def on_tick(tick: Tick) -> None:
        ticks.append(tick)
        if tick.index in (10, 15):
            stop.request()

    lamp = FakeLamp()
    result = run(lamp, Wave(), LAMP, on_tick=on_tick, stop=stop)
    assert (result.ended, result.reason, len(ticks)) == ("cut", "second request to stop", 16)
    assert lamp.torques == [True, False]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("x"), MemoryError()])
def test_torque_goes_off_on_any_exception(error: BaseException) -> None:
    class Broken(Wave):
        def step(self, observation: Observation, time: float) -> NoReturn:
            raise error

    lamp = FakeLamp()
    with pytest.raises(type(error)):
        run(lamp, Broken(), LAMP)
    assert lamp.torques == [True, False]


@pytest.mark.parametrize("at", [0, START_TICKS + 5])
def test_a_failing_tick_callback_lands_the_lamp(at: int) -> None:
    ticks: list[Tick] = []
    events: list[tuple[str, str]] = []

    def on_tick(tick: Tick) -> None:
        ticks.append(tick)
        if tick.index == at:
            raise OSError("disk")

    lamp = FakeLamp()
    result = run(lamp, Wave(), LAMP, on_tick=on_tick, on_event=lambda *event: events.append(event))
    failed = "the log or display failed (disk)"
    assert (result.ended, result.reason, result.ticks) == ("stopped", failed, len(lamp.goals))
    assert result.faults == {failed: 1}
    assert len(ticks) == at + 1  # not called again
    assert len(lamp.goals) == pytest.approx(at + 2 + LANDING / 0.02, abs=1)
    assert lamp.goals[-1] == pytest.approx(LAMP.rest)
    assert np.abs(np.diff(np.array(lamp.goals), axis=0)).max() < 0.04
    assert lamp.torques == [True, False]
    assert ("warning", "stopped: the log or display failed (disk)") in events


def test_a_failing_event_callback_lands_the_lamp() -> None:
    ticks: list[Tick] = []
    calls: list[str] = []

    def on_event(level: str, text: str) -> None:
        calls.append(text)
        if text == "run":
            raise BrokenPipeError("terminal")

    lamp = FakeLamp()
    result = run(lamp, Wave(), LAMP, on_tick=ticks.append, on_event=on_event)
    assert (result.reason, result.ticks) == ("the log or display failed (terminal)", len(ticks))
    assert calls == ["torque on", "run"]
    assert phases(ticks)[-1] == "landing"
    assert lamp.goals[-1] == pytest.approx(LAMP.rest)
    assert lamp.torques == [True, False]


def test_the_first_failure_is_the_one_told() -> None:
    def on_tick(tick: Tick) -> None:
        raise OSError("disk")

    def on_event(level: str, text: str) -> None:
        raise BrokenPipeError("terminal")

    lamp = FakeLamp()
    result = run(lamp, Wave(), LAMP, on_tick=on_tick, on_event=on_event)
    assert list(result.faults) == ["the log or display failed (terminal)"]
    assert lamp.goals[-1] == pytest.approx(LAMP.rest)


def test_a_stall_does_not_make_a_soft_move_jump() -> None:
    lamp, ticks = FakeLamp(), []

    def on_tick(tick: Tick) -> None:
        ticks.append(tick)
        if tick.index in (30, START_TICKS + 40):
            lamp.clock.sleep_until(lamp.clock.now() + 0.4)

    result = run(lamp, Wave(), LAMP, duration=0.3, on_tick=on_tick)
    assert result.missed_ticks > 30
    assert len([tick for tick in ticks if tick.phase == "start"]) == START_TICKS
    start, landing = ([tick.goal for tick in ticks if tick.phase == phase] for phase in ("start", "landing"))
    assert np.abs(np.diff(np.array(start), axis=0)).max() < 0.3 / START_MOVE * 15 / 8 * 0.02 + 1e-9
    assert np.abs(np.diff(np.array(landing), axis=0)).max() < 1.0 / LANDING * 15 / 8 * 0.02
    assert landing[-1] == pytest.approx(LAMP.rest)


def test_a_pose_too_far_outside_the_limits_keeps_torque_off() -> None:
    lamp = FakeLamp()
    lamp.angle = np.array([0.0, LAMP.upper[1] + 0.3, 0.0])
    with pytest.raises(SafetyError, match=r"knee stands at 1\.08 rad, outside -1 to 0\.78 rad by more than the 0\.28"):
        run(lamp, Wave(), LAMP)
    assert True not in lamp.torques


def test_a_period_that_starves_the_watchdog_is_refused() -> None:
    assert 2 * MAX_PERIOD == WATCHDOG
    lamp = FakeLamp()
    with pytest.raises(SafetyError, match=r"^control_period = 0\.11 s is longer than 0\.1 s: .*Bus Watchdog"):
        run(lamp, Wave(), LAMP, period=0.11)
    assert lamp.torques == []
    assert run(lamp, Wave(), LAMP, period=MAX_PERIOD, duration=0.5).ended == "finished"


def test_a_bus_too_slow_for_the_period_is_refused() -> None:
    slow, lamp = dataclasses.replace(LAMP, bus_baud=57_600), FakeLamp()
    lamp.traits = servo_traits(slow)
    with pytest.raises(
        SafetyError, match=r"38\.3 ms on .* bus\.baud = 57600, more than 80% of control_period = 0\.02 s"
    ):
        run(lamp, Wave(), slow)
    assert lamp.torques == []
    assert run(lamp, Wave(), slow, period=0.05, duration=0.5).ended == "finished"


def test_torque_that_may_be_on_is_said_on_exceptions_too() -> None:
    class Broken(Wave):
        def step(self, observation: Observation, time: float) -> NoReturn:
            raise RuntimeError("x")

    def spoil(observation: Observation) -> None:
        if not lamp.on and lamp.goals:
            observation.health.torque[:2] = -1

    lamp, events = FakeLamp(spoil), []
    with pytest.raises(RuntimeError):
        run(lamp, Broken(), LAMP, on_event=lambda *event: events.append(event))
    assert events[-1] == ("error", "torque may still be on: ankle, knee; switch the supply off, or `robolamp stop`")


def test_one_missed_reading_at_the_end_is_no_alarm() -> None:
    looks: list[int] = []

    def spoil(observation: Observation) -> None:
        if not lamp.on and lamp.goals and not looks:
            looks.append(1)
            observation.health.torque[:] = -1

    lamp = FakeLamp(spoil)
    result = run(lamp, Wave(), LAMP, duration=0.1)
    assert (looks, result.ended, result.faults) == ([1], "finished", {})


@pytest.mark.parametrize("error", [BusError("the port is gone", "/dev/x"), SafetyError("goal nan")])
def test_a_bus_that_takes_no_goals_cuts(error: Exception) -> None:
    lamp = FakeLamp()
    lamp.refuse = error
    result = run(lamp, Wave(), LAMP)
    assert (result.ended, result.reason) == ("cut", str(error))
    assert lamp.torques == [True, False]


def test_missed_reads_hold_the_last_goal() -> None:
    ticks: list[Tick] = []
    gone = range(START_TICKS + 10, START_TICKS + 13)

    def spoil(observation: Observation) -> None:
        if len(ticks) in gone:
            observation.angle[1] = np.nan
            observation.faults = ("knee: no answer",)

    lamp, pilot = FakeLamp(spoil), Wave()
    result = run(lamp, pilot, LAMP, duration=1.0, on_tick=ticks.append)
    assert (result.ended, result.held_ticks, result.faults) == ("finished", 3, {"knee: no answer": 3})
    for index in gone:
        assert ticks[index].goal == pytest.approx(ticks[gone[0] - 1].goal)
    assert np.isfinite(pilot.angles).all()
    assert len(pilot.times) == 47


def test_one_joint_lost_for_good_lands() -> None:
    ticks: list[Tick] = []

    def spoil(observation: Observation) -> None:
        if len(ticks) > START_TICKS + 10:
            observation.angle[1] = np.nan
            observation.angle_age[1] = (len(ticks) - START_TICKS - 10) * 0.02

    lamp = FakeLamp(spoil)
    result = run(lamp, Wave(), LAMP, on_tick=ticks.append)
    assert (result.ended, result.reason) == ("guard", f"knee: no answer for {ANGLE_AGE:g} s")
    assert ticks[-1].phase == "landing"
    assert result.held_ticks <= 6


def test_all_joints_lost_cuts() -> None:
    ticks: list[Tick] = []

    def spoil(observation: Observation) -> None:
        if len(ticks) > START_TICKS:
            observation.angle[:] = np.nan
            observation.angle_age[:] = (len(ticks) - START_TICKS) * 0.02
            observation.health.torque[:] = -1

    lamp = FakeLamp(spoil)
    result = run(lamp, Wave(), LAMP, on_tick=ticks.append)
    assert (result.ended, result.reason) == ("cut", f"no servo has answered for {ANGLE_AGE:g} s")
    assert ticks[-1].phase == "run"
    assert lamp.torques[0] is True
    assert not any(lamp.torques[1:])  # told again and again, for RELEASE_TIME
    assert lamp.clock.now() - ticks[-1].began == pytest.approx(RELEASE_TIME, abs=0.2)
    assert result.faults["knee: torque perhaps still on at the end"] == 1


def test_no_torque_without_every_angle() -> None:
    def spoil(observation: Observation) -> None:
        observation.angle[2] = np.nan

    lamp = FakeLamp(spoil)
    with pytest.raises(BusError, match="no angle from neck in 5 readings"):
        run(lamp, Wave(), LAMP)
    assert True not in lamp.torques


def test_a_servo_that_stays_on_is_a_fault() -> None:
    def spoil(observation: Observation) -> None:
        observation.health.torque[0] = 1

    events: list[tuple[str, str]] = []
    result = run(FakeLamp(spoil), Wave(), LAMP, duration=0.1, on_event=lambda *event: events.append(event))
    assert result.faults == {"ankle: torque still on at the end": 1}
    assert (result.ended, result.reason) == ("cut", "torque may still be on: ankle")
    assert ("error", "torque may still be on: ankle; switch the supply off, or `robolamp stop`") in events
    assert not [text for _, text in events if text.startswith("torque off")]


def test_a_servo_that_did_not_hear_is_told_again() -> None:
    class Deaf(FakeLamp):
        def torque(self, on: bool) -> None:
            super().torque(on)
            self.on = on or len(self.torques) < 5

    lamp = Deaf()
    result = run(lamp, Wave(), LAMP, duration=0.1)
    assert lamp.torques == [True, False, False, False, False]
    assert (lamp.on, result.ended, result.faults) == (False, "finished", {})


def test_missed_ticks_are_skipped_and_counted() -> None:
    """A tick that takes 50 ms: the two that were due meanwhile are not caught up in a burst."""
    ticks: list[Tick] = []
    lamp = FakeLamp()

    def on_tick(tick: Tick) -> None:
        ticks.append(tick)
        if tick.index == START_TICKS + 20:
            lamp.clock.sleep_until(lamp.clock.now() + 0.05)

    pilot = Wave()
    result = run(lamp, pilot, LAMP, duration=1.0, on_tick=on_tick)
    gaps = np.diff([tick.scheduled for tick in ticks])
    assert result.missed_ticks == 1  # due at 20 (skipped) and 40 ms; the tick began 12 ms after the second
    assert np.sort(gaps)[-2:] == pytest.approx([0.02, 0.04])
    assert np.diff([tick.began for tick in ticks]).min() > 0.005
    assert pilot.times[-1] == pytest.approx(0.98)
    assert len(pilot.times) == 49


def test_late_by_less_than_a_period_is_not_missed() -> None:
    lamp = FakeLamp()
    lamp.read_time = 0.019
    assert run(lamp, Wave(), LAMP, duration=0.2).missed_ticks == 0


def test_faults_are_announced_once() -> None:
    def spoil(observation: Observation) -> None:
        observation.faults = ("foot: saturated",)

    events: list[tuple[str, str]] = []
    result = run(FakeLamp(spoil), Wave(), LAMP, duration=0.1, on_event=lambda *event: events.append(event))
    assert result.faults == {"foot: saturated": result.ticks}
    assert [event for event in events if event[0] == "warning"] == [("warning", "foot: saturated")]


def test_a_fault_is_announced_when_it_comes() -> None:
    def spoil(observation: Observation) -> None:
        if observation.time > 51.0:
            observation.faults = ("foot: frames lost",)

    lamp, events = FakeLamp(spoil), []
    run(lamp, Wave(), LAMP, duration=0.5, on_event=lambda *event: events.append((lamp.clock.now(), *event)))
    assert [time for time, *event in events if event == ["warning", "foot: frames lost"]] == [
        pytest.approx(51.0, abs=0.03)
    ]
    assert events[-1][1:] == ("info", "torque off; finished")


@pytest.mark.parametrize(("lasts", "said"), [(1.0, "finished"), (75.0, "silent again and again for 60 s")])
def test_a_plug_that_stays_loose_ends_the_run(lasts: float, said: str) -> None:
    gone = [(2.5 + second, 3.4 + second) for second in range(round(lasts))]
    lamp = Unplugged(*gone[0], *gone[1:])
    result = run(lamp, Wave(), LAMP, duration=1.0, reconnect=lamp.reconnect)
    assert said in (result.ended, result.reason.rpartition("; ")[2])
    assert lamp.clock.now() - lamp.gone < 70.0


class Unplugged(FakeLamp):
    """Its port is gone from one moment of the run to another, and in further such times."""

    def __init__(self, gone: float, back: float, *more: tuple[float, float], clock: FakeClock | None = None) -> None:
        super().__init__(clock=clock)
        began = self.clock.now()
        self.gone, self.back = began + gone, began + back
        self.times = [(began + start, began + end) for start, end in ((gone, back), *more)]
        self.looks = 0

    @property
    def away(self) -> bool:
        return any(gone <= self.clock.now() < back for gone, back in self.times)

    def observe(self) -> Observation:
        seen = super().observe()
        if self.away:
            seen.angle[:] = np.nan
            seen.angle_age[:] = self.clock.now() - self.gone
            seen.health.torque[:] = -1
            seen.faults = ("bus: the port is gone",)
        return seen

    def command(self, command: Command) -> None:
        if self.away:
            raise BusError("the port is gone")
        super().command(command)

    def torque(self, on: bool) -> None:
        if on and self.torques:
            self.angle = np.array([-0.4, 0.3, 0.2])  # it sank meanwhile
        super().torque(on)

    def reconnect(self) -> bool:
        self.looks += 1
        if not self.away:
            self.angle = np.array([-0.4, 0.3, 0.2])
        return not self.away


@pytest.mark.parametrize("gone", [0.5, 2.5, 2.6123])
def test_a_port_that_comes_back_resumes_softly_if_told_so(gone: float) -> None:
    lamp, pilot, ticks, events = Unplugged(gone, gone + 3.0), Wave(), [], []
    result = run(
        lamp, pilot, LAMP, duration=1.0, on_tick=ticks.append, on_event=lambda *event: events.append(event),
        reconnect=lamp.reconnect,
    )  # fmt: skip
    assert (result.ended, result.replugs) == ("finished", 1)
    assert lamp.torques == [True, True, False]
    assert lamp.looks > 10
    after = next(i for i, tick in enumerate(ticks) if tick.scheduled > lamp.back)
    assert ticks[after].goal == pytest.approx([-0.4, 0.3, 0.2], abs=1e-3)
    goals = np.array([tick.goal for tick in ticks[after:]])
    assert np.abs(np.diff(goals, axis=0)).max() < 0.08  # two ticks of the wave: it goes on from the tick that was lost
    assert np.diff(pilot.times) == pytest.approx(0.02, abs=0.021)
    assert pilot.times[-1] < 1.0
    assert any(level == "error" and "waiting up to 10 s" in text for level, text in events)


def test_a_port_that_comes_back_untold_ends_the_run() -> None:
    lamp = Unplugged(2.5, 3.5)
    result = run(lamp, Wave(), LAMP, duration=1.0)
    assert (result.ended, result.replugs) == ("cut", 0)
    assert lamp.torques[0] is True
    assert not any(lamp.torques[1:])
    assert lamp.clock.now() >= 3.5  # it came back, and was told
    assert "torque" not in result.reason


def test_a_port_that_stays_away_ends_the_run() -> None:
    lamp = Unplugged(2.5, 1000.0)
    result = run(lamp, Wave(), LAMP, duration=1.0, reconnect=lamp.reconnect)
    assert result.ended == "cut"
    assert lamp.clock.now() - lamp.gone == pytest.approx(REPLUG_TIME + RELEASE_TIME, abs=0.5)


def test_a_stop_while_the_port_is_away_ends_the_run() -> None:
    lamp, stop = Unplugged(2.5, 1000.0), StopRequest()

    def reconnect() -> bool:
        stop.request()
        return False

    assert run(lamp, Wave(), LAMP, duration=1.0, reconnect=reconnect, stop=stop).ended == "cut"
    assert lamp.clock.now() - lamp.gone < 1.0 + RELEASE_TIME


def test_a_run_that_only_watches_never_turns_torque_on() -> None:
    lamp = FakeLamp()
    lamp.command = lambda command: None  # type: ignore[method-assign]
    result = run(lamp, Wave(), LAMP, duration=0.5, powered=False)
    assert (result.ended, result.faults) == ("finished", {})
    assert lamp.torques == [False]


@pytest.mark.parametrize(
    ("times", "replugs", "lost"),
    [
        ([(2.5, 5.5)], 1, 1),
        ([(2.5, 5.5), (5.9, 7.3)], 2, 1),  # in the soft move after it
        ([(2.5, 5.5), (6.0131, 6.4)], 2, 1),  # there, between a reading and its goals
        ([(2.5, 5.5), (5.9, 7.3), (7.5, 9.0), (9.3, 9.33)], 4, 1),  # a loose plug
        ([(2.5, 5.5), (7.2, 8.0)], 2, 2),  # when the controller drives again
        ([(2.6123, 4.0), (5.7123, 5.8), (8.0, 9.0)], 3, 2),
        ([(0.5, 1.0), (1.3, 2.0)], 2, 0),  # in the soft start
        ([(1.983, 3.0), (3.3, 4.0)], 2, 0),  # where the controller was to begin
        ([(2.9, 3.6), (4.0, 4.4)], 2, 1),
        ([(3.2, 4.0), (4.5, 5.0)], 2, 0),  # in the soft landing
    ],
)
def test_the_time_that_a_port_was_away_is_counted_once(
    times: list[tuple[float, float]], replugs: int, lost: int
) -> None:
    lamp, pilot, ticks = Unplugged(*times[0], *times[1:]), Wave(), []
    events: list[tuple[str, str]] = []
    result = run(
        lamp, pilot, LAMP, duration=1.0, on_tick=ticks.append, on_event=lambda *event: events.append(event),
        reconnect=lamp.reconnect,
    )  # fmt: skip
    assert (result.ended, result.replugs) == ("finished", replugs)
    assert len(pilot.times) == 50 - lost
    assert np.diff(pilot.times).min() > 0.02 - 1e-6
    assert np.diff(pilot.times).max() < 0.0401
    assert (pilot.times[0], pilot.times[-1]) == (pytest.approx(0.0), pytest.approx(0.98))
    assert np.abs(np.diff([tick.goal for tick in ticks if tick.phase == "run"], axis=0)).max() < 0.08
    # The log tells how long the run stood: subtracted, what is left is its length.
    stood = sum(float(text.split("paused ")[1].removesuffix(" s")) for _, text in events if "paused" in text)
    assert stood == pytest.approx(result.paused, abs=1e-3)
    whole = ticks[-1].scheduled - ticks[0].scheduled - result.paused
    assert whole == pytest.approx(START_MOVE + START_HOLD + 1.0 + LANDING, abs=0.0201)


def test_a_lamp_that_comes_back_unfit_ends_the_run_for_that_reason() -> None:
    lamp = Unplugged(2.5, 3.5)

    def reconnect() -> bool:
        if lamp.reconnect():
            raise SafetyError("knee (id 2) is XL430-W250-T, not XL330-M288-T", "/dev/x")
        return False

    events: list[tuple[str, str]] = []
    result = run(lamp, Wave(), LAMP, duration=1.0, reconnect=reconnect, on_event=lambda *event: events.append(event))
    said = "the port is gone; it came back, but knee (id 2) is XL430-W250-T, not XL330-M288-T"
    assert (result.ended, result.reason, result.replugs) == ("cut", said, 0)
    assert lamp.torques[0] is True
    assert not any(lamp.torques[1:])
    assert lamp.clock.now() < 50.0 + 3.5 + 0.2 + RELEASE_TIME
    assert ("error", f"torque off at once: {said}") in events


@pytest.mark.parametrize("refusals", [3, 1000])
def test_servos_that_are_not_ready_yet_are_asked_again(refusals: int) -> None:
    class Slow(Unplugged):
        def torque(self, on: bool) -> None:
            nonlocal refusals
            if on and self.torques and refusals:
                refusals -= 1
                raise BusError("knee (id 2) does not answer")
            super().torque(on)

    lamp, ends = Slow(2.5, 3.5), refusals == 3
    result = run(lamp, Wave(), LAMP, duration=1.0, reconnect=lamp.reconnect)
    assert (result.ended, result.replugs) == (("finished", 1) if ends else ("cut", 0))
    if not ends:
        assert result.reason == ("the port is gone; the lamp was not back in 10 s: knee (id 2) does not answer")


def test_a_stop_while_waiting_is_the_reason_and_torque_stays_off() -> None:
    lamp, stop = Unplugged(2.5, 3.5), StopRequest()

    def reconnect() -> bool:
        if lamp.reconnect():
            stop.request()  # just as it comes back
            return True
        return False

    result = run(lamp, Wave(), LAMP, duration=1.0, reconnect=reconnect, stop=stop)
    assert (result.ended, result.reason) == ("cut", "request to stop while waiting for it: the port is gone")
    assert not any(lamp.torques[1:])


class Nightly(FakeClock):
    """A computer's clock; it sleeps at a moment of it, for some time that the clock does not see."""

    def __init__(self, at: float, lasts: float) -> None:
        super().__init__()
        self.at, self.lasts = self.time + at, lasts

    def slept(self) -> float:
        return 1000.0 + (self.lasts if self.time >= self.at else 0.0)  # it has slept before, too


@pytest.mark.parametrize("at", [0.5, 2.5, 3.3])
@pytest.mark.parametrize(("lasts", "said"), [(12.0, "12"), (0.5, "0.5"), (30_000.0, "30000")])
def test_a_computer_that_slept_ends_the_run(at: float, lasts: float, said: str) -> None:
    lamp, ticks = FakeLamp(clock=Nightly(at, lasts)), []
    result = run(lamp, Wave(), LAMP, duration=1.0, on_tick=ticks.append)
    assert (result.ended, result.reason) == ("cut", f"the computer slept for {said} s")
    assert lamp.torques == [True, False]
    assert ticks[-1].scheduled < 50.0 + at + 0.021
    assert len(lamp.goals) == len(ticks)  # none was sent since


def test_a_computer_that_slept_before_torque_went_on_keeps_it_off() -> None:
    lamp = FakeLamp(clock=Nightly(0.001, 60.0))
    result = run(lamp, Wave(), LAMP, duration=1.0)
    assert (result.ended, result.reason, lamp.torques) == ("cut", "the computer slept for 60 s", [False])


def test_a_lamp_that_was_plugged_in_while_the_computer_slept_does_not_move() -> None:
    lamp = Unplugged(2.5, 5.0, clock=Nightly(4.0, 3600.0))
    result = run(lamp, Wave(), LAMP, duration=1.0, reconnect=lamp.reconnect)
    assert (result.ended, result.reason) == ("cut", "the computer slept for 3600 s")
    assert not any(lamp.torques[1:])


def test_a_watch_ends_when_the_computer_slept() -> None:
    lamp = FakeLamp(clock=Nightly(4.5, 60.0))
    result = run(lamp, Wave(), LAMP, duration=1.0, limp=2.0)
    assert (result.ended, result.reason) == ("cut", "the computer slept for 60 s")


def test_less_sleep_than_the_watchdogs_allow_is_none() -> None:
    lamp = FakeLamp(clock=Nightly(2.5, 0.15))
    assert run(lamp, Wave(), LAMP, duration=1.0).ended == "finished"


@pytest.mark.parametrize("joints", [[1], [0, 1, 2]])
def test_goals_that_stay_lost_end_the_run(joints: list[int]) -> None:
    ticks: list[Tick] = []

    def spoil(observation: Observation) -> None:
        goal = np.ones(3, np.int64)
        if len(ticks) > START_TICKS + 10:
            goal[joints] = 0
        observation.health.goal = goal

    result = run(FakeLamp(spoil), Wave(), LAMP, on_tick=ticks.append)
    name = LAMP.names[joints[0]]
    assert (result.ended, result.reason) == ("guard", f"{name}: 5 goals in a row did not arrive")
    assert len([tick for tick in ticks if tick.phase == "run"]) == 15


def test_the_reason_is_of_the_fault_that_ended_it() -> None:
    """A reading too late that passed, heat that lands it, one again that ends it at once."""
    ticks: list[Tick] = []
    lamp = Unplugged(2.5, 3.5)

    def spoil(observation: Observation) -> None:
        at = observation.time - 50.0
        if 2.2 < at < 2.215 or at > 5.8:
            observation.angle_age[:] = ANGLE_AGE * 1.01
        if 5.5 < at < 5.6:
            observation.health.temperature[1] = 70.0

    lamp.spoil = spoil
    result = run(lamp, Wave(), LAMP, duration=1.0, on_tick=ticks.append, reconnect=lamp.reconnect)
    assert (result.ended, result.replugs > 1) == ("cut", True)
    assert result.reason == f"a reading took more than {ANGLE_AGE:g} s: this computer stood still"
    assert result.faults["knee: above 65 degC"] == 5


def test_servos_that_fall_silent_again_and_again_end_the_run() -> None:
    ticks: list[Tick] = []
    back = [START_TICKS]  # how many ticks there were, each time that they answered again

    def reconnect() -> bool:
        back.append(len(ticks))
        return True

    def spoil(observation: Observation) -> None:
        if len(ticks) > back[-1] + 10:
            observation.angle[:] = np.nan
            observation.angle_age[:] = ANGLE_AGE * 1.01

    lamp = FakeLamp(spoil)
    result = run(lamp, Wave(), LAMP, on_tick=ticks.append, reconnect=reconnect)
    said = f"no servo has answered for {ANGLE_AGE:g} s; silent again and again for 60 s"
    assert (result.ended, result.reason, lamp.torques[-1]) == ("cut", said, False)
