"""What a servo protects itself from: heat, overload, a supply outside its limits (e-manual "Shutdown(63)").

The e-manual names the conditions and gives no times: those here are estimates. The temperature is a first-order model:
C dT/dt = R i^2 - (T - air) / R_th.
"""

from __future__ import annotations

import math

from robolamp.dynamixel.registers import VOLTAGE_UNIT, HardwareError, Name
from robolamp.emulator.drive import Sensed
from robolamp.emulator.motor import Datasheet
from robolamp.emulator.table import ControlTable

OVERLOAD_CURRENT = 0.8
"""Winding current by that of a stall at the present supply voltage, above which a servo counts as overloaded."""

OVERLOAD_TIME = 2.0
"""How long it must last to be an overload [s]."""

VOLTAGE_TIME = 0.05
"""How long the supply must be outside its limits to be a voltage error [s]."""

_LEAST_DUTY = 0.02  # below it, the winding's current cannot be told from the supply's


class Guard:
    """Heat and hardware errors of one servo.

    Args:
        sheet: Its data.

    Attributes:
        rise: Of its temperature above the air's [K]; a reboot does not cool it.
    """

    def __init__(self, sheet: Datasheet) -> None:
        self._sheet = sheet
        self.rise = 0.0
        self.restart()

    def restart(self) -> None:
        """Forget how long anything lasted."""
        self._overloaded = self._off_voltage = 0.0

    def step(self, seen: Sensed, table: ControlTable, dt: float) -> HardwareError:
        """Let time pass and return the errors whose conditions hold now.

        Args:
            seen: What its sensors measure.
            table: Its limits.
            dt: How long [s].
        """
        sheet, errors = self._sheet, HardwareError(0)
        current = abs(seen.current / seen.duty) if abs(seen.duty) > _LEAST_DUTY else 0.0
        settled = sheet.resistance * current**2 * sheet.thermal_resistance
        self.rise += (settled - self.rise) * -math.expm1(-dt / sheet.thermal_time)
        if seen.temperature + self.rise > table.get(Name.TEMPERATURE_LIMIT):
            errors |= HardwareError.OVERHEATING
        stalled = current > OVERLOAD_CURRENT * seen.voltage / sheet.resistance
        self._overloaded = self._overloaded + dt if stalled else 0.0
        if self._overloaded > OVERLOAD_TIME:
            errors |= HardwareError.OVERLOAD
        low, high = (table.get(name) * VOLTAGE_UNIT for name in (Name.MIN_VOLTAGE_LIMIT, Name.MAX_VOLTAGE_LIMIT))
        inside = low - VOLTAGE_UNIT / 2 <= seen.voltage <= high + VOLTAGE_UNIT / 2
        self._off_voltage = 0.0 if inside else self._off_voltage + dt
        if self._off_voltage > VOLTAGE_TIME:
            errors |= HardwareError.VOLTAGE
        return errors
