from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from sleeper import Sleeper

from robolamp.runtime.clock import MonotonicClock, Sleep
from robolamp.runtime.stop import SIGNALS, StopRequest

pytestmark = pytest.mark.realtime


def test_sleeps_until_an_absolute_time() -> None:
    clock = MonotonicClock()
    with Sleeper() as sleeper:
        began = clock.now()
        for tick in range(1, 11):
            clock.sleep_until(began + tick * 0.005)
            assert clock.now() >= began + tick * 0.005
        assert clock.now() - began < 0.5 + sleeper.lost(began)


def test_a_time_that_has_passed_returns_at_once() -> None:
    clock = MonotonicClock()
    with Sleeper() as sleeper:
        began = time.monotonic()
        clock.sleep_until(began - 10)
        assert time.monotonic() - began < 0.1 + sleeper.lost(began)


def test_the_computer_sleeps_when_one_of_its_clocks_runs_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, boot, ahead = MonotonicClock(), time.clock_gettime, 0.0
    awake = Sleep(clock)
    assert awake.reason() == ""
    monkeypatch.setattr(time, "clock_gettime", lambda which: boot(which) + ahead)
    assert awake.reason() == ""
    ahead = 12.2
    assert awake.reason() == "the computer slept for 12 s"
    assert Sleep(clock).reason() == ""


@pytest.mark.parametrize("number", SIGNALS)
def test_signals_are_counted_not_raised(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with StopRequest() as stop:
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
        time.sleep(0.01)
        assert stop.requests == 2
    assert signal.getsignal(number) is before


def ask_and_wait() -> None:
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(5.0)


def test_a_request_interrupts_whoever_waits_for_a_person() -> None:
    with StopRequest() as stop:
        with pytest.raises(KeyboardInterrupt), stop.interrupting():
            ask_and_wait()
        with pytest.raises(KeyboardInterrupt), stop.interrupting():  # it was asked for before
            pytest.fail("it was not waited for")
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        assert stop.requests == 2


def test_a_signal_that_somebody_handles_is_left_to_them() -> None:
    heard: list[int] = []
    before = signal.signal(signal.SIGUSR2, lambda number, frame: heard.append(number))
    try:
        with StopRequest() as stop:
            os.kill(os.getpid(), signal.SIGUSR2)
            time.sleep(0.01)
            assert (heard, stop.requests) == ([signal.SIGUSR2], 0)
    finally:
        signal.signal(signal.SIGUSR2, before)


CHILD = """
import sys
sys.path.insert(0, {tests!r})
from runtime.fake import LAMP, FakeLamp, Wave
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.loop import run
from robolamp.runtime.stop import StopRequest
lamp = FakeLamp(clock=MonotonicClock())
with StopRequest() as stop:
    result = run(lamp, Wave(), LAMP, duration=60, stop=stop, on_tick=lambda tick: tick.index or print("up", flush=True))
print(result.ended, lamp.torques)
"""


# signal(7): those that do not end a process, cannot be caught, tell of a program that broke, or are ignored by Python.
OTHERS = "CHLD CONT URG WINCH TSTP TTIN TTOU KILL STOP SEGV BUS FPE ILL TRAP SYS PIPE XFSZ INFO"
NOT_ENDING = {getattr(signal, f"SIG{name}") for name in OTHERS.split() if hasattr(signal, f"SIG{name}")}


@pytest.mark.parametrize("number", sorted(signal.valid_signals() - NOT_ENDING - set(range(37, signal.SIGRTMAX))))
def test_a_signal_lands_a_running_lamp(number: int) -> None:
    tests = str(Path(__file__).resolve().parents[1])
    with subprocess.Popen(
        [sys.executable, "-c", CHILD.format(tests=tests)], stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout
        assert child.stdout.readline() == "up\n"
        child.send_signal(number)
        said, _ = child.communicate(timeout=60)
    assert said == "stopped [True, False]\n"
    assert child.returncode == 0
