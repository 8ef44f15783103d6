"""What `make hop` runs, again and again: how often it ends well, in real time or lockstep, idle or on a busy machine.

Well: the run finished, the lamp stands, and there is a report. Where the lamp lands is another matter: it is worn.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

BUSY = "while True: pass"


@contextlib.contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep so many processes busy meanwhile."""
    started = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


def one(folder: Path) -> tuple[bool, str]:
    """Return whether a run ended well, and a line about it."""
    command = [sys.executable, "-m", "robolamp", "dry-run", "hop", "--goal", "0.30", "--json", "-o", str(folder)]
    began = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    took = time.monotonic() - began
    said = json.loads(done.stdout)
    well = done.returncode == 0 and said["ended"] == "finished" and not said["fell"] and bool(said["report"])
    late = "-" if said.get("host_late_ms") is None else f"{said['host_late_ms']:.0f} ms"
    how = "in lockstep" if said.get("lockstep") else "in real time"
    what = said.get("error") or said["reason"] or ("fell" if said["fell"] else f"landed at {said['landed_m']:.3f} m")
    return well, (
        f"{'well' if well else 'NOT WELL':<8} {how:<12} host late by {late:>7}, missed {said.get('missed_ticks')}, "
        f"{what}, {took:.0f} s, load {os.getloadavg()[0]:.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="how many, of each kind")
    parser.add_argument("--load", type=int, nargs="*", default=[0, 12], help="busy processes beside them, a kind each")
    options = parser.parse_args()
    for load in options.load:
        print(f"{options.runs} runs beside {load} busy processes, on {os.cpu_count()} cores")
        with tempfile.TemporaryDirectory() as folder, busy(load):
            found = []
            for number in range(options.runs):
                found.append(one(Path(folder) / str(number)))
                print(f"  {found[-1][1]}", flush=True)
        wells = [line for well, line in found if well]
        real = sum("in real time" in line for line in wells)
        print(f"  ended well: {len(wells)} of {options.runs}, {real} of them in real time")


if __name__ == "__main__":
    main()
