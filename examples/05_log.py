"""A log in numpy: the twin stands up and crouches, every tick is logged, and the log is read back and asked."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.lamp import load_lamp
from robolamp.log.reader import read_run
from robolamp.log.run_table import columns_of, export
from robolamp.log.writer import LogWriter
from robolamp.signals import Command, Tick
from robolamp.twin.lamp_model import build
from robolamp.twin.twin_lamp import TwinLamp

PERIOD = 0.02  # s


def record(path: Path) -> None:
    """Log two seconds of a sine in the knee."""
    assets = Assets()
    lamp = TwinLamp(build(load_lamp(assets), load_calibration(assets), assets))
    lamp.open()
    lamp.torque(True)
    context = {"backend": "twin", "control_period": repr(PERIOD)}
    with LogWriter(path, context=context, joints=lamp.joints, now=0.0, lossless=True) as log:
        for index in range(100):
            due = index * PERIOD
            lamp.clock.sleep_until(due)
            seen = lamp.observe()
            goal = np.array([0.0, 0.3 * np.sin(2 * np.pi * due), 0.0])
            lamp.command(Command(goal))
            log.tick(Tick(index, "run", due, due, seen.time, due, seen, goal))
    lamp.close()


def main() -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        record(path)
        run = read_run(path)  # any log: of the twin, of an emulated lamp, of yours
        knee = run.joints.index("knee")
        error = run.goal[:, knee] - run.angle[:, knee]
        print(f"{run.index.size} ticks of {', '.join(run.joints)}, {run.missed_ticks} missed")
        print(
            f"knee: {np.abs(error).mean() * 1e3:.0f} mrad off its goal on average; floor {run.foot_force.mean():.2f} N"
        )
        columns = columns_of(run)  # pandas.DataFrame(columns) is the same as a frame
        print(f"{len(columns)} columns, among them {', '.join(name for name in columns if name.startswith('knee'))}")
        export(run, path.with_suffix(".csv"))
        print((Path(folder) / "run.csv").read_text(encoding="utf-8").splitlines()[1][:60], "...")


if __name__ == "__main__":
    main()
