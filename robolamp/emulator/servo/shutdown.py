"""How a servo protects itself against heat, overload and a supply outside its limits (e-manual "Shutdown(63)").

The e-manual names the conditions and gives no times: those here are estimates. The temperature is a first-order model:
C dT/dt = R i^2 - (T - air) / R_th.
"""

from __future__ import annotations

import math

from robolamp.dynamixel.registers import VOLTAGE_UNIT, HardwareError, Name
from robolamp.emulator.servo.bare_motor import Datasheet
from robolamp.emulator.servo.control_table import ControlTable
from robolamp.emulator.servo.drive import Sensed

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
        table: Its limits; and where Hardware Error Status(70) goes.

    Attributes:
        rise: Of its temperature above the air's [K]; a reboot does not cool it.
    """

    def __init__(self, sheet: Datasheet, table: ControlTable) -> None:
        self._sheet, self._table = sheet, table
        self.rise = 0.0
        self.restart()

    @property
    def shut_down(self) -> bool:
        """Whether an error that Shutdown(63) names has come since the servo started."""
        return bool(self._latched & self._table.get(Name.SHUTDOWN))

    def restart(self) -> None:
        """Forget errors, and how long anything lasted."""
        self._overloaded = self._off_voltage = 0.0
        self._latched = HardwareError(0)

    def fail(self, errors: HardwareError) -> None:
        """Meet with errors, which stay until it starts again."""
        self._latched |= errors
        self._table.put(Name.HARDWARE_ERROR_STATUS, self._table.get(Name.HARDWARE_ERROR_STATUS) | errors)

    def step(self, seen: Sensed, dt: float) -> None:
        """Let time pass; errors that Shutdown(63) names stay, others go with their condition.

        Args:
            seen: What its sensors measure.
            dt: How long [s].
        """
        errors = self._conditions(seen, dt)
        self._latched |= errors & HardwareError(self._table.get(Name.SHUTDOWN))
        self._table.put(Name.HARDWARE_ERROR_STATUS, self._latched | errors)

    def _conditions(self, seen: Sensed, dt: float) -> HardwareError:
        """Return the errors whose conditions hold now."""
        sheet, table, errors = self._sheet, self._table, HardwareError(0)
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
