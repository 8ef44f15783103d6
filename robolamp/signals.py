"""Observation and Command, arrays over named joints, and the protocol that every lamp backend keeps.

Two backends exist: the twin (`robolamp.twin.twin_lamp`, virtual time) and the robot (`robolamp.robot.robot_lamp`,
serial ports, physical or emulated). The loop, the log and the controllers know this module only. Angles are joint
angles in radians, 0 in the neutral pose; shapes are (n,) over the lamp's joints, from the foot up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Health:
    """What the servos say of themselves; a value that did not arrive is NaN (arrays) or -1 (flags).

    Attributes:
        voltage: Supply voltage at each servo, shape (n,) [V].
        temperature: Shape (n,) [degC].
        pwm: Duty, shape (n,), -1 to 1.
        torque: Torque Enable, shape (n,): 1 on, 0 off, -1 unknown.
        hardware_error: Hardware Error Status bits, shape (n,); -1 unknown.
        error: ERR byte of each answer, shape (n,), bit 7 the hardware alert; -1 none came; empty: of no servo.
        goal: Whether each servo has the goal that was sent last, shape (n,): 1 it has, 0 not, -1 unknown; empty: of
            no servo.
    """

    voltage: Array
    temperature: Array
    pwm: Array
    torque: NDArray[np.int64]
    hardware_error: NDArray[np.int64]
    error: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    goal: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    @classmethod
    def unknown(cls, n: int) -> Health:
        """Return the health of n servos of which nothing is known."""
        gap = np.full(n, np.nan)
        return cls(gap.copy(), gap.copy(), gap.copy(), np.full(n, -1), np.full(n, -1))


ASKED_AGAIN = "answered only when asked again"
"""The fault of a servo whose reading is there, though its first answer was not."""


@dataclass
class Observation:
    """What the lamp measured at one tick. A value that is missing is NaN; its age keeps growing.

    Attributes:
        time: The backend's clock when the reading was complete [s].
        angle: Joint angles, shape (n,) [rad].
        velocity: Joint velocities as the servos report them, shape (n,) [rad/s].
        current: Servo currents, shape (n,) [A].
        angle_age: Time since each angle was measured, shape (n,) [s].
        foot_force: Floor force on the foot [N].
        foot_age: Time since the foot force was measured [s]; infinite before the first.
        health: The servos' state.
        faults: What went wrong in this reading, one short text each, as "knee: no answer".
        foot_mean: Mean of the floor forces that the foot sensor sampled since the last reading [N].
        foot_contact: Share of these samples with the foot on the ground, 0 to 1.
    """

    time: float
    angle: Array
    velocity: Array
    current: Array
    angle_age: Array
    foot_force: float
    foot_age: float
    health: Health
    faults: tuple[str, ...] = ()
    foot_mean: float = math.nan
    foot_contact: float = math.nan


@dataclass
class Command:
    """What the lamp is asked to do.

    Attributes:
        goal: Joint angles to move to, shape (n,) [rad], inside the limits (the envelope has seen them).
    """

    goal: Array


@dataclass
class Interventions:
    """How often the envelope had to change what a controller asked for, counted over joints and ticks.

    Attributes:
        not_finite: NaN or infinite outputs replaced by the last goal.
        limited: Outputs clipped to the joint's limits.
        slewed: Goals held back by the slew limit.
    """

    not_finite: int = 0
    limited: int = 0
    slewed: int = 0

    @property
    def total(self) -> int:
        """All of them together."""
        return self.not_finite + self.limited + self.slewed


@dataclass(frozen=True)
class Way:
    """How far the lamp has come by its odometer.

    Attributes:
        length: [m].
        stderr: Its standard error [m].
        unlike: How many steps were unlike those that the odometer was learnt from.
    """

    length: float
    stderr: float
    unlike: int


class Clock(Protocol):
    """A time source that can be waited on: the computer's, or a simulation's."""

    def now(self) -> float:
        """Return the time [s]; never goes backwards."""
        ...

    def sleep_until(self, time: float) -> None:
        """Return at that time or, where it has passed, at once.

        Args:
            time: On this clock [s].
        """
        ...


@dataclass(frozen=True)
class ServoTraits:
    """What a run must know of a lamp's servos, whoever made them.

    Attributes:
        lowest_voltage: Supply below which each is not meant to work, shape (n,) [V].
        tick_time: How long a reading and goals for all are on their line [s]; 0: there is none.
        error_words: Says in words what the bits of `Health.hardware_error` mean.
    """

    lowest_voltage: Array
    tick_time: float = 0.0
    error_words: Callable[[int], str] = hex


class LampBackend(Protocol):
    """A lamp that a controller can drive, real or simulated.

    The order of calls: `open`, `torque(True)`, then `observe` and `command` in turn, `torque(False)`, `close`.
    """

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, from the foot up."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock that observations are stamped with."""
        ...

    @property
    def traits(self) -> ServoTraits:
        """What its servos are like."""
        ...

    def open(self) -> None:
        """Connect and check that everything is there; nothing moves.

        Raises:
            BusError: A port does not exist or does not answer, or a servo is missing.
            SafetyError: The lamp is in no state to be moved.
        """
        ...

    def torque(self, on: bool) -> None:
        """Turn the servos' torque on (with goal := present first) or off, each servo on its own.

        Raises:
            BusError: A servo could not be turned on. Turning off never raises.
        """
        ...

    def observe(self) -> Observation:
        """Read every sensor once. Never raises for a missing value: it is a gap and a fault in the result."""
        ...

    def command(self, command: Command) -> None:
        """Send goals.

        Raises:
            SafetyError: A goal is not finite or outside the joint's limits; nothing was sent.
        """
        ...

    def close(self) -> None:
        """Turn torque off and let go of everything. May be called twice."""
        ...


