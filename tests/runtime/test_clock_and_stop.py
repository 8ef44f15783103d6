from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from sleeper import Sleeper

from robolamp.runtime.clock import MonotonicClock
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


@pytest.mark.parametrize("number", SIGNALS)
def test_signals_are_counted_not_raised(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with StopRequest() as stop:
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
        time.sleep(0.01)
        assert stop.requests == 2
    assert signal.getsignal(number) is before


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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_lands_a_running_lamp(number: signal.Signals) -> None:
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
