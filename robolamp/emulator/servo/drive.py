"""What passes between a servo and what it turns: measurements in, commands to the motor out."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sensed:
    """What a servo's own sensors measure, before it is rounded to register units.

    Attributes:
        angle: Of the output shaft, over one turn (0 to 2 pi) or continuous [rad].
        velocity: Of the output shaft [rad/s].
        current: Supply current, positive where the motor pushes towards larger angles [A].
        duty: Motor voltage by supply voltage, -1 to 1.
        voltage: Supply [V].
        temperature: Around it; what it heats itself comes on top [degC].
    """

    angle: float
    velocity: float
    current: float
    duty: float
    voltage: float
    temperature: float


@dataclass(frozen=True, slots=True)
class Drive:
    """What a servo does to its motor.

    Attributes:
        torque: Whether the motor is driven; else its winding is open.
        goal: Shaft angle it regulates to [rad].
        p_gain: Position P Gain register.
        duty_limit: Largest duty, 0 to 1.
        duty: Motor voltage by supply voltage, -1 to 1, where the servo's own loop sets it; None: the plant regulates to
            the goal with that gain.
    """

    torque: bool
    goal: float
    p_gain: int
    duty_limit: float
    duty: float | None = None
