"""How steadily the loop ticks beside a busy core, against a loop that only sleeps; and the highest rate it holds.

The emulated lamp runs in a process of its own and another process does nothing but compute, all along. Chunks of the
loop (reads and writes through real pseudo-terminals, a controller that stands still) and of a bare loop (absolute
schedule, `time.sleep`) take turns, so that both meet the same load. A deadline is missed when a tick begins a period or
more late; its slots are skipped and counted. Jitter is how far a period is from the nominal one. A row whose run was
cut short, as on a machine that is busy with other things, says so, and by what.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from robolamp.assets import Assets
from robolamp.controller.pilot import PilotStep
from robolamp.errors import RobolampError
from robolamp.lamp import load_lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.loop import run
from robolamp.signals import Interventions, Observation, Tick

OPENINGS = 5  # attempts
PATIENCE = 0.012  # s: of the pseudo-terminal, as in dry-run
RATES = (100, 125, 160, 200, 250, 320, 400, 500)  # 1/s: of the search for the highest
HELD = 0.001  # share of slots that may be missed by a rate that is held
LAMP = load_lamp(Assets())


class Still:
    """A controller that stands still."""

    def step(self, observation: Observation, time: float) -> PilotStep:
        """Return the neutral pose."""
        goal = np.zeros(len(LAMP.joints))
        return PilotStep(np.empty(0), goal, goal, 0, True, Interventions())


@dataclass
class Beat:
    """What was seen of a loop: its periods [s], missed slots and ticks."""

    periods: list[float] = field(default_factory=list)
    missed: int = 0
    ticks: int = 0
    ended: set[str] = field(default_factory=set)

    def add(self, began: list[float], missed: int) -> None:
        """Take a chunk."""
        self.periods += np.diff(began).tolist()
        self.missed += missed
        self.ticks += len(began)

    def line(self, name: str, period: float) -> str:
        """Return a row of the table."""
        jitter = np.abs(np.array(self.periods) - period) * 1e3
        p50, p99, most = np.percentile(jitter, [50, 99, 100]) if jitter.size else [np.nan] * 3
        ended = "" if self.ended <= {"finished"} else f"   ended: {', '.join(sorted(self.ended))}"
        return (
            f"{1 / period:4.0f} Hz  {name:<18}{self.ticks:8} ticks{self.missed:7} missed"
            f"   jitter p50 {p50:6.3f}  p99 {p99:7.3f}  max {most:8.3f} ms{ended}"
        )


def bare(period: float, seconds: float, beat: Beat) -> None:
    """Let a loop that only sleeps run for a chunk."""
    origin, slot, missed = time.monotonic(), 0, 0
    began: list[float] = []
    while slot * period < seconds:
        time.sleep(max(0.0, origin + slot * period - time.monotonic()))
        now = time.monotonic()
        late = int((now - origin - slot * period) / period)
        missed += late
        slot += late + 1
        began.append(now)
    beat.add(began, missed)


def lamp_loop(robot: RobotLamp, period: float, seconds: float, beat: Beat) -> None:
    """Let the lamp's loop run for a chunk, soft start and landing included."""
    began: list[float] = []

    def note(tick: Tick) -> None:
        began.append(tick.began)

    try:
        result = run(robot, Still(), LAMP, period=period, duration=seconds, on_tick=note)
    except RobolampError as error:  # a rate that is refused, or servos that the machine gives no time to answer
        beat.add(began, 0)
        beat.ended.add(f"failed ({error.message})")
        return
    beat.add(began, result.missed_ticks)
    beat.ended.add(result.ended if result.ended == "finished" else f"{result.ended} ({result.reason})")


def _open(robot: RobotLamp) -> None:
    """Open it; on a machine that is busy with other things the first looks may fail."""
    for _ in range(OPENINGS):
        with contextlib.suppress(RobolampError):
            robot.open()
            return
    robot.open()


@contextlib.contextmanager
def emulated() -> Iterator[RobotLamp]:
    """Yield an emulated lamp in a process of its own, open."""
    command = [sys.executable, "-m", "robolamp", "emulate", "--json", "--reality", "none"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            ports = json.loads(process.stdout.readline())
            robot = RobotLamp(LAMP, ports["servo_port"], ports["foot_port"], MonotonicClock(), patience=PATIENCE)
            _open(robot)
            yield robot
            robot.close()
        finally:
            process.terminate()


@contextlib.contextmanager
def busy() -> Iterator[None]:
    """Keep a core busy."""
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        try:
            yield
        finally:
            process.terminate()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0, help="of the loop at each rate (600)")
    parser.add_argument("--rates", type=int, nargs="+", default=[100, 50], help="beside a busy core [Hz] (100 50)")
    parser.add_argument("--chunk", type=float, default=20.0, help="length of a turn [s] (20)")
    parser.add_argument("--search", type=float, default=5.0, help="seconds at each rate of the search; 0: none (5)")
    options = parser.parse_args()
    with emulated() as robot:
        with busy():
            for period in (1 / rate for rate in options.rates):
                ours, theirs = Beat(), Beat()
                for _ in range(max(1, round(options.seconds / options.chunk))):
                    lamp_loop(robot, period, min(options.chunk, options.seconds), ours)
                    bare(period, min(options.chunk, options.seconds), theirs)
                print(ours.line("loop", period))
                print(theirs.line("bare sleep", period), flush=True)
        held = 0
        for rate in RATES if options.search else ():
            beat = Beat()
            lamp_loop(robot, 1 / rate, options.search, beat)
            print(beat.line("loop, no load", 1 / rate), flush=True)
            if beat.missed > HELD * beat.ticks or beat.ended != {"finished"}:
                break
            held = rate
        if options.search:
            print(f"highest rate held (at most {HELD:.1%} missed, nothing else to do): {held} Hz")


if __name__ == "__main__":
    main()
