"""The health block: all that a tick wants of a servo, mapped side by side by its indirect registers.

Present PWM ... Hardware Error Status lie apart in the control table; Indirect Address registers lay copies of their
bytes side by side in Indirect Data, so that one instruction reads them all (e-manual, "Indirect Address").
"""

from __future__ import annotations

from collections.abc import Mapping

from robolamp.dynamixel.bus import Bus
from robolamp.dynamixel.registers import Model, Name

FIELDS = (
    (Name.PRESENT_PWM, 2),
    (Name.PRESENT_CURRENT, 2),
    (Name.PRESENT_VELOCITY, 2),
    (Name.PRESENT_POSITION, 2),
    (Name.PRESENT_INPUT_VOLTAGE, 1),
    (Name.PRESENT_TEMPERATURE, 1),
    (Name.TORQUE_ENABLE, 1),
    (Name.HARDWARE_ERROR_STATUS, 1),
    (Name.GOAL_POSITION, 2),
    (Name.REALTIME_TICK, 2),
)
"""What is in the block, in its order, and how many of each register's low bytes: the XL330 maps 20 in all. One byte
holds 25.5 V, two hold any velocity, any goal inside a turn, and a position but for 16 whole turns. Where a model has no
Present Current(126), Present Load is mapped."""

LENGTHS = (14, 15, 16)
"""Bytes that readings take in turn: an answer that comes after its reading was given up has the wrong length for the
next one. All of them hold everything up to Goal Position."""

_MOVED_IN = 52  # firmware from which on the XL330's Indirect Data is at 208 (dynamixel_easy_sdk, xl330_m288_fw52.model)
_OLD_DATA = 224
_X330 = (1190, 1200)


def places_in_block() -> Mapping[Name, tuple[int, int]]:
    """Return where in the block each register of FIELDS begins, and how many bytes of it are there."""
    found: dict[Name, tuple[int, int]] = {}
    at = 0
    for name, size in FIELDS:
        found[name] = (at, size)
        at += size
    return found


def data_address(model: Model, firmware: int) -> int:
    """Return the address of the first Indirect Data byte.

    Args:
        model: The servo's model.
        firmware: Its Firmware Version(6).
    """
    return _OLD_DATA if model.number in _X330 and firmware < _MOVED_IN else model.indirect[0].data


def map_block(bus: Bus, servo: int, model: Model) -> None:
    """Write a servo's Indirect Address registers (RAM: a reboot forgets them) and check that they are as written.

    Raises:
        BusError: It does not answer or refuses.
    """
    rows = [(model[_present(model, name)], size) for name, size in FIELDS]
    sources = [row.address + byte for row, size in rows for byte in range(size)]
    table = b"".join(source.to_bytes(2, "little") for source in sources)
    if bus.read_bytes(servo, model.indirect[0].address, len(table)) != table:
        bus.write_bytes(servo, model.indirect[0].address, table)


def _present(model: Model, name: Name) -> Name:
    return Name.PRESENT_LOAD if name is Name.PRESENT_CURRENT and name not in model.registers else name
