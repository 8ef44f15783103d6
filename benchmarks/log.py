"""Logging: what a tick costs, how large a minute is, how long a 10-minute log takes to read."""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from robolamp.log import writer
from robolamp.log.reader import Run, read_run
from robolamp.log.run_table import export
from robolamp.signals import Health, Interventions, Observation, Tick

PERIOD = 0.02  # s


def ticks_of(run: Run) -> Iterator[Tick]:
    """A run's ticks over and over, at times that go on."""
    index = 0
    while True:
        for row in range(run.index.size):
            now = index * PERIOD
            health = Health(
                run.voltage[row], run.temperature[row], run.pwm[row], run.torque[row], run.hardware_error[row]
            )
            seen = Observation(
                now + 0.002, run.angle[row], run.velocity[row], run.current[row], run.angle_age[row],
                float(run.foot_force[row]), float(run.foot_age[row]), health, run.faults[row],
            )  # fmt: skip
            yield Tick(
                index, str(run.phase[row]), now, now, now + 0.002, now + 0.003, seen, run.goal[row], run.inputs[row],
                run.outputs[row], Interventions(0, 0, index), int(run.hops[row]), bool(run.contact[row]),
            )  # fmt: skip
            index += 1


def logged(run: Run, path: Path, seconds: float, *, paced: bool) -> tuple[np.ndarray, float]:
    """Write a log; returns what handing over a tick took, by the clock and of CPU time, and all CPU time a tick [s]."""
    costs, ticks = [], ticks_of(run)
    cpu = time.process_time()
    with writer.LogWriter(path, context=run.context, joints=run.joints, now=0.0, lossless=not paced) as log:
        begin = time.monotonic()
        for index in range(round(seconds / PERIOD)):
            tick = next(ticks)
            if paced:
                time.sleep(max(0.0, begin + index * PERIOD - time.monotonic()))
            before = time.perf_counter(), time.thread_time()
            log.tick(tick)
            costs.append((time.perf_counter() - before[0], time.thread_time() - before[1]))
        assert threading.active_count() == 2
    assert (log.error, log.dropped) == ("", 0)
    return np.array(costs), (time.process_time() - cpu) / len(costs)


def timed(call: Callable[[], object], repeats: int) -> str:
    """Median time of a call, by the clock and of CPU time."""
    times = []
    for _ in range(repeats):
        before = time.perf_counter(), time.process_time()
        call()
        times.append((time.perf_counter() - before[0], time.process_time() - before[1]))
    clock, cpu = (statistics.median(column) for column in zip(*times, strict=True))
    return f"{clock:.2f} s ({cpu:.2f} s of CPU time)"


def generic(path: Path) -> None:
    """Read a log with the libraries of MCAP and ROS 2, message by message."""
    with path.open("rb") as stream:
        for _ in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            pass


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="length of the paced run [s]")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "robolamp",
            "dry-run",
            "hop-counting",
            "--goal",
            "0.30",
            "--lockstep",
            "--json",
        ]
        subprocess.run([*command, "-o", f"{folder}/run"], check=True, capture_output=True)
        run = read_run(Path(folder) / "run" / "log.mcap")
        paced = Path(folder) / "paced.mcap"
        costs, cpu = logged(run, paced, options.seconds, paced=True)
        for name, column in (("by the clock", 0), ("of CPU time", 1)):
            p50, p99 = np.percentile(costs[:, column] * 1e6, [50, 99])
            print(f"handing over a tick, {1 / PERIOD:g} Hz, {name}: p50 {p50:.0f} us, p99 {p99:.0f} us")
        print(f"all of logging a tick, with the thread that encodes and writes: {cpu * 1e6:.0f} us of CPU time")
        print(f"a minute: {paced.stat().st_size / options.seconds * 60 / 1e6:.2f} MB")
        for rate in (50, 100):
            long = Path(folder) / f"long{rate}.mcap"
            writer.FLUSH_PERIOD = 0.004  # written at many times the speed: chunks of some 25 ticks nevertheless
            logged(run, long, 600.0 * rate * PERIOD, paced=False)
            count = read_run(long).index.size
            print(f"10 minutes at {rate} Hz ({count} ticks, {long.stat().st_size / 1e6:.1f} MB): ", end="", flush=True)
            fast = timed(lambda long=long: read_run(long), 5)
            slow = timed(lambda long=long: generic(long), 1)
            print(f"read in {fast}; message by message {slow}")
        for ending in ("csv", "parquet"):
            table = Path(folder) / f"table.{ending}"
            whole = read_run(Path(folder) / "long50.mcap")
            took = timed(lambda table=table, whole=whole: export(whole, table), 1)
            print(f"10 minutes at 50 Hz as {ending}: {took}, {table.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
