"""Lamps that no model was made for: how well does a calibrated twin predict a hop that it has not seen?

    python benchmarks/unknown_lamps.py [--realities 10] [--first 1] [--scale 1.0]

Each reality is drawn by `robolamp.emulator.reality.draw.random_reality` (play, sag, bending, jitter, encoder waves,
masses, friction: more than the twin's family of models has), recorded through the emulated serial ports by `robolamp
calibrate all`, fitted without knowing its numbers, and judged by a hop to 22 cm. A line for each lamp, then the
medians. Some minutes a lamp on 2 cores.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--realities", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--scale", type=float, default=1.0, help="of every difference")
    parser.add_argument("--keep", type=Path, help="folder for recordings and reports, to go on in")
    options = parser.parse_args()
    rows = []
    print("seed   joints of the unseen hop [mrad]   its length [cm]                  flights [ms]     fit")
    print("       nominal  calibrated  share        lamp  nominal  calibrated       calibrated       [s]")
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(options.first, options.first + options.realities):
            folder = (options.keep or Path(scratch)) / f"random-{seed}"
            said = calibrate(f"random:{seed}:{options.scale:g}", folder)
            if "error" in said:
                print(f"{seed:4d}   {said['error']}", flush=True)
                continue
            proof = said["proof"]
            before, after = proof["mae_mrad_before"], proof["mae_mrad_after"]
            late = proof["time_error_s_after"]
            rows.append((before, after, *(proof[f"travel_m_{when}"] - proof["travelled_m"] for when in WHEN)))
            print(
                f"{seed:4d}   {before:7.1f}  {after:10.1f}  {after / before:5.2f}       "
                f"{proof['travelled_m'] * 100:5.1f}  {proof['travel_m_before'] * 100:7.1f}  "
                f"{proof['travel_m_after'] * 100:10.1f}       {'none' if late is None else f'{late * 1e3:10.0f}'}"
                f"       {said['wall_s']:5.0f}",
                flush=True,
            )
    if rows:
        columns = zip(*rows, strict=True)
        before, after, far, near = (statistics.median(abs(value) for value in column) for column in columns)
        print(
            f"median of {len(rows)}: joints {before:.1f} -> {after:.1f} mrad ({after / before:.2f}), "
            f"length off by {far * 100:.1f} -> {near * 100:.1f} cm"
        )


WHEN = ("before", "after")


def calibrate(reality: str, folder: Path) -> dict:
    """Return what `robolamp calibrate all --json` says of a reality."""
    command = [
        sys.executable, "-m", "robolamp", "calibrate", "all", "--emulate", "--reality", reality, "-o", str(folder),
        "--json",
    ]  # fmt: skip
    return json.loads(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False).stdout)


if __name__ == "__main__":
    main()
