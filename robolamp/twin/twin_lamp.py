"""The twin as a lamp that the loop can drive: the same protocol as the robot, in virtual time."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.foot_window import FootWindow
from robolamp.signals import Command, Health, Observation, ServoTraits
from robolamp.twin.judges.lamp_judge import Judge, Outcome
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.sensor_model import measure_angle, measure_force

_NO_LOAD_TEMPERATURE = 30.0  # the twin does not model heat [degC]


class TwinClock:
    """Virtual time: waiting steps the physics.

    Args:
        lamp: The lamp whose time it is.
    """

    def __init__(self, lamp: TwinLamp) -> None:
        self._lamp = lamp

    def now(self) -> float:
        """Return the simulated time [s]."""
        return self._lamp.time

    def sleep_until(self, time: float) -> None:
        """Simulate until that time [s]."""
        self._lamp.advance_to(time)


class TwinLamp:
    """One simulated lamp; implements `robolamp.signals.LampBackend`.

    Args:
        twin: The compiled lamp.
        goal: Where it is sent, for the judge [m].
        duration: Length of the judged run [s].
        duty: Goal PWM(100) of the servos, 0 to 1: the most of the supply that a motor gets.
    """

    def __init__(self, twin: TwinModel, goal: float = 0.0, duration: float = 0.0, *, duty: float = 1.0) -> None:
        self.twin = twin
        self._duty = duty
        self.body = Body(twin)
        self.clock = TwinClock(self)
        self._steps = 0
        self._arrivals: deque[tuple[int, NDArray[np.float64]]] = deque()
        self._window = FootWindow(1, twin.lamp.contact_on, twin.lamp.contact_off)
        self._torque = False
        self._one = np.zeros(1, np.int64)
        sensor = twin.pole_sensor
        self._pole = None if sensor is None else self.body.data.sensordata[sensor : sensor + 1]  # a view
        self._judging = (np.array([goal]), duration)
        self.start_judging()

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, from the foot up."""
        return self.twin.lamp.names

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * self.twin.timestep

    @property
    def traits(self) -> ServoTraits:
        """What its servos are like: they work at any voltage, and no line takes time."""
        return ServoTraits(np.zeros(len(self.joints)))

    def open(self) -> None:
        """Stand in the neutral pose, torque off."""
        self.body.reset()
        self.torque(False)

    def torque(self, on: bool) -> None:
        """Turn the servos' torque on (goal := present) or off."""
        if on and not self._torque:
            self._arrivals.clear()
            self.body.set_goal(self.body.angle)
        self._torque = on
        joints = self.twin.lamp.joints
        gains = np.array([joint.position_p_gain for joint in joints], float)
        self.body.set_motors(gains, np.full(len(joints), self.twin.voltage), np.full(len(joints), on), self._duty)

    def advance_to(self, time: float) -> None:
        """Simulate until a time [s]; goals arrive after the line's delay."""
        target = round(time / self.twin.timestep)
        while self._steps < target:
            while self._arrivals and self._arrivals[0][0] <= self._steps:
                self.body.set_goal(self._arrivals.popleft()[1])
            self.body.step()
            self._steps += 1
            self._window.add(measure_force(np.array([self.body.force]), self.twin.foot_gain))
            data, site = self.body.data, self.twin.head_site
            self._judge.step(
                self._one, data.qpos[None], np.array([self.body.force]),
                data.site_xpos[site, 2:3], data.site_xmat[site, 8:9], self._pole,
            )  # fmt: skip

    def observe(self) -> Observation:
        """Read every sensor; nothing is ever missing."""
        n = len(self.joints)
        mean, contact = self._window.take()
        health = Health(
            np.full(n, self.body.voltage), np.full(n, _NO_LOAD_TEMPERATURE), np.full(n, np.nan),
            np.full(n, int(self._torque)), np.zeros(n, np.int64),
        )  # fmt: skip
        return Observation(
            time=self.time,
            angle=measure_angle(self.body.angle),
            velocity=self.body.velocity,
            current=self.body.current,
            angle_age=np.zeros(n),
            foot_force=float(measure_force(np.array(self.body.force), self.twin.foot_gain)),
            foot_age=0.0,
            health=health,
            foot_mean=float(mean[0]),
            foot_contact=float(contact[0]),
        )

    def command(self, command: Command) -> None:
        """Send goals; they arrive after the line's delay.

        Raises:
            SafetyError: A goal is not finite or outside the joint's limits.
        """
        self.twin.lamp.check_goal(command.goal)
        arrival = self._steps + round(self.twin.line_delay / self.twin.timestep)
        self._arrivals.append((arrival, command.goal.copy()))

    def close(self) -> None:
        """Turn torque off."""
        self.torque(False)

    def start_judging(self) -> None:
        """Forget what the judge has seen so far: the run begins now."""
        goal, duration = self._judging
        self._judge = Judge(self.twin, goal, duration)
        self._judge.begin(self.body.data.qpos[None, 0])

    @property
    def outcome(self) -> Outcome:
        """What the lamp truly did since the last `start_judging`; arrays of one lane."""
        return self._judge.outcome(self.body.angle[None], np.zeros(1, bool), np.zeros(1, np.int64))
