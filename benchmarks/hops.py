"""Evolve the shipped hops again, by the commands recorded in them, with calibration/nominal.toml as it is now.

    python benchmarks/hops.py [NAME ...]        (`make hops`; some ten minutes)

A controller is shipped (written to sim/lamp/controllers/) only if it hits no fewer goals than the one that is there, on
the calibrated lamp and on lamps that are drawn; else it stays in its run folder, and one line says why. Stop and start
as you like: a run goes on where it stopped. Exit code 1: something was not shipped.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

from robolamp.assets import Assets, shipped
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import load_controller, save_controller
from robolamp.errors import RobolampError
from robolamp.lamp import load_lamp

_HOPS = ("hop", "hop-sighted")


def robolamp(*words: str) -> dict[str, object]:
    """Run a verb and return its JSON object."""
    command = [sys.executable, "-m", "robolamp", *words, "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, env=os.environ)
    told = json.loads(done.stdout) if done.stdout.strip() else {}
    if done.returncode:
        raise RobolampError(str(told.get("error", f"ended with exit code {done.returncode}")), shlex.join(words))
    return told


def evolved(command: str, runs: Path, name: str) -> Path:
    """Evolve by a recorded command, into a folder of its own, and return the controller file."""
    words = [word for word in shlex.split(command) if word != "--json"]
    if words[:2] != ["robolamp", "evolve"] or "-o" not in words:
        raise RobolampError(f"{command!r} is not `robolamp evolve TASK -o RUN ...`", name)
    folder = runs / f"{name}-{load_calibration(Assets()).hash[:8]}"
    words[words.index("-o") + 1] = str(folder)
    if (folder / "run.toml").exists():
        words = ["robolamp", "evolve", "--resume", str(folder)]
    print(f"{name}: {shlex.join(words)}", flush=True)
    return Path(str(robolamp(*words[1:])["controller"]))


def scored(file: Path, goals: str, lamps: int) -> tuple[int, ...]:
    """Return hits on the calibrated lamp and over drawn ones."""
    return tuple(
        int(str(robolamp("score", str(file), "--goals", goals, *more)["hits"]))
        for more in ((), ("--lamps", str(lamps)))
    )


def main(names: list[str], folder: Path, runs: Path, goals: str, lamps: int) -> int:
    kept, described = 0, load_lamp(Assets())
    for name in names:
        there = folder / f"{name}.toml"
        old = load_controller(there, described)
        command = str(old.provenance.get("command", ""))
        made = evolved(command, runs, name)
        before, after = scored(there, goals, lamps), scored(made, goals, lamps)
        said = f"{after[0]} hits ({before[0]} before), {after[1]} over {lamps} lamps ({before[1]} before)"
        if any(new < was for new, was in zip(after, before, strict=True)):
            kept += 1
            print(f"{name}: not shipped: {said}; the new one is {made}", flush=True)
            continue
        new = load_controller(made, described)
        provenance = {**new.provenance, "command": command}
        save_controller(dataclasses.replace(new, name=old.name, provenance=provenance), there)
        print(f"{name}: shipped: {said}", flush=True)
    return int(kept > 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(_HOPS), help=f"which ({', '.join(_HOPS)})")
    parser.add_argument("--folder", type=Path, default=shipped() / "sim/lamp/controllers", help="where they are")
    parser.add_argument("--runs", type=Path, default=Path("runs/hops"), help="folder of the runs (runs/hops)")
    parser.add_argument("--goals", default="0.05:0.60:56", help="that they are scored at (0.05:0.60:56)")
    parser.add_argument("--lamps", type=int, default=20, help="drawn lamps that they are scored on (20)")
    try:
        sys.exit(main(**vars(parser.parse_args())))
    except RobolampError as error:
        sys.exit(f"{error}")
