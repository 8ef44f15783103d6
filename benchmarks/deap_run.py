"""The same task and parameters as a DEAP user would write them, against robolamp's own evolution, in one run.

The DEAP side: a primitive set over the task's terminals, three trees an individual compiled to Python functions, DEAP's
tournament, one-point crossover and height limit, and a pool of processes in which every case steps one `mujoco.MjData`
in a Python loop: sensors, controller and envelope each control period, load-dependent friction, `mj_step` and the
judging each physics step. Twin, start, goals and fitness are the same; that is checked on random individuals first.
Random numbers are not, so each side finds its own controllers: compared is the time to the worse of their two bests.
"""

from __future__ import annotations

import argparse
import copy
import math
import multiprocessing
import operator
import random
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from deap import base, creator, gp, tools

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.expression import parse
from robolamp.controller.program import Program, compile_program
from robolamp.evolve.evolution import evolve
from robolamp.evolve.tasks.fitness import weighted
from robolamp.evolve.tasks.task import Task, load_task
from robolamp.lamp import load_lamp
from robolamp.twin.actuators.motors import Motors, Views
from robolamp.twin.judges.lamp_judge import FALLEN_HEAD, FALLEN_TILT, GOAL_RADIUS, Outcome
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.fleet import Fleet, Job
from robolamp.twin.lanes.lamp_lanes import settle

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)
SIGNALS = ("t", "a0", "a1", "a2", "s0", "px", "py", "pz", "vx", "vy", "vz", "goal_met", "goal_dist")
TERMS = {"distance", "arrival", "travel_after", "posture", "fall"}
ENCODER, NEWTON = 2 * math.pi / 4096, 0.001  # what servos and foot sensor resolve [rad, N]
CHECKED = 12  # random individuals, on both sides
History = list[tuple[float, float]]  # of each generation the best fitness so far, at full phase, and the time [s]

creator.create("Fitness", base.Fitness, weights=(-1.0,))
creator.create("Individual", list, fitness=creator.Fitness, main=0.0, style=0.0)


def divide(a: float, b: float) -> float:
    return 1.0 if b == 0.0 else a / b


def ifltz(a: float, b: float, c: float) -> float:
    return b if a < 0.0 else c


def ephemeral() -> float:
    return round(random.uniform(-30.0, 30.0), 4)


def primitives() -> gp.PrimitiveSet:
    pset = gp.PrimitiveSet("MAIN", len(SIGNALS))
    pset.renameArguments(**{f"ARG{index}": name for index, name in enumerate(SIGNALS)})
    for function, arity in ((operator.add, 2), (operator.sub, 2), (operator.mul, 2), (divide, 2), (ifltz, 3)):
        pset.addPrimitive(function, arity)
    pset.addEphemeralConstant("constant", ephemeral)
    return pset


PSET = primitives()


@dataclass
class Setup:
    """What a process of the pool evaluates with."""

    task: Task
    twin: TwinModel
    goals: tuple[float, ...]
    state: np.ndarray


SETUP: list[Setup] = []  # one, inherited by the processes of the pool


