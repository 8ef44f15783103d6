"""The emulated lamp in lockstep, for `dry-run --lockstep`: one process, virtual time."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType

from robolamp.cli.options import Setup
from robolamp.cli.run.emulator_parts import InjectionLog, check_logs
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import Faults
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import Reality
from robolamp.emulator.truth_log import TruthLog
from robolamp.errors import FileError, RobolampError
from robolamp.log.run_context import versions
from robolamp.robot.connection import Connection


class LockstepLamp:
    """An emulated lamp in this process, in virtual time; as a context manager it closes its logs.

    Args:
        setup: The lamp and its calibration.
        reality: How it differs from its twin.
        faults: What goes wrong.
        truth: File for what really happens.
        injections: File for what was injected; None: nowhere.

    Attributes:
        ports: Its ports and its time.
        failed: What went wrong with its logs, known at the end; None: nothing did.

    Raises:
        FileError: A file cannot be made.
    """

    def __init__(self, setup: Setup, reality: Reality, faults: Faults, truth: Path, injections: Path | None) -> None:
        world = EmulatedLamp(setup.lamp, setup.calibration, setup.assets, reality, faults=faults)
        epoch = time.time_ns()
        context = {"backend": "emulator", "lamp": setup.lamp.source, "calibration": setup.calibration.source}
        self._truth = TruthLog(
            truth, world, 0.0, {**context, "reality": reality.name, "versions": versions()}, epoch=epoch
        )
        try:
            self._report = InjectionLog(injections)
        except BaseException:
            self._truth.close()
            raise
        world.injector.report = self._report.write
        ports = Lockstep(world, setup.lamp.bus_baud)
        self.ports = Connection(ports.servo_port, ports.foot_port, ports.clock, epoch)
        self.failed: RobolampError | None = None

    def __enter__(self) -> LockstepLamp:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._report.close()
        self._truth.close()
        try:
            check_logs(self._truth, self._report)
        except FileError as error:
            self.failed = error
