"""A fitness term of one's own: the lamp is to end with its head up, and its base where it was told to go.

    robolamp evolve luxo-1997 -o runs/proud --terms examples/04_fitness_term.py --set style.stoop=0.5

loads this file for its term; run by itself it evolves the same on a small scale.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.evolve.evolution import evolve
from robolamp.evolve.tasks.fitness import term
from robolamp.evolve.tasks.task import load_task
from robolamp.lamp import load_lamp
from robolamp.twin.judges.lamp_judge import Outcome


@term("stoop")
def stoop(outcome: Outcome) -> NDArray[np.float64]:
    """How far the neck is bent forward at the end [rad], one number a run, never below 0."""
    return np.maximum(outcome.angles[:, 2], 0.0)


def main() -> None:
    assets = Assets()
    lamp, calibration = load_lamp(assets), load_calibration(assets)
    changes = ["style.stoop=0.5", "gp.population=20", "gp.generations=4", "duration=1"]
    task = load_task(assets, "luxo-1997", overrides=changes)
    with TemporaryDirectory() as folder:
        run = Path(folder) / "proud"
        result = evolve(task, lamp, calibration, assets, run, seed=1, terms=Path(__file__))  # so that it can be resumed
        for entry in result.generations:
            print(f"generation {entry.generation}: best {entry.best_fitness:.3f}, {entry.tried} runs simulated so far")
        print(result.controller.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
