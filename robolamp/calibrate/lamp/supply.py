"""What a session's readings of voltage and current tell of the supply that all servos share."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robolamp.calibrate.lamp.session import LampRecording
from robolamp.calibrate.least_squares import correlation_length
from robolamp.calibration import LAMP, Calibration
from robolamp.dynamixel.registers import VOLTAGE_UNIT

Array = NDArray[np.float64]

_TOLD = 3.0  # standard errors from 0 that a resistance must have to count as told
_TICKS = 5  # readings that are averaged: a supply follows its load within some milliseconds


def measure_supply(recordings: Sequence[LampRecording], base: Calibration) -> dict[str, tuple[float, float]]:
    """Return the supply's voltage and, where the readings tell it, its resistance, each with its standard error.

    The servos read the voltage that they get, and the currents that they draw. A line through the one against the sum
    of the others has the voltage without load where it begins, and the resistance as its slope (least squares; errors
    count residuals that are alike over time as few). Where the slope is not told, or is less than what the rounding of
    the readings hides, or servos read no current, the supply is as stiff as the base has it, and its voltage the median
    that goes with that.

    Args:
        recordings: Of one lamp.
        base: What is known before.
    """
    drawn, volts = (np.concatenate(each) for each in zip(*map(_readings, recordings), strict=True))
    if not volts.size:
        return {"supply_voltage": (base.lamp("supply_voltage"), math.nan)}
    quantum = VOLTAGE_UNIT / math.sqrt(12.0)
    still = volts + base.lamp("supply_resistance") * drawn
    middle = float(np.median(still)), max(median_error(still), quantum)
    centred = drawn - drawn.mean()
    power = float(centred @ centred)
    if power == 0.0:
        return {"supply_voltage": middle}
    slope = float(centred @ volts) / power
    residual = volts - volts.mean() - slope * centred
    variance = float(np.mean(residual**2)) * correlation_length(residual)
    error = math.sqrt(variance / power)
    legal = LAMP["supply_resistance"]
    hidden = -slope * float(np.ptp(drawn)) < quantum  # of readings that are all alike the sums' rounding is left
    if hidden or not _TOLD * error < -slope < legal.high:
        return {"supply_voltage": middle}
    full = float(volts.mean() - slope * drawn.mean())
    return {"supply_voltage": (full, quantum), "supply_resistance": (-slope, error)}


def _readings(recording: LampRecording) -> tuple[Array, Array]:
    """Return running means of the sum of the currents [A] and of the voltage [V], where all servos answered.

    A servo that reads no current all along (an XL430 reads a load instead) counts as drawing none.
    """
    run, rows = recording.run, recording.rows
    current, volts = run.current[rows], run.voltage[rows].mean(axis=1)
    drawn = np.abs(np.where(np.isnan(current).all(axis=0), 0.0, current)).sum(axis=1)
    known = np.isfinite(drawn) & np.isfinite(volts)
    if known.sum() < _TICKS:
        return np.empty(0), np.empty(0)
    kernel = np.full(_TICKS, 1.0 / _TICKS)
    return np.convolve(drawn[known], kernel, "valid"), np.convolve(volts[known], kernel, "valid")


def median_error(values: Array) -> float:
    """Return the standard error of the median of many values, taken as normally spread."""
    return 1.2533 * float(np.std(values)) / math.sqrt(len(values))
