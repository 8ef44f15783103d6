"""A bare servo's motor and gear, from the datasheet: what turns when there is no lamp.

    voltage = R i + K w        torque = K i        (J + load) dw/dt = K i - b w - friction

Stall torque and current and no-load speed are those of the e-manual's "Specifications"; K, R and b follow from them.
The XL330-M077-T's three do not fit one DC motor: its K is bounded by the no-load speed, and its stall torque comes out
19 % low.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from robolamp.dynamixel.registers import Model
from robolamp.emulator.servo.drive import Sensed

_LARGEST_STEP = 0.0005  # the winding's braking time constant is 2 ms and more [s]
_RPM = 2 * math.pi / 60
_COULOMB = 0.02  # dry friction by stall torque; estimate, as published for the XL330 (Rhoban/bam: 0.005 to 0.013 Nm)
_MOST_EMF = 0.97  # back-EMF by supply voltage at no load, at most: the rest drives friction


@dataclass(frozen=True, slots=True)
class Datasheet:
    """A servo's datasheet values at one voltage, and estimates of the others.

    Attributes:
        voltage: [V].
        stall_torque: [Nm].
        stall_current: [A].
        no_load_speed: [rad/s].
        armature: Rotor inertia at the output [kg m^2].
        thermal_resistance: Winding to air [K/W]. Estimate, from the weight.
        thermal_time: Time constant of its heating [s]. Estimate, from the weight.
        p_divisor: Position P Gain register by PWM counts per position count.
    """

    voltage: float
    stall_torque: float
    stall_current: float
    no_load_speed: float
    armature: float
    thermal_resistance: float
    thermal_time: float
    p_divisor: float

    @property
    def coulomb(self) -> float:
        """Dry friction [Nm]."""
        return _COULOMB * self.stall_torque

    @property
    def resistance(self) -> float:
        """R [Ohm]."""
        return self.voltage / self.stall_current

    @property
    def torque_constant(self) -> float:
        """K, at the output [Nm/A]."""
        by_torque = (self.stall_torque + self.coulomb) / self.stall_current
        return min(by_torque, _MOST_EMF * self.voltage / self.no_load_speed)

    @property
    def viscous(self) -> float:
        """Viscous friction b that gives the no-load speed [Nm s/rad]."""
        k, w = self.torque_constant, self.no_load_speed
        return max((k * (self.voltage - k * w) / self.resistance - self.coulomb) / w, 0.0)


DATASHEETS: Mapping[str, Datasheet] = MappingProxyType(
    {
        # e-manual xl330-m288, 5 V; armature and divisor: published identification (Rhoban/bam)
        "XL330-M288-T": Datasheet(5.0, 0.52, 1.47, 103 * _RPM, 0.0018, 25.0, 250.0, 256.0),
        # e-manual xl330-m077, 5 V; armature: the same rotor behind 77.5 : 1 instead of 288.4 : 1
        "XL330-M077-T": Datasheet(5.0, 0.215, 1.47, 383 * _RPM, 0.0018 * (77.5 / 288.4) ** 2, 25.0, 250.0, 256.0),
        # e-manual xl430-w250, 11.1 V; armature: estimate
        "XL430-W250-T": Datasheet(11.1, 1.4, 1.3, 57 * _RPM, 0.005, 12.0, 500.0, 128.0),
    }
)
"""Data of each model of `robolamp.dynamixel.registers.MODELS`."""


class Motor:
    """A servo's motor, gear and whatever inertia it turns.

    Args:
        model: The servo.
        angle: Where its shaft starts [rad].
        load: Inertia on the shaft [kg m^2].
        external: Torque on the shaft from outside [Nm]; may be changed at any time.

    Attributes:
        angle: Of the shaft, not wrapped [rad].
        velocity: Of the shaft [rad/s].
        external: As given.
        locked: Whether something holds the shaft still; may be changed at any time.
    """

    def __init__(self, model: Model, *, angle: float = math.pi, load: float = 0.0, external: float = 0.0) -> None:
        self._sheet = DATASHEETS[model.name]
        self._inertia = self._sheet.armature + load
        self.angle, self.velocity = angle, 0.0
        self.external, self.locked = external, False
        self._voltage: float | None = None

    @property
    def current(self) -> float:
        """Of the winding [A]; 0 while it is open."""
        if self._voltage is None:
            return 0.0
        return (self._voltage - self._sheet.torque_constant * self.velocity) / self._sheet.resistance

    @property
    def torque(self) -> float:
        """Of the motor, before friction [Nm]."""
        return self._sheet.torque_constant * self.current

    def step(self, dt: float, voltage: float | None) -> None:
        """Let time pass.

        Args:
            dt: How long [s].
            voltage: On the winding [V]; None: it is open.
        """
        self._voltage = voltage
        steps = max(1, math.ceil(dt / _LARGEST_STEP))
        for _ in range(steps):
            self._step(dt / steps)

    def sensed(self, supply: float, air: float) -> Sensed:
        """Return what a servo's sensors see of it.

        Args:
            supply: Supply voltage [V].
            air: Temperature around it [degC].
        """
        duty = 0.0 if self._voltage is None else max(-1.0, min(1.0, self._voltage / supply))
        return Sensed(self.angle, self.velocity, abs(duty) * self.current, duty, supply, air)

    def _step(self, dt: float) -> None:
        if self.locked:
            self.velocity = 0.0
            return
        push = self.torque + self.external - self._sheet.viscous * self.velocity
        # Dry friction stops the shaft, but never turns it.
        free = self.velocity + push * dt / self._inertia
        brake = self._sheet.coulomb * dt / self._inertia
        self.velocity = 0.0 if abs(free) <= brake else free - math.copysign(brake, free)
        self.angle += self.velocity * dt
