"""Profiles: how a servo's desired position gets to its goal (e-manual "What is the Profile")."""

from __future__ import annotations

import math
from enum import IntEnum


class Shape(IntEnum):
    """Bits 4 and 5 of Moving Status(123)."""

    STEP = 0
    RECTANGULAR = 1
    TRIANGULAR = 2
    TRAPEZOIDAL = 3


class Profile:
    """A desired position and velocity that approach a goal within a speed and an acceleration.

    Each step it takes the largest speed from which it can still stop at the goal, so that a goal that changes on the
    way is followed from the velocity it then has.

    Attributes:
        goal: Where it ends [rad].
        position: Desired position now [rad].
        velocity: Desired velocity now [rad/s].
        shape: What the last `aim` amounted to from a standstill.
    """

    def __init__(self) -> None:
        self.rest(0.0)

    def rest(self, position: float) -> None:
        """Stand still at a position [rad], which becomes the goal."""
        self.goal = self.position = position
        self.velocity = 0.0
        self.shape = Shape.STEP
        self._speed = self._acceleration = math.inf

    @property
    def ongoing(self) -> bool:
        """Whether the goal is not reached yet."""
        return self.position != self.goal

    def aim(self, goal: float, speed: float, acceleration: float) -> None:
        """Set out for a goal.

        Args:
            goal: Where to [rad].
            speed: Largest velocity [rad/s]; infinite: be there at once.
            acceleration: Largest acceleration [rad/s^2]; infinite: have that speed at once.
        """
        self.goal, self._speed, self._acceleration = goal, speed, acceleration
        if math.isinf(speed):
            self.shape = Shape.STEP
            self.position, self.velocity = goal, 0.0
        elif math.isinf(acceleration):
            self.shape = Shape.RECTANGULAR
        else:
            short = abs(goal - self.position) < speed * speed / acceleration
            self.shape = Shape.TRIANGULAR if short else Shape.TRAPEZOIDAL

    def aim_in(self, goal: float, duration: float, ramp: float) -> None:
        """Set out for a goal by a time, from a standstill (time-based profile: Drive Mode bit 2).

        Args:
            goal: Where to [rad].
            duration: Of the whole motion [s]; 0: be there at once.
            ramp: Of its acceleration [s]; at most half of the duration counts.
        """
        ramp = min(ramp, duration / 2)
        distance = abs(goal - self.position)
        if duration <= 0 or distance == 0:
            self.aim(goal, math.inf, math.inf)
            return
        speed = distance / (duration - ramp)
        self.aim(goal, speed, speed / ramp if ramp else math.inf)
        if ramp:
            self.shape = Shape.TRIANGULAR if ramp == duration / 2 else Shape.TRAPEZOIDAL

    def step(self, dt: float) -> None:
        """Go on for a time [s]."""
        rest = self.goal - self.position
        if rest == 0.0 and self.velocity == 0.0:
            return
        if math.isinf(self._acceleration):
            move = min(abs(rest), self._speed * dt)
            self.velocity = math.copysign(self._speed, rest) if abs(rest) > move else 0.0
            self.position = self.goal if abs(rest) <= move else self.position + math.copysign(move, rest)
            return
        a = self._acceleration
        stopping = a * (math.sqrt(dt * dt / 4 + 2 * abs(rest) / a) - dt / 2)
        wanted = math.copysign(min(self._speed, stopping), rest)
        self.velocity += max(-a * dt, min(a * dt, wanted - self.velocity))
        self.position += self.velocity * dt
        left = self.goal - self.position
        if abs(self.velocity) <= 1.001 * a * dt and (left * rest <= 0 or abs(left) <= 1e-3 * a * dt * dt):
            self.position, self.velocity = self.goal, 0.0
