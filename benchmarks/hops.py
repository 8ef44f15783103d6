"""Evolve the lamp's shipped controllers again, by the commands recorded in them, with lamp and calibration as they are.

    python benchmarks/hops.py [NAME ...]        (`make hops`; an hour)

A controller is shipped (written to sim/lamp/controllers/) only if it hits no fewer goals than the one that is there, on
the calibrated lamp and on lamps that are drawn; one for a pole (limbo-HEIGHT), only if it gets past the pole, upright
and without touching it, to no fewer goals. Else it stays in its run folder, and one line says why. Stop and start as
you like: a run goes on where it stopped. Exit code 1: something was not shipped.
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
from typing import Any

from robolamp.assets import Assets, shipped
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import load_controller, save_controller
from robolamp.errors import RobolampError
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import build, fingerprint

_NAMES = (  # seeds first
    "hop-counting", "hop-sighted", "hop-bending-sighted", "hop-bending", "hop", "luxo-1997",
    "limbo-22.5cm", "limbo-21cm", "limbo-19cm", "limbo-18cm",
)  # fmt: skip
_POLE_AT, _POLE_GOALS, _FOOT = 0.15, "0.28:0.40:13", 0.055
"""Where a pole stands, as in sim/tasks/limbo.toml; goals beyond it; the foot's radius [m]."""


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
    folder = runs / f"{name}-{_state()}"
    words[words.index("-o") + 1] = str(folder)
    if (folder / "run.toml").exists():
        words = ["robolamp", "evolve", "--resume", str(folder)]
    print(f"{name}: {shlex.join(words)}", flush=True)
    return Path(str(robolamp(*words[1:])["controller"]))


def _state() -> str:
    """What controllers are made for: a few digits of calibration and model together."""
    twin = build(load_lamp(Assets()), load_calibration(Assets()), Assets())
    return fingerprint([twin])[:8]


def scored(file: Path, name: str, command: str, goals: str, lamps: int) -> tuple[int, ...]:
    """Return hits on the calibrated lamp and over drawn ones; of a limbo, goals to which it gets under the pole."""
    given = shlex.split(command)
    own = given[given.index("--calibration") :][:2] if "--calibration" in given else []
    if name.startswith("limbo-"):
        words = ("--pole", name.removeprefix("limbo-"), "--pole-at", f"{_POLE_AT:g}", "--duration", "6")
        told: Any = robolamp("score", str(file), "--goals", _POLE_GOALS, *words)
        landed = [goal + error for goal, error in zip(told["goals_m"], told["errors_m"], strict=True)]
        past = sum(each > _POLE_AT + _FOOT for each in landed)
        return (max(past - told["pole_hits"] - told["falls"], 0),)
    return tuple(
        int(str(robolamp("score", str(file), "--goals", goals, *own, *more)["hits"]))
        for more in ((), ("--lamps", str(lamps)))
    )


def main(names: list[str], folder: Path, runs: Path, goals: str, lamps: int) -> int:
    kept, described = 0, load_lamp(Assets())
    for name in names:
        there = folder / f"{name}.toml"
        old = load_controller(there, described)
        command = str(old.provenance.get("command", ""))
        made = evolved(command, runs, name)
        before, after = (scored(file, name, command, goals, lamps) for file in (there, made))
        what = ("goals past the pole",) if len(after) == 1 else ("hits", f"over {lamps} lamps")
        said = ", ".join(f"{new} {each} ({was} before)" for new, was, each in zip(after, before, what, strict=True))
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
    parser.add_argument("names", nargs="*", default=list(_NAMES), help=f"which ({', '.join(_NAMES)})")
    parser.add_argument("--folder", type=Path, default=shipped() / "sim/lamp/controllers", help="where they are")
    parser.add_argument("--runs", type=Path, default=Path("runs/hops"), help="folder of the runs (runs/hops)")
    parser.add_argument("--goals", default="0.05:0.60:56", help="that they are scored at (0.05:0.60:56)")
    parser.add_argument("--lamps", type=int, default=20, help="drawn lamps that they are scored on (20)")
    try:
        sys.exit(main(**vars(parser.parse_args())))
    except RobolampError as error:
        sys.exit(f"{error}")
