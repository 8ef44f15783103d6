"""The driver and the loop on an emulated lamp that is killed, frozen, or not the one described."""

from __future__ import annotations

import contextlib
import dataclasses
import signal
import threading
import time

import numpy as np
import pytest
from contract.backends import LAMP, OPENING, PATIENCE, emulator
from sleeper import NotReached, Sleeper, undisturbed

from robolamp.controller.pilot import PilotStep
from robolamp.errors import BusError, SafetyError
from robolamp.lamp import Lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.loop import run
from robolamp.runtime.soft_start import RELEASE_TIME
from robolamp.signals import Interventions, Observation, Tick

pytestmark = pytest.mark.realtime


class Still:
    def step(self, observation: Observation, time: float) -> PilotStep:
        goal = np.zeros(3)
        return PilotStep(np.empty(0), goal, goal, 0, True, Interventions())


def described(**change: object) -> Lamp:
    """The lamp with a changed knee."""
    knee = dataclasses.replace(LAMP.joints[1], **change)  # type: ignore[arg-type]
    return dataclasses.replace(LAMP, joints=(LAMP.joints[0], knee, LAMP.joints[2]))


def test_another_lamp_than_described_is_refused() -> None:
    cases = [
        (described(id=7), BusError, r"knee \(id 7\) does not answer to a ping"),
        (described(servo="XL330-M077-T"), SafetyError, r"knee \(id 2\) is XL330-M288-T; lamp\.toml says XL330-M077-T"),
        (described(zero=1.0), SafetyError, r"knee \(id 2\): stands at -2\.1\d rad, outside -1\.17 to 0\.95"),
        (dataclasses.replace(LAMP, bus_baud=57_600), BusError, r"ankle \(id 1\) does not answer to a ping at 57600"),
    ]
    with emulator() as (_, servo_port, foot_port):
        for lamp, kind, said in cases:
            backend = RobotLamp(lamp, servo_port, foot_port, MonotonicClock(), patience=PATIENCE, opening=OPENING)
            with pytest.raises(kind, match=said):
                backend.open()
        swapped = RobotLamp(LAMP, foot_port, servo_port, MonotonicClock())
        with pytest.raises(BusError, match="does not answer to a ping"):
            swapped.open()
        backend = RobotLamp(LAMP, servo_port, foot_port, MonotonicClock(), patience=PATIENCE, opening=OPENING)
        backend.open()  # nothing of it did harm
        backend.close()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_lamp_that_dies_ends_the_run(number: signal.Signals) -> None:
    def attempt() -> None:
        ticks: list[Tick] = []
        ended: list[float] = []
        with emulator() as (process, servo_port, foot_port), Sleeper() as sleeper:
            backend = RobotLamp(LAMP, servo_port, foot_port, MonotonicClock(), patience=PATIENCE, opening=OPENING)
            backend.open()

            def on_tick(tick: Tick) -> None:
                ticks.append(tick)
                if tick.index == 30:
                    process.send_signal(number)
                    ended.append(time.monotonic())

            result = run(backend, Still(), LAMP, on_tick=on_tick)
            ended.append(time.monotonic())
            backend.close()
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)
            if len(ended) < 2:
                raise NotReached(f"it ended before it died: {result.reason}")
            assert ended[1] - ended[0] < 3.0 + RELEASE_TIME + sleeper.lost(ended[0])
        assert result.ended == "cut"
        assert len(ticks) < 45
        assert all(np.isnan(tick.observation.angle).all() for tick in ticks[32:])
        assert set(backend.left_on) == set(LAMP.names)

    undisturbed(attempt, PATIENCE / 2)


def test_a_stall_that_trips_the_watchdog_ends_the_run() -> None:
    def attempt() -> None:
        ticks: list[Tick] = []

        def on_tick(tick: Tick) -> None:
            ticks.append(tick)
            if tick.index == 30:
                time.sleep(0.5)

        with emulator() as (_, servo_port, foot_port):
            backend = RobotLamp(LAMP, servo_port, foot_port, MonotonicClock(), patience=PATIENCE, opening=OPENING)
            backend.open()
            result = run(backend, Still(), LAMP, on_tick=on_tick)
            left = backend.observe().health.torque
            backend.close()
        assert result.ended == "cut"
        assert "the Bus Watchdog has stopped ankle, knee, neck: nothing was sent for 0.5" in result.reason
        assert ticks[-1].index == 30
        assert left.tolist() == [0, 0, 0]

    undisturbed(attempt, PATIENCE / 2)


def test_a_lamp_is_waited_for_as_it_is_opened() -> None:
    """An emulator that stands still for a moment is no missing servo."""
    with emulator() as (process, servo_port, foot_port):
        patient = RobotLamp(LAMP, servo_port, foot_port, MonotonicClock(), patience=0.012, opening=30.0)
        process.send_signal(signal.SIGSTOP)
        going_on = threading.Timer(0.5, process.send_signal, [signal.SIGCONT])
        going_on.start()
        patient.open()
        going_on.join()
        patient.torque(True)
        patient.close()
    assert not patient.left_on
