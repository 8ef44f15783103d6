"""A servo's EEPROM in a file: what a client wrote is still there when the emulator starts again.

model = "XL330-M288-T"

[eeprom]
"ID" = 3
"Return Delay Time" = 0
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from robolamp.dynamixel.registers import Model, Name
from robolamp.errors import FileError
from robolamp.files import Table, read_toml, write_atomic


def load_eeprom(path: Path, model: Model) -> dict[Name, int]:
    """Return the registers that a file holds; none where there is no file yet.

    Args:
        path: The file.
        model: What servo it is for.

    Raises:
        FileError: The file cannot be read, is another model's, or holds an unknown register or a value out of range.
    """
    if not path.exists():
        return {}
    root = Table(read_toml(path), str(path))
    root.text("model", [model.name])
    own = root.table("eeprom", default={})
    values: dict[Name, int] = {}
    for register in model.registers.values():
        if register.eeprom and register.writable and register.name in own:
            full = 1 << 8 * register.size
            low = register.low if register.low is not None else 0
            high = register.high if register.high is not None else full - 1
            value = own.integer(register.name, low, high)
            if register.choices and value not in register.choices:
                raise own.fail(register.name, f"{value} is not one of {', '.join(map(str, register.choices))}")
            values[register.name] = value
    root.done()
    own.done()
    return values


def open_folder(path: Path) -> Path:
    """Return a folder to keep EEPROM in; makes it if it is missing.

    Args:
        path: The folder.

    Raises:
        FileError: It is no folder, cannot be made, or cannot be written.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise FileError(f"cannot keep EEPROM here: {error.strerror or error}", str(path)) from None
    return path


def save_eeprom(path: Path, model: Model, values: Mapping[Name, int]) -> None:
    """Write a servo's EEPROM, whole or not at all.

    Args:
        path: The file.
        model: The servo.
        values: Its registers.

    Raises:
        FileError: The file cannot be written.
    """
    rows = "".join(f'"{name}" = {value}\n' for name, value in values.items())
    write_atomic(path, f'model = "{model.name}"\n\n[eeprom]\n{rows}')
