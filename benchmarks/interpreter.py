"""How fast controllers are evaluated: by the batch interpreter (many lanes, numba) and by the lamp's (one lane)."""

from __future__ import annotations

import argparse
import time

import numpy as np

from robolamp.controller.expression import Expression, Token
from robolamp.controller.primitives import PRIMITIVES
from robolamp.controller.program import Program, ProgramSet, compile_program
from robolamp.controller.terminals import on_board_terminals

JOINTS = 3
TERMINALS = on_board_terminals(JOINTS)
NODES = (10, 50, 200)


def random_tree(rng: np.random.Generator, nodes: int) -> tuple[Token, ...]:
    """Return a random tree of exactly that many nodes (not 2: no function has one argument)."""
    if nodes == 1:
        return (TERMINALS[rng.integers(len(TERMINALS))],) if rng.random() < 0.75 else (float(rng.normal()),)
    names = [name for name, function in PRIMITIVES.items() if function.arity < nodes]
    while True:
        name = names[rng.integers(len(names))]
        arity = PRIMITIVES[name].arity
        cuts = np.sort(rng.choice(np.arange(1, nodes - 1), arity - 1, replace=False))
        sizes = np.diff([0, *cuts, nodes - 1])
        if 2 not in sizes:
            return (name, *(token for size in sizes for token in random_tree(rng, int(size))))


def random_program(rng: np.random.Generator, nodes: int) -> Program:
    """Return a program of that many nodes, shared out over the joints."""
    sizes = [nodes // JOINTS + (joint < nodes % JOINTS) for joint in range(JOINTS)]
    return compile_program([Expression(random_tree(rng, size)) for size in sizes], TERMINALS)


def rate(work, seconds: float) -> float:
    """Return how often work can be called in a second: the median of three tries."""
    work()
    rates = []
    for _ in range(3):
        count, began = 0, time.perf_counter()
        while time.perf_counter() - began < seconds / 3:
            work()
            count += 1
        rates.append(count / (time.perf_counter() - began))
    return float(np.median(rates))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=int, default=250, help="controllers of a population")
    parser.add_argument("--lanes", type=int, default=1500, help="lanes: controllers times goals")
    parser.add_argument("--seconds", type=float, default=3.0, help="time for each figure [s]")
    options = parser.parse_args()
    rng = np.random.default_rng(1)
    own = np.arange(options.lanes) * options.programs // options.lanes
    inputs = rng.normal(size=(options.lanes, len(TERMINALS)))
    outputs, row = np.empty((options.lanes, JOINTS)), inputs[0].tolist()
    print(f"{options.programs} programs on {options.lanes} lanes, one thread; a tick evaluates all {JOINTS} joints")
    print(f"{'nodes':>6} {'batch, lanes x ticks/s':>24} {'nodes/s':>10} {'one lane, ticks/s':>18}")
    for nodes in NODES:
        programs = [random_program(rng, nodes) for _ in range(options.programs)]
        together = ProgramSet(programs)
        batch = rate(lambda together=together: together.run(own, inputs, outputs), options.seconds) * options.lanes
        one = rate(lambda programs=programs: [program.run(row) for program in programs], options.seconds)
        print(f"{nodes:>6} {batch:>24,.0f} {batch * nodes:>10.1e} {one * options.programs:>18,.0f}")


if __name__ == "__main__":
    main()
