"""What the servos' settings must be for the lamp's driver, and how wrong ones are written."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from robolamp.dynamixel.registers import COUNTS_PER_TURN, FULL_PWM, RAD_PER_COUNT, Model, Name, OperatingMode
from robolamp.dynamixel.servos import Servos

LIMIT_MARGIN = 10
"""How far beyond the joint's range Position Limits are set [counts], as hardware/README.md says."""


@dataclass(frozen=True)
class Setting:
    """A setting that is wrong.

    Attributes:
        text: What is wrong, and how to mend it.
        servos: The servos.
        index: Which of them.
        registers: What to write, in counts; empty where writing would not mend it.
    """

    text: str
    servos: Servos
    index: int
    registers: Mapping[Name, int] = field(default_factory=dict)

    def write(self) -> None:
        """Write the right values (EEPROM: torque must be off).

        Raises:
            BusError: The servo does not answer or refuses.
        """
        for name, value in self.registers.items():
            self.servos.set(self.index, name, value)


def limits_of(servos: Servos, index: int) -> tuple[float, float]:
    """Return a servo's Min and Max Voltage Limit [V].

    Raises:
        BusError: It does not answer.
    """
    return servos.value(index, Name.MIN_VOLTAGE_LIMIT), servos.value(index, Name.MAX_VOLTAGE_LIMIT)


def wrong_settings(servos: Servos, index: int, model: Model, first: float, last: float) -> Iterator[Setting]:
    """Yield what is wrong with a servo's EEPROM.

    Profiles, P gain, Goal PWM and watchdog are in RAM: they are written whenever torque goes on.

    Args:
        servos: The servos.
        index: Which of them.
        model: Its model.
        first: Smallest servo angle that the joint may have [rad].
        last: Largest servo angle that the joint may have [rad].

    Raises:
        BusError: It does not answer.
    """

    def value(name: Name) -> int:
        return round(servos.value(index, name) / model[name].scale)

    def named(name: Name) -> str:
        return f"{name}({model[name].address})"

    wanted = (
        (Name.OPERATING_MODE, int(OperatingMode.POSITION), "position"),
        (Name.DRIVE_MODE, 0, "normal, velocity profile"),
        (Name.RETURN_DELAY_TIME, 0, "each 1 is 2 us lost for each servo and read"),
        (Name.PWM_LIMIT, FULL_PWM, "full duty"),
        (Name.SHUTDOWN, model[Name.SHUTDOWN].initial or 0, "voltage, heat, shock and overload turn torque off"),
    )
    for name, right, why in wanted:
        found = value(name)
        if found != right:
            text = f"{named(name)} is {found}, not {right} ({why}); write {right} with torque off"
            yield Setting(text, servos, index, {name: right})
    heat, most = value(Name.TEMPERATURE_LIMIT), model[Name.TEMPERATURE_LIMIT].initial or 0
    if heat > most:
        text = f"{named(Name.TEMPERATURE_LIMIT)} is {heat} degC, above {most}; write {most} with torque off"
        yield Setting(text, servos, index, {Name.TEMPERATURE_LIMIT: most})
    low, high = servos.value(index, Name.MIN_POSITION_LIMIT), servos.value(index, Name.MAX_POSITION_LIMIT)
    if first < low or last > high:
        bottom = math.floor(first / RAD_PER_COUNT) - LIMIT_MARGIN
        top = math.ceil(last / RAD_PER_COUNT) + LIMIT_MARGIN
        inside = bottom >= 0 and top < COUNTS_PER_TURN
        yield Setting(
            f"the joint's range is {first:.2f} to {last:.2f} rad of the servo's turn, outside its Position Limits "
            f"(52, 48) of {low:.2f} to {high:.2f}; widen them, or mount the horn so that the range does not cross 0",
            servos,
            index,
            {Name.MIN_POSITION_LIMIT: bottom, Name.MAX_POSITION_LIMIT: top} if inside else {},
        )
