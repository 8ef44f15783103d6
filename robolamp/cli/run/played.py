"""Where a gesture or a sequence is played: on the emulated lamp, or by its ports on the physical one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Act
from robolamp.cli.run.emulated_run import EmulatedRun, run_emulated
from robolamp.cli.run.physical_run import PhysicalRun, run_physical
from robolamp.errors import RobolampError

_REALITY = "worn"  # as dry-run has it


@dataclass(frozen=True)
class Player:
    """What was said of where and how to play.

    Attributes:
        setup: The lamp and its twin's numbers.
        calibration: Those numbers, as `--calibration` takes them.
        lamp: Folder of one's own lamp; None: the shipped one.
        port: Serial port of the servos; None: on the emulated lamp.
        foot_port: Serial port of the foot sensor.
        stage: How far a physical lamp may go.
        after: The log of the stage before.
        force: Whether none is needed.
        fix: Whether settings of its servos are mended.
        reality: How an emulated lamp differs from its twin; None: as dry-run has it.
        lockstep: Whether that runs in virtual time.
        browse: Whether the run is shown in the browser.
        output: Folder of the run; None: a new one in runs/.
        as_json: Print one JSON object.

    Raises:
        RobolampError: An option is for the other of the two.
    """

    setup: Setup
    calibration: str
    lamp: Path | None
    port: str | None
    foot_port: str | None
    stage: str | None
    after: Path | None
    force: bool
    fix: bool
    reality: str | None
    lockstep: bool
    browse: bool
    output: Path | None
    as_json: bool

    def __post_init__(self) -> None:
        physical = {
            "--foot-port": self.foot_port, "--stage": self.stage, "--after": self.after, "--force": self.force,
            "--fix": self.fix,
        }  # fmt: skip
        emulated = {"--reality": self.reality, "--lockstep": self.lockstep, "--open": self.browse}
        given, needs = (physical, "with") if self.port is None else (emulated, "without")
        for option, value in given.items():
            if value:
                raise RobolampError(f"is of use only {needs} --port", option)

    def play(self, act: Act, goal: float, duration: float) -> int:
        """Play it, and return the exit code.

        Args:
            act: What drives.
            goal: Commanded distance [m]; NaN: none is.
            duration: How long it takes [s].
        """
        if self.port is not None:
            where = PhysicalRun(
                self.setup, self.port, self.foot_port, self.stage, self.after, self.force, self.fix
            )  # fmt: skip
            return run_physical(where, act, goal, duration, output=self.output, as_json=self.as_json)
        emulated = EmulatedRun(
            self.setup, self.reality or _REALITY, self.calibration, self.lamp, lockstep=self.lockstep
        )
        return run_emulated(emulated, act, goal, duration, output=self.output, browse=self.browse, as_json=self.as_json)
