"""Excitations: goals that make a servo show what it is made of, as functions of time.

What identifies what: a chirp gives speed constant and inertia, slow ramps Coulomb and load-dependent friction, steps at
several gains the gain divisor and the delay, a torque-off drop tells the motor's torque constant from its resistance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Signal = Callable[[float], float]
"""Share of a joint's swing, -1 to 1, at a time since the excitation began [s]."""

FADE = 0.6
"""Time in which an excitation goes from the neutral pose to its middle [s]."""

_LEVELS = (0.0, 0.7, -0.4, 0.2, -0.8, 0.5, -0.1, 0.9, -0.6, 0.35, -0.25, 0.6)  # of steps: every size, both ways


def still() -> Signal:
    """Return a signal that stays in the middle."""
    return lambda time: 0.0


def chirp(first: float, last: float, duration: float, fastest: float) -> Signal:
    """Return a sine whose frequency grows linearly, and whose amplitude falls where it would be too fast.

    Args:
        first: Frequency at the beginning [Hz].
        last: Frequency at the end [Hz].
        duration: [s].
        fastest: Largest speed, in shares of the swing per second [1/s].
    """

    def signal(time: float) -> float:
        rate = first + (last - first) * time / duration
        phase = 2 * math.pi * (first * time + (last - first) * time * time / (2 * duration))
        return min(1.0, fastest / (2 * math.pi * max(rate, 1e-9))) * math.sin(phase)

    return signal


def ramp(period: float, delay: float = 0.0) -> Signal:
    """Return a triangle between -1 and 1 that begins at 0.

    Args:
        period: Of the triangle [s].
        delay: How long it waits in the middle first [s].
    """

    def signal(time: float) -> float:
        share = max(time - delay, 0.0) / period + 0.25
        return 1.0 - 4.0 * abs(share - math.floor(share) - 0.5)

    return signal


def sine_of_square(rate: float) -> Signal:
    """Return sin(rate t^2), the excitation of Duclusaud et al. 2024 ("Extended friction models ...", section IV).

    Args:
        rate: [rad/s^2].
    """
    return lambda time: math.sin(rate * time * time)


def steps(hold: float, shift: int = 0) -> Signal:
    """Return a staircase of uneven steps.

    Args:
        hold: How long each level is held [s].
        shift: Which level comes first.
    """
    return lambda time: _LEVELS[(int(time / hold) + shift) % len(_LEVELS)]


@dataclass(frozen=True)
class Excitation:
    """What each joint is told.

    Attributes:
        signals: One for each joint.
        middle: Joint angles around which they swing, shape (n,) [rad].
        swing: How far, shape (n,) [rad].
        duration: [s].
        period: Control period [s].
    """

    signals: tuple[Signal, ...]
    middle: Array
    swing: Array
    duration: float
    period: float = 0.01

    def goal(self, time: float) -> Array:
        """Return the goals at a time since the excitation began, shape (n,) [rad]; at 0 the neutral pose."""
        share = min(max(time / FADE, 0.0), 1.0)
        fade = share * share * (3.0 - 2.0 * share)
        after = max(time - FADE, 0.0)
        wave = np.array([signal(after) for signal in self.signals])
        return fade * self.middle + (self.swing * wave if time >= FADE else 0.0)
