"""A servo's memory without power: its EEPROM, in a file if asked, and its backup area.

From the e-manual's protocol 2.0 page ("Factory Reset", "Control Table Backup").
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from robolamp.dynamixel.registers import Model, Name
from robolamp.emulator.packet import Error
from robolamp.emulator.servo.backup_area import FIXED, RESTORE, STORE, Backup
from robolamp.emulator.servo.control_table import ControlTable, Refused
from robolamp.emulator.servo.eeprom_file import save_eeprom

_ALL = 0xFF
_RESETS: Mapping[int, tuple[Name, ...]] = {  # e-manual "Factory Reset": what each option keeps
    _ALL: (),
    0x01: (Name.ID,),
    0x02: (Name.ID, Name.BAUD_RATE),
}
_STARTUP_RAM = 0x02  # bit of Startup Configuration(60)


class Memory:
    """Keeps a control table.

    Args:
        table: The registers.
        model: Whose they are.
        store: File that keeps EEPROM; None: it ends with the process.
    """

    def __init__(self, table: ControlTable, model: Model, store: Path | None) -> None:
        self._table, self._model, self._store = table, model, store
        self._backup: Backup | None = None

    def power_on(self) -> None:
        """Give RAM its values at power-on: the backup's where Startup Configuration(60) says so."""
        self._table.power_on()
        if self._backup:
            self._table.put(Name.BACKUP_READY, 1)
            if self._table.get(Name.STARTUP_CONFIGURATION) & _STARTUP_RAM:
                self._backup.restore_ram(self._table)

    def keep(self) -> None:
        """Write EEPROM to its file.

        Raises:
            FileError: The file cannot be written.
        """
        if self._store:
            save_eeprom(self._store, self._model, self._table.eeprom())

    def factory_reset(self, parameters: bytes, *, broadcast: bool) -> bool:
        """Carry out Factory Reset(0x06).

        Args:
            parameters: Of the instruction.
            broadcast: It was meant for all servos: then everything is not reset, or all would have the same id.

        Returns:
            Whether the servo must start again.

        Raises:
            Refused: The parameters are not one known option.
        """
        if len(parameters) != 1:
            raise Refused(Error.LENGTH)
        option = parameters[0]
        if option not in _RESETS:
            raise Refused(Error.RANGE)
        if broadcast and option == _ALL:
            return False
        self._table.factory_reset(keep=_RESETS[option])
        self.keep()
        return True

    def back_up(self, parameters: bytes) -> bool:
        """Carry out Control Table Backup(0x20): store the table, or restore EEPROM.

        Args:
            parameters: Of the instruction.

        Returns:
            Whether the servo must start again.

        Raises:
            Refused: The parameters are wrong, torque is on, or there is nothing to restore.
        """
        if len(parameters) != 1 + len(FIXED):
            raise Refused(Error.LENGTH)
        if parameters[1:] != FIXED or parameters[0] not in (STORE, RESTORE) or self._table.get(Name.TORQUE_ENABLE):
            raise Refused(Error.RESULT)
        if parameters[0] == STORE:
            self._backup = Backup.of(self._table)
            self._table.put(Name.BACKUP_READY, 1)
            return False
        if self._backup is None:
            raise Refused(Error.RESULT)
        self._backup.restore_eeprom(self._table)
        self.keep()
        return True