def simulate(setup: Setup, functions: Sequence[Callable[..., float]], goal: float) -> tuple[float, float]:
    """Run one case; return its main and style fitness."""
    task, twin = setup.task, setup.twin
    model = copy.copy(twin.model)
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, setup.state, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_forward(model, data)
    motors = Motors([twin], Views.of_one(model, data))
    lower, upper = LAMP.lower.tolist(), LAMP.upper.tolist()
    step = (LAMP.slew * task.control_period).tolist()
    joints = twin.qpos.tolist()
    substeps = round(task.control_period / twin.timestep)
    delay = round(twin.line_delay / twin.timestep)
    limit, (radius, half) = math.cos(FALLEN_TILT), twin.head_size
    sent = [0.0] * len(joints)
    now, x, after, arrival, fallen = 0.0, float(data.qpos[0]), 0.0, math.nan, False
    for tick in range(round(task.duration / task.control_period)):
        px, py, pz = data.qpos[:3].tolist()
        angles = [round(value / ENCODER) * ENCODER for value in data.qpos[joints].tolist()]
        force = round(float(data.sensordata[twin.foot_sensor]) * twin.foot_gain / NEWTON) * NEWTON
        met = 0.0 if math.isnan(arrival) else 1.0
        signals = (tick * task.control_period, *angles, force, px - goal, py, pz, *data.qvel[:3].tolist(), met, goal)
        last, sent = sent, list(sent)
        for index, function in enumerate(functions):
            try:
                wanted = function(*signals)
            except OverflowError:
                wanted = math.inf
            if math.isfinite(wanted):
                inside = min(max(wanted, lower[index]), upper[index])
                sent[index] = min(max(inside, last[index] - step[index]), last[index] + step[index])
        for substep in range(substeps):
            motors.goal[0] = last if substep < delay else sent
            motors.before_step()
            mujoco.mj_step(model, data)
            now += twin.timestep
            moved, x = abs(float(data.qpos[0]) - x), float(data.qpos[0])
            if not math.isnan(arrival):
                after += moved
            elif abs(x - goal) <= GOAL_RADIUS:
                arrival = now
            qx, qy = data.qpos[4], data.qpos[5]
            upright = min(max(data.site_xmat[twin.head_site, 8], -1.0), 1.0)
            lowest = (
                data.site_xpos[twin.head_site, 2] - radius * math.sqrt(1.0 - upright * upright) - half * abs(upright)
            )
            fallen = fallen or 1.0 - 2.0 * (qx * qx + qy * qy) < limit or lowest < FALLEN_HEAD
        fallen = fallen or bool(data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number)
        if fallen:
            break
    values = {
        "distance": abs(x - goal) / goal,
        "arrival": 1.0 if math.isnan(arrival) else arrival / task.duration,
        "travel_after": min(after / goal, 1.0),
        "posture": min(float(np.abs(data.qpos[twin.qpos]).mean()), 1.0),
        "fall": float(fallen),
    }
    main = sum(weight * values[name] for name, weight in task.main.items())
    return main, sum(weight * values[name] for name, weight in task.style.items())


def evaluate(individual: Sequence[gp.PrimitiveTree]) -> tuple[float, float]:
    """Return main and style fitness of an individual, the mean over the goals."""
    (setup,) = SETUP
    functions = [gp.compile(tree, PSET) for tree in individual]
    return tuple(np.mean([simulate(setup, functions, goal) for goal in setup.goals], axis=0).tolist())


def toolbox(task: Task) -> base.Toolbox:
    box = base.Toolbox()
    shortest, tallest = task.gp.depth_at_birth
    box.register("tree", tools.initIterate, gp.PrimitiveTree, lambda: gp.genHalfAndHalf(PSET, shortest, tallest))
    box.register("individual", tools.initRepeat, creator.Individual, box.tree, n=len(LAMP.joints))
    box.register("population", tools.initRepeat, list, box.individual)
    box.register("select", tools.selTournament, tournsize=task.gp.tournament)
    box.register("mate_trees", gp.cxOnePoint)
    box.decorate("mate_trees", gp.staticLimit(key=operator.attrgetter("height"), max_value=task.gp.depth))
    return box


def deap_evolution(
    task: Task, twin: TwinModel, goals: tuple[float, ...], seed: int, workers: int
) -> list[tuple[float, float]]:
    """Evolve with DEAP."""
    began = time.perf_counter()
    random.seed(seed)
    SETUP[:] = [Setup(task, twin, goals, settle(twin))]
    box, history, best = toolbox(task), [], math.inf
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        population = box.population(n=task.gp.population)
        for generation in range(task.gp.generations):
            changed = [individual for individual in population if not individual.fitness.valid]
            for individual, (main, style) in zip(changed, pool.map(evaluate, changed, chunksize=1), strict=True):
                individual.main, individual.style = main, style
            phase = math.sqrt(generation / task.gp.generations)
            for individual in population:
                individual.fitness.values = (individual.main + phase * individual.style,)
            best = min(best, *(individual.main + individual.style for individual in population))
            history.append((best, time.perf_counter() - began))
            offspring = [box.clone(individual) for individual in box.select(population, len(population))]
            for mother, father in zip(offspring[::2], offspring[1::2], strict=False):
                if random.random() < task.gp.crossover:
                    a, b = random.randrange(len(mother)), random.randrange(len(father))
                    mother[a], father[b] = box.mate_trees(mother[a], father[b])
                    del mother.fitness.values, father.fitness.values
            population = offspring
    return history


