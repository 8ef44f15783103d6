"""The folder that keeps the runs of studies, all at one scale: what each came to, and how what is missing is run."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.controller.controller_file import load_controller
from robolamp.errors import FileError
from robolamp.evolve.checkpoint import NAME as CHECKPOINT
from robolamp.evolve.evolution import evolve, resume
from robolamp.evolve.progress import Generation
from robolamp.evolve.study.plan import TASK, Order, Point
from robolamp.evolve.tasks.task import load_task
from robolamp.evolve.tasks.task_twins import compiled
from robolamp.files import MOST_LOG, alone, parse_json, parse_toml, read_text, read_toml, write_atomic
from robolamp.lamp import Lamp
from robolamp.twin.lamp_model import fingerprint

_CONTROLLERS = "sim/lamp/controllers"  # what a task's seeds may be names of: only the lamp's tasks have any
_COLUMNS = ("individuals", "best_fitness", "best_whole", "champion_fitness", "physics_steps")


@dataclass(frozen=True)
class Curve:
    """The course of a run; arrays have shape (generations,).

    Attributes:
        individuals: Examined so far, the paper's measure of work.
        as_run: Fitness of the best of the generation at that generation's phase.
        whole: Fitness of the same individual at phase 1.
        champion: Best fitness at phase 1 so far in the run: of the controller that it leaves.
        physics_steps: Simulated steps so far.
        succeeded: Whether that controller hits all its cases.
    """

    individuals: NDArray[np.int64]
    as_run: NDArray[np.float64]
    whole: NDArray[np.float64]
    champion: NDArray[np.float64]
    physics_steps: NDArray[np.int64]
    succeeded: bool = False

    def after(self, steps: NDArray[np.int64]) -> Curve:
        """Return what was known after so many physics steps: the course at generations that were then done.

        Args:
            steps: Ascending, none before the end of the first generation, shape (k,).
        """
        at = np.searchsorted(self.physics_steps, steps, side="right") - 1
        return Curve(self.individuals[at], self.as_run[at], self.whole[at], self.champion[at], steps, self.succeeded)

    @property
    def final(self) -> float:
        """Fitness of the run's champion, at phase 1."""
        return float(self.champion[-1])


@dataclass(frozen=True)
class Scale:
    """What all runs of a folder have in common.

    Attributes:
        settings: What `--set` changes of the task, each as KEY=VALUE, sorted.
        calibration: Name of the twin's numbers.
        inputs: The task as read, and the hashes of the calibration and of the lamp, by name.
    """

    settings: tuple[str, ...]
    calibration: str
    inputs: Mapping[str, Any]

    @classmethod
    def of(cls, assets: Assets, lamp: Lamp, calibration: Calibration, words: Sequence[str], task: str = TASK) -> Scale:
        """Return the scale of runs to be made; of a key that is set twice the last value counts.

        Args:
            assets: Where data files are.
            lamp: The lamp.
            calibration: The twin's numbers.
            words: What `--set` changes of the task, each as KEY=VALUE.
            task: The studies' task.

        Raises:
            RobolampError: No task comes of the words, or no model of the lamp.
        """
        settings = tuple(sorted({word.partition("=")[0].strip(): word for word in words}.values()))
        loaded = load_task(assets, task, overrides=settings)
        own = replace(loaded, cases=replace(loaded.cases, lamps=1))  # the calibrated lamp stands for the others
        twins = compiled(own, lamp, calibration, assets, np.random.default_rng(0))
        inputs = {
            "task": parse_toml(loaded.source, task),
            "calibration_sha256": calibration.hash,
            "lamp_sha256": fingerprint(twins),
        }
        return cls(settings, calibration.name, inputs)


