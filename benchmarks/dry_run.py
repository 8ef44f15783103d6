"""The loop against the emulated lamp for a minute: tick period, missed ticks, tick cost, and the replay's error.

Run it on a machine that does nothing else, and compare periods with the bare loop's of the same run.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from robolamp.log.reader import read_run


def bare_periods(period: float, count: int) -> np.ndarray:
    """Return the periods [s] of a loop that only sleeps on an absolute schedule."""
    began = time.monotonic()
    ticks = []
    for index in range(count):
        time.sleep(max(0.0, began + index * period - time.monotonic()))
        ticks.append(time.monotonic())
    return np.diff(ticks)


def row(name: str, values: np.ndarray, scale: float, unit: str) -> None:
    p50, p99 = np.percentile(values, [50, 99])
    print(f"{name:<34} p50 {p50 * scale:8.3f}   p99 {p99 * scale:8.3f}   max {values.max() * scale:8.3f} {unit}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=60.0, help="length of the run [s]")
    parser.add_argument("--reality", default="worn", help="how the emulated lamp differs from its twin")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "robolamp", "dry-run", "hop", "--goal", "0.30", "--json"]
        command += ["--duration", str(options.duration), "--reality", options.reality, "-o", folder]
        said = json.loads(subprocess.run(command, capture_output=True, text=True, check=False).stdout)
        run = read_run(Path(said["log"]))
        compare = [sys.executable, "-m", "robolamp", "compare", said["log"], "--truth", said["truth"], "--json"]
        joints = json.loads(subprocess.run(compare, capture_output=True, text=True, check=False).stdout)["joints"]
    print(f"{options.duration:g} s at {1 / run.control_period:g} Hz, reality {options.reality}")
    row("tick period", np.diff(run.began), 1e3, "ms")
    row("tick period, bare absolute sleep", bare_periods(run.control_period, 500), 1e3, "ms")
    row("sensors read", run.read_done - run.began, 1e3, "ms")
    row("goals sent, from the tick's start", run.write_done - run.began, 1e3, "ms")
    print(f"ticks {said['ticks']}, missed {said['missed_ticks']}, faults {said['faults'] or 'none'}")
    print(f"landed {said['landed_m']:.3f} m of {said['goal_m']:.2f} m, {said['hops']} hops, fell: {said['fell']}")
    for joint in joints:
        mae, lag = joint["mae_mrad"], joint["lag_ms"]
        lag_text = "not defined" if lag is None else f"{lag:+.1f} ms"
        print(f"{joint['name']:<8} lag {lag_text}, MAE {mae['before']:.1f} mrad, {mae['after']:.1f} without the lag")


if __name__ == "__main__":
    main()