def own_evolution(task: Task, seed: int, workers: int) -> tuple[History, tuple[float, ...]]:
    """Evolve with robolamp; return the goals, too."""
    goals: set[float] = set()

    class Listening(Fleet):
        def run(self, programs: Sequence[Program], jobs: Sequence[Job], duration: float, **options) -> Outcome:
            goals.update(job.goal for job in jobs)
            return super().run(programs, jobs, duration, **options)

    with tempfile.TemporaryDirectory() as folder:
        result = evolve(
            task, LAMP, CALIBRATION, ASSETS, Path(folder) / "run", seed=seed,
            evaluator=lambda twins, period: Listening(twins, period, workers),
        )  # fmt: skip
    return [(entry.champion_fitness, entry.wall_s) for entry in result.generations], tuple(sorted(goals))


def check(task: Task, twin: TwinModel) -> float:
    """Return the largest difference of fitness between the two sides, over random individuals."""
    names = {"add": "+", "sub": "-", "mul": "*", "divide": "%", "ifltz": "ifltz"}

    def text(tree: gp.PrimitiveTree) -> str:
        def written() -> str:
            node = next(nodes)
            if node.arity:
                return f"({names[node.name]} {' '.join(written() for _ in range(node.arity))})"
            return str(node.value)

        nodes = iter(tree)
        return written()

    random.seed(0)
    SETUP[:] = [Setup(task, twin, (0.1, 0.35), settle(twin))]
    individuals = toolbox(task).population(n=CHECKED)
    programs = [compile_program([parse(text(tree), SIGNALS) for tree in item], SIGNALS) for item in individuals]
    jobs = [Job(index, 0, goal) for index in range(CHECKED) for goal in SETUP[0].goals]
    outcome = Fleet([twin], task.control_period).run(programs, jobs, task.duration)
    own = np.stack([weighted(outcome, task.main), weighted(outcome, task.style)]).reshape(2, CHECKED, -1).mean(axis=2).T
    return float(np.abs(own - [evaluate(item) for item in individuals]).max())


def reached(history: History, fitness: float) -> float:
    """Return the time at which a best-so-far fitness was first as good as this [s]."""
    return next(seconds for best, seconds in history if best <= fitness)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--population", type=int, default=40)
    parser.add_argument("--generations", type=int, default=5)
    parser.add_argument("--duration", type=float, default=2.0, help="of a trial [s]")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2, help="processes there, threads here")
    options = parser.parse_args()
    sizes = {"gp.population": options.population, "gp.generations": options.generations, "duration": options.duration}
    task = load_task(ASSETS, "luxo-1997", len(LAMP.joints), [f"{key}={value}" for key, value in sizes.items()])
    assert set(task.main) | set(task.style) <= TERMS
    assert task.signals == SIGNALS
    twin = build(LAMP, CALIBRATION, ASSETS, timestep=task.timestep)
    print(f"{task.name}: M = {task.gp.population}, G = {task.gp.generations}, {task.cases.count} goals,", end=" ")
    print(f"{task.duration:g} s trials, {options.workers} workers")
    print(f"the same individuals' fitness differs by {check(task, twin):.1e} at most")  # also compiles and warms up
    columns = (
        "seed",
        "DEAP best",
        "ours best",
        "same fitness",
        "DEAP s",
        "ours s",
        "times",
        "DEAP ind/s",
        "ours ind/s",
    )
    print(" ".join(f"{name:>12}" for name in columns))
    rows = []
    for seed in range(1, options.seeds + 1):
        ours, goals = own_evolution(task, seed, options.workers)
        deap = deap_evolution(task, twin, goals, seed, options.workers)
        same = max(ours[-1][0], deap[-1][0])
        slow, fast = reached(deap, same), reached(ours, same)
        examined = task.gp.population * task.gp.generations
        rows.append(
            (deap[-1][0], ours[-1][0], same, slow, fast, slow / fast, examined / deap[-1][1], examined / ours[-1][1])
        )
        print(f"{seed:>12} " + " ".join(f"{value:>12.3f}" for value in rows[-1]), flush=True)
    print(f"{'median':>12} " + " ".join(f"{value:>12.3f}" for value in np.median(rows, axis=0)))


if __name__ == "__main__":
    main()
