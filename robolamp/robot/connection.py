"""How a lamp is reached: its ports, the time that passes at them, and how late an answer may be there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

from robolamp.dynamixel.bus import PATIENCE, SETTING_PATIENCE, Port
from robolamp.foot.sensor import ByteSource
from robolamp.lamp import Lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.signals import Clock

_EMULATOR_PATIENCE = 0.012  # the emulator is one process among others and may be scheduled late; of a tick of 20 ms [s]
_EMULATOR_OPENING = 0.3  # the same outside the loop, where nothing waits for the answer [s]. Chosen: 25 times as long
_PSEUDO_TERMINALS = Path("/dev/pts")  # where emulated ports are; a servo's never is


@dataclass(frozen=True)
class Connection:
    """A lamp's ports, and the time that passes at them.

    Attributes:
        servo_port: Of the servo bus: a path, or a port object.
        foot_port: Of the foot sensor: a path, or a port object; None: there is none, as on a servo's bench.
        clock: The time at the ports.
        epoch: Nanoseconds since the epoch at a virtual clock's 0; None: real time.
        patience: How long an answer may be late in the loop before it is a gap [s].
        opening: The same while the lamp is opened and its torque turned on [s].
    """

    servo_port: str | Port
    foot_port: str | ByteSource | None
    clock: Clock
    epoch: int | None = None
    patience: float = PATIENCE
    opening: float = SETTING_PATIENCE

    @classmethod
    def real(cls, servo_port: str, foot_port: str | None, clock: Clock) -> Self:
        """Return the connection by serial ports, physical or emulated ones, in real time.

        Args:
            servo_port: Path of the servo bus.
            foot_port: Path of the foot sensor; None: there is none.
            clock: The computer's.
        """
        emulated = Path(servo_port).resolve().is_relative_to(_PSEUDO_TERMINALS)
        waits = (_EMULATOR_PATIENCE, _EMULATOR_OPENING) if emulated else (PATIENCE, SETTING_PATIENCE)
        return cls(servo_port, foot_port, clock, None, *waits)

    def robot(self, lamp: Lamp, *, duty: float = 1.0, fix: bool = False) -> RobotLamp:
        """Return the lamp there, not yet opened.

        Args:
            lamp: Its description.
            duty: As for `RobotLamp`.
            fix: As for `RobotLamp`.
        """
        return RobotLamp(
            lamp, self.servo_port, self.foot_port, self.clock,
            patience=self.patience, opening=self.opening, duty=duty, fix=fix,
        )  # fmt: skip
