"""The emulated lamp in lockstep, for `dry-run --lockstep`: one process, virtual time."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

from robolamp.cli.drive import VirtualTime
from robolamp.cli.emulating import InjectionLog
from robolamp.cli.options import Setup
from robolamp.emulator.faults import Faults
from robolamp.emulator.lamp import EmulatedLamp
from robolamp.emulator.lockstep import Lockstep
from robolamp.emulator.reality import Reality
from robolamp.emulator.truth import TruthLog
from robolamp.errors import FileError
from robolamp.log.context import versions


@contextlib.contextmanager
def lockstep_lamp(
    setup: Setup, reality: Reality, faults: Faults, truth: Path, injections: Path | None
) -> Iterator[tuple[Lockstep, VirtualTime]]:
    """Yield an emulated lamp's ports, and its time; close its logs afterwards.

    Args:
        setup: The lamp and its calibration.
        reality: How it differs from its twin.
        faults: What goes wrong.
        truth: File for what really happens.
        injections: File for what was injected; None: nowhere.

    Raises:
        FileError: A file cannot be written.
    """
    world = EmulatedLamp(setup.lamp, setup.calibration, setup.assets, reality, faults=faults)
    epoch = time.time_ns()
    context = {"backend": "emulator", "lamp": setup.lamp.source, "calibration": setup.calibration.source}
    log = TruthLog(truth, world, 0.0, {**context, "reality": reality.name, "versions": versions()}, epoch=epoch)
    try:
        with contextlib.closing(InjectionLog(injections)) as report:
            world.injector.report = report.write
            lockstep = Lockstep(world, setup.lamp.bus_baud)
            yield lockstep, VirtualTime(lockstep.clock, epoch)
    finally:
        log.close()
    if log.error:
        raise FileError(f"the truth log ended early: {log.error}", str(truth))
