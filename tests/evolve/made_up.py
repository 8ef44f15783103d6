"""Runs of studies that nobody made: the files that a finished run leaves, with numbers of one's choice."""

from __future__ import annotations

import json
from pathlib import Path

from robolamp.controller.controller_file import Controller, save_controller
from robolamp.controller.expression import parse
from robolamp.evolve.study.plan import Order, Point
from robolamp.evolve.study.study_runs import Scale, Shelf

from .parts import ASSETS, CALIBRATION, LAMP

QUICK = ("duration=0.5", "timestep=0.004")


def shelf(folder: Path, *settings: str) -> Shelf:
    """A folder of runs, claimed."""
    made = Shelf(folder)
    made.claim(Scale.of(ASSETS, LAMP, CALIBRATION, settings or QUICK))
    return made


def run(shelf: Shelf, point: Point, seed: int, final: float = 0.5, stage: str = "done") -> Path:
    """A run whose fitness falls in even steps from 2 to `final`; its champion stands still."""
    folder = shelf.path(Order(point, seed))
    folder.mkdir(parents=True)
    last = point.generations - 1
    lines = []
    for generation in range(point.generations):
        whole = 2.0 + (final - 2.0) * (generation / last if last else 1.0)
        entry = {
            "stage": "evolution", "generation": generation, "individuals": (generation + 1) * point.population,
            "best_fitness": whole * 0.9, "best_whole": whole, "champion_fitness": whole,
            "physics_steps": 1000 * (generation + 1),
        }  # fmt: skip
        lines.append(json.dumps(entry) + "\n")
    (folder / "progress.jsonl").write_text("".join(lines))
    (folder / "checkpoint.json").write_text(json.dumps({"schema": 1, "stage": stage}))
    still = tuple(parse(text, ()) for text in ("0", "0", "0"))
    save_controller(
        Controller(folder.name, "luxo-1997", "position", 0.02, still, LAMP.names), folder / "controller.toml"
    )
    return folder
