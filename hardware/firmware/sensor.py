"""From the Pico's ADC to a force: three FSR 402 in dividers, or one load cell behind an amplifier. Edit for yours."""

import frames

FULL = 65535
"""ADC value of 3.3 V (machine.ADC.read_u16)."""

TOP = 64500
"""A channel above this is at the converter's end: saturated."""

OPEN = 60
"""An FSR below this carries no current at all, not even that of its preload: its wire is off."""

READINGS = 4
"""Readings of each channel that a sample is the mean of."""


class Fsr:
    """Three dividers 3V3 - FSR - pin - resistor - AGND, under one plate: the sum of their conductances is the force.

    Args:
        channels: Objects with read_u16().
        resistance: Of the fixed resistor [Ohm].
        newtons: Force by conductance of each [N/S]; 1e4 is where to begin, known weights tell.
    """

    def __init__(self, channels, resistance=3300.0, newtons=(1e4, 1e4, 1e4)):
        self._channels = channels
        self._scales = [1000.0 * each / resistance for each in newtons]

    def sample(self):
        """Return the force [mN] and the status bits."""
        total = 0.0
        status = 0
        for channel, scale in zip(self._channels, self._scales):  # noqa: B905 (MicroPython's zip has no strict)
            raw = mean(channel)
            if raw > TOP:
                status |= frames.SATURATED
                raw = TOP
            elif raw < OPEN:
                status |= frames.DISCONNECTED
            total += scale * raw / (FULL - raw)
        return round(total), status


class Cell:
    """A load cell whose amplifier gives a voltage in proportion to the force.

    Args:
        channel: An object with read_u16().
        zero: ADC value without force.
        newtons: Force of the whole range of the ADC [N].
    """

    def __init__(self, channel, zero=3000, newtons=66.0):
        self._channel = channel
        self._zero = zero
        self._scale = 1000.0 * newtons / FULL

    def sample(self):
        """Return the force [mN] and the status bits."""
        raw = mean(self._channel)
        status = frames.SATURATED if raw > TOP else frames.DISCONNECTED if raw < OPEN else 0
        return round((raw - self._zero) * self._scale), status


def mean(channel):
    """Return the mean of READINGS readings."""
    total = 0
    for _ in range(READINGS):
        total += channel.read_u16()
    return total // READINGS
