"""What a servo answers: a status packet's ERR byte and data."""

from __future__ import annotations

from dataclasses import dataclass

ALERT = 0x80
"""Bit 7 of ERR: the servo has a hardware error (on every answer while it lasts)."""

_REFUSALS = {
    1: "it failed to process the instruction",
    2: "it does not know the instruction",
    3: "it received a wrong CRC",
    4: "the value is out of the register's range",
    5: "the data has the wrong length",
    6: "the value is outside the servo's own limits",
    7: "access is denied (EEPROM while torque is on, or a read-only register)",
}
"""ERR codes of a status packet (e-manual, protocol 2.0, "Error")."""


@dataclass(frozen=True)
class Status:
    """A status packet.

    Attributes:
        error: Its ERR byte.
        data: Its parameters.
    """

    error: int
    data: bytes

    @property
    def alert(self) -> bool:
        """Whether the servo reports a hardware error (bit 7): the data is good all the same."""
        return bool(self.error & ALERT)

    @property
    def refusal(self) -> str:
        """Why the instruction was refused, in words; empty if it was not."""
        code = self.error & ~ALERT
        return _REFUSALS.get(code, f"error {code}") if code else ""