class Shelf:
    """The runs of a folder.

    Attributes:
        runs: The folder that holds a folder for each run.

        task: Whose runs they are.

    Args:
        folder: As typed; the runs are in a folder of it that is named after their task.
        task: The studies' task.
    """

    def __init__(self, folder: Path, task: str = TASK) -> None:
        self.task, self.runs = task, folder / task
        self._scale = self.runs / "scale.json"

    def scale(self) -> Scale | None:
        """Return what the runs here were made with; None where there is none yet.

        Raises:
            FileError: The note of it is damaged.
        """
        if not self._scale.exists():
            return None
        text = read_text(self._scale)
        try:
            found = parse_json(text, str(self._scale))
            return Scale(tuple(found["settings"]), found["calibration"], found["inputs"])
        except (FileError, TypeError, KeyError):
            raise FileError("is not the note of settings that `robolamp study` keeps", str(self._scale)) from None

    def claim(self, scale: Scale) -> None:
        """Note what the runs here will be made with, or see that it is what the earlier ones were.

        Raises:
            FileError: Earlier runs were made otherwise and would not compare; or the folder cannot be written.
        """
        if self.scale() is None:
            write_atomic(self._scale, json.dumps(vars(scale), indent=1) + "\n")
        self.check(scale)

    def check(self, scale: Scale) -> None:
        """See that the runs here were made with a scale.

        Raises:
            FileError: They were not, and would not compare with others that are.
        """
        before = self.scale()
        if before is None or before == scale:
            return
        what = f"another {self.task}.toml, calibration or lamp"
        if before.settings != scale.settings:
            old, new = (" ".join(each.settings) or "(nothing)" for each in (before, scale))
            what = f"--set {old}, not {new}"
        elif before.calibration != scale.calibration:
            what = f"--calibration {before.calibration}, not {scale.calibration}"
        raise FileError(f"holds runs made with {what}: they would not compare; give another -o", str(self.runs))

    def alone(self) -> AbstractContextManager[None]:
        """Keep other processes from working on the runs here; see `robolamp.files.alone`."""
        return alone(self.runs)

    def path(self, order: Order) -> Path:
        """Return a run's folder."""
        return self.runs / order.name

    def generations(self, order: Order) -> int:
        """Return how many generations of a run are done.

        Raises:
            FileError: Its progress.jsonl is damaged.
        """
        path = self.path(order) / "progress.jsonl"
        return len(_entries(path)) if path.exists() else 0

    def curve(self, order: Order) -> Curve | None:
        """Return the course of a run; None where it is not finished.

        Raises:
            FileError: Its progress.jsonl or checkpoint is damaged.
        """
        path = self.path(order)
        if not (path / "controller.toml").exists() or self.generations(order) < order.point.generations:
            return None
        text = read_text(path / CHECKPOINT, MOST_LOG)
        try:
            stage = parse_json(text, str(path / CHECKPOINT))["stage"]
        except (FileError, KeyError, TypeError):
            raise FileError(
                "is damaged; remove the run's folder to have it run again", str(path / CHECKPOINT)
            ) from None
        if stage != "done":
            return None
        individuals, as_run, whole, champion, steps = np.array(_entries(path / "progress.jsonl"), np.float64).T
        succeeded = _succeeded(path / "controller.toml")
        return Curve(individuals.astype(np.int64), as_run, whole, champion, steps.astype(np.int64), succeeded)

    def curves(self, point: Point) -> dict[int, Curve]:
        """Return the courses of a point's finished runs by seed, ascending.

        Raises:
            FileError: A progress.jsonl is damaged.
        """
        matches = (re.fullmatch(r"(.+)-s([1-9][0-9]{0,8})", path.name) for path in self.runs.glob("*-s*"))
        seeds = sorted(int(match[2]) for match in matches if match and match[1] == point.name)
        found = {seed: self.curve(Order(point, seed)) for seed in seeds}
        return {seed: curve for seed, curve in found.items() if curve is not None}


def carry_out(
    order: Order,
    shelf: Shelf,
    scale: Scale,
    lamp: Lamp,
    calibration: Calibration,
    assets: Assets,
    workers: int | None,
    progress: Callable[[Generation], None],
    warn: Callable[[str], None],
) -> None:
    """Make a run, or go on with it where it was stopped.

    Args:
        order: Which.
        shelf: Where.
        scale: What all runs there have in common.
        lamp: The lamp.
        calibration: The twin's numbers.
        assets: Where data files are.
        workers: Threads; None: one a core.
        progress: Called after each generation.
        warn: Called with a line where a run goes on under other versions than it began with.

    Raises:
        RobolampError: See `robolamp.evolve.evolution.evolve` and `resume`.
    """
    folder = shelf.path(order)
    if (folder / CHECKPOINT).exists():
        resume(folder, workers=workers, progress=progress, warn=warn)
        return
    if folder.exists():  # stopped before its first checkpoint: nothing was simulated yet
        shutil.rmtree(folder)
    words = ["robolamp", "evolve", shelf.task, "-o", order.name, "--seed", str(order.seed)]
    for setting in (*scale.settings, *order.point.overrides()):
        words += ["--set", setting]
    task = order.task(assets, scale.settings, shelf.task)
    seeds = [load_controller(assets.named(name, _CONTROLLERS, "controller"), lamp) for name in task.seeds]
    evolve(
        task, lamp, calibration, assets, folder, seed=order.seed, workers=workers,
        seeds=seeds[: task.gp.population], command=shlex.join(words), progress=progress,
    )  # fmt: skip


def _succeeded(path: Path) -> bool:
    scores = read_toml(path).get("scores", {})
    return bool(scores.get("cases")) and scores.get("hits") == scores["cases"]


def _entries(path: Path) -> list[list[float]]:
    entries = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        try:
            entry = parse_json(line, str(path))
            if entry.get("stage", "evolution") == "evolution":
                entries.append([float(entry[key]) for key in _COLUMNS])
        except (FileError, ValueError, OverflowError, TypeError, AttributeError, KeyError):
            wanted = ", ".join(_COLUMNS)
            raise FileError(f"line {number} is no generation of a run ({wanted})", str(path)) from None
    return entries
