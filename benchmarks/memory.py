"""Peak memory of evolving a large population: 1,000 individuals x 6 goals, which must stay below 2 GiB.

Two generations, because the second one begins with what the first one left: the recorded runs of the parents. A process
of its own evolves them, so that its peak is not this one's; the bare import of the same modules is shown beside it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile

LIMIT = 2.0  # GiB
IMPORT = "import robolamp.cli.main, robolamp.evolve.evolution"


def peak(*command: str) -> float:
    """Run a command in a process of its own; return its peak resident set [GiB]."""
    program = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL);"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    # A process between, whose only child it is: the peak of children is that of the largest so far.
    told = subprocess.run([sys.executable, "-c", program, *command], check=True, capture_output=True, text=True)
    unit = 1 if sys.platform == "darwin" else 1024  # getrusage(2): bytes there, kilobytes on Linux
    return int(told.stdout) * unit / 2**30


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="luxo-1997")
    parser.add_argument("--population", type=int, default=1000)
    parser.add_argument("--goals", type=int, default=6)
    parser.add_argument("--generations", type=int, default=2)
    parser.add_argument("--timestep", type=float, default=0.004, help="memory does not depend on it, time does [s]")
    options = parser.parse_args()
    sizes = {
        "gp.population": options.population,
        "gp.generations": options.generations,
        "cases.count": options.goals,
        "timestep": options.timestep,
    }
    own = [item for key, value in sizes.items() for item in ("--set", f"{key}={value}")]
    with tempfile.TemporaryDirectory() as folder:
        found = peak(sys.executable, "-m", "robolamp", "evolve", options.task, "-o", f"{folder}/run", *own, "--json")
    bare = peak(sys.executable, "-c", IMPORT)
    print(f"peak resident, {options.population} individuals x {options.goals} goals, {options.generations} generations")
    print(f"{'evolving':<10} {found:>6.2f} GiB  ({'below' if found < LIMIT else 'NOT BELOW'} {LIMIT:g})")
    print(f"{'imports':<10} {bare:>6.2f} GiB")


if __name__ == "__main__":
    main()
