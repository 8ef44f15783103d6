"""Where a gesture or a sequence is played: on the emulated lamp, or by its ports on the physical one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from robolamp.cli.options import Setup
from robolamp.errors import RobolampError

if TYPE_CHECKING:
    from robolamp.cli.run.drive import Act

_REALITY = "worn"  # as dry-run has it


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Player:
    """Where and how to play.

    Attributes:
        port: Serial port of the servos: play it on the physical lamp there.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        stage: With --port, how much of itself the lamp may use: shadow (torque stays off), gentle, full; see
            `robolamp deploy --help`.
        after: The log of the stage before, which gentle and full need.
        force: Run --stage gentle or full without the log of the stage before.
        fix: With --port, mend wrong servo settings (EEPROM) first.
        reality: Without --port, how the emulated lamp differs from its twin, as dry-run takes it (worn).
        lockstep: Without --port, run lamp and loop by turns in one process, in virtual time.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        output: Folder for log and report; by default a new one in runs/.
        browse: Without --port, play the run in the browser at the end.
        as_json: Print one JSON object.

    Raises:
        RobolampError: An option is for the other of the two lamps.
    """

    port: str | None = None
    foot_port: str | None = None
    stage: Literal["shadow", "gentle", "full"] | None = None
    after: Path | None = None
    force: Annotated[bool, Parameter(negative="")] = False
    fix: Annotated[bool, Parameter(negative="")] = False
    reality: str | None = None
    lockstep: Annotated[bool, Parameter(negative="")] = False
    calibration: str = "nominal"
    lamp: Path | None = None
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None
    browse: Annotated[bool, Parameter(name="--open", negative="")] = False
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False

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

    @cached_property
    def setup(self) -> Setup:
        """The lamp and its twin's numbers."""
        return Setup.of(self.lamp, self.calibration)

    def play(self, act: Act, goal: float, duration: float) -> int:
        """Play it, and return the exit code.

        Args:
            act: What drives.
            goal: Commanded distance [m]; NaN: none is.
            duration: How long it takes [s].
        """
        if self.port is not None:
            from robolamp.cli.run.physical_run import PhysicalRun, run_physical  # after the arguments are checked

            lamp = PhysicalRun(self.setup, self.port, self.foot_port, self.stage, self.after, self.force, self.fix)
            return run_physical(lamp, act, goal, duration, output=self.output, as_json=self.as_json)
        from robolamp.cli.run.emulated_run import EmulatedRun, run_emulated

        how = EmulatedRun(self.setup, self.reality or _REALITY, lockstep=self.lockstep)
        return run_emulated(how, act, goal, duration, output=self.output, browse=self.browse, as_json=self.as_json)


HERE = Player()
"""On the emulated lamp, as its defaults have it."""