class LampProxy:
    """A lamp backend that passes everything on to another; its heirs step in where they have something to do.

    Args:
        backend: The lamp.
    """

    def __init__(self, backend: LampBackend) -> None:
        self._backend = backend

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, from the foot up."""
        return self._backend.joints

    @property
    def clock(self) -> Clock:
        """The clock that observations are stamped with."""
        return self._backend.clock

    @property
    def traits(self) -> ServoTraits:
        """What its servos are like."""
        return self._backend.traits

    def open(self) -> None:
        """Open the lamp.

        Raises:
            BusError: A port does not exist or does not answer, or a servo is missing.
            SafetyError: The lamp is in no state to be moved.
        """
        self._backend.open()

    def torque(self, on: bool) -> None:
        """Turn torque on or off.

        Raises:
            BusError: A servo could not be turned on.
        """
        self._backend.torque(on)

    def observe(self) -> Observation:
        """Read every sensor once."""
        return self._backend.observe()

    def command(self, command: Command) -> None:
        """Send goals.

        Raises:
            SafetyError: A goal is not finite or outside the joint's limits.
        """
        self._backend.command(command)

    def close(self) -> None:
        """Turn torque off and let go of everything."""
        self._backend.close()


@dataclass
class Tick:
    """All that happened in one tick of the loop: what the log keeps.

    Attributes:
        index: Tick number, from 0.
        phase: "start", "run", "landing", or "limp" (torque is off, and the goal was not sent).
        scheduled: When the tick was due [s], on the backend's clock.
        began: When it began [s].
        read_done: When the sensors had been read [s].
        write_done: When the goals had been sent [s].
        observation: What was measured.
        inputs: The controller's terminals, shape (k,), in the order of the log's `terminals`; empty outside "run".
        outputs: The controller's raw outputs, shape (n,) [rad]; empty outside "run".
        goal: What was sent, shape (n,) [rad].
        interventions: Running totals of the envelope.
        hops: Hops counted from the foot sensor.
        contact: Whether the foot is on the ground by the foot sensor.
        way: How far the lamp has come; None where no odometer tells.
    """

    index: int
    phase: str
    scheduled: float
    began: float
    read_done: float
    write_done: float
    observation: Observation
    goal: Array
    inputs: Array = field(default_factory=lambda: np.empty(0))
    outputs: Array = field(default_factory=lambda: np.empty(0))
    interventions: Interventions = field(default_factory=Interventions)
    hops: int = 0
    contact: bool = True
    way: Way | None = None
