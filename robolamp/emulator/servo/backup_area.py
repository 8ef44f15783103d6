"""A servo's backup area: what Control Table Backup(0x20) stores of its control table, and gives back.

From the e-manual's protocol 2.0 page ("Control Table Backup") and Startup Configuration(60), bit 1 (RAM Restore).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from robolamp.dynamixel.registers import Name
from robolamp.emulator.servo.control_table import ControlTable

STORE, RESTORE = 0x01, 0x02
"""First parameter of the instruction."""

FIXED = b"CTRL"
"""Its other parameters."""

RAM = (
    Name.VELOCITY_I_GAIN,
    Name.VELOCITY_P_GAIN,
    Name.POSITION_D_GAIN,
    Name.POSITION_I_GAIN,
    Name.POSITION_P_GAIN,
    Name.FEEDFORWARD_2ND_GAIN,
    Name.FEEDFORWARD_1ST_GAIN,
    Name.PROFILE_ACCELERATION,
    Name.PROFILE_VELOCITY,
)
"""Registers of RAM that it holds; indirect addresses come on top."""


@dataclass(frozen=True)
class Backup:
    """What a backup holds.

    Attributes:
        registers: Values by register: all EEPROM that may be written, and `RAM`.
        indirect: Every Indirect Address, in order.
    """

    registers: Mapping[Name, int]
    indirect: tuple[int, ...]

    @classmethod
    def of(cls, table: ControlTable) -> Backup:
        """Return a backup of a control table as it is now."""
        return cls({**table.eeprom(), **{name: table.get(name) for name in RAM}}, table.indirect())

    def restore_eeprom(self, table: ControlTable) -> None:
        """Give EEPROM back."""
        for name in table.eeprom():
            table.put(name, self.registers[name])

    def restore_ram(self, table: ControlTable) -> None:
        """Give back what it holds of RAM."""
        for name in RAM:
            table.put(name, self.registers[name])
        table.point(self.indirect)
