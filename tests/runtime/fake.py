"""A lamp in virtual time that does what it is told, or fails as it is told to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robolamp.assets import Assets
from robolamp.controller.pilot import PilotStep
from robolamp.lamp import load_lamp
from robolamp.robot.robot_lamp import servo_traits
from robolamp.signals import Clock, Command, Health, Interventions, Observation

LAMP = load_lamp(Assets())
N = len(LAMP.joints)
TRAITS = servo_traits(LAMP)


class FakeClock:
    def __init__(self) -> None:
        self.time = 50.0

    def now(self) -> float:
        return self.time

    def sleep_until(self, time: float) -> None:
        self.time = max(self.time, time)


class FakeLamp:
    """Perfect joints: the angle is the last goal.

    `spoil` may change every observation; `refuse` is raised by command.
    """

    def __init__(self, spoil: Callable[[Observation], None] | None = None, clock: Clock | None = None) -> None:
        self.joints = LAMP.names
        self.clock = clock or FakeClock()
        self.traits = TRAITS
        self.angle = np.array([0.3, -0.2, 0.1])
        self.on = False
        self.torques: list[bool] = []
        self.goals: list[np.ndarray] = []
        self.spoil = spoil
        self.refuse: Exception | None = None
        self.read_time = 0.002
        self.force = 1.99  # N

    def open(self) -> None:
        pass

    def close(self) -> None:
        self.torque(False)

    def torque(self, on: bool) -> None:
        self.on = on
        self.torques.append(on)

    def observe(self) -> Observation:
        self.clock.sleep_until(self.clock.now() + self.read_time)
        health = Health(np.full(N, 5.0), np.full(N, 30.0), np.zeros(N), np.full(N, int(self.on)), np.zeros(N, np.int64))
        observation = Observation(
            self.clock.now(), self.angle.copy(), np.zeros(N), np.zeros(N), np.zeros(N), self.force, 0.001, health
        )
        self.force = 4.0 - self.force  # a floor's force is never quite the same twice
        if self.spoil:
            self.spoil(observation)
        return observation

    def command(self, command: Command) -> None:
        if self.refuse:
            raise self.refuse
        assert self.on
        self.goals.append(command.goal.copy())
        self.angle = command.goal.copy()


class Wave:
    """A pilot that waves, and counts its steps."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.angles: list[np.ndarray] = []

    def step(self, observation: Observation, time: float) -> PilotStep:
        self.times.append(time)
        self.angles.append(observation.angle)
        outputs = np.array([0.1, -0.2, 0.3]) * np.sin(6 * time)
        return PilotStep(np.array([time]), outputs, outputs, len(self.times), False, Interventions(slewed=1))
