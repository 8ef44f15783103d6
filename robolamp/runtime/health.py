"""Guards over time: what in the observations is a fault, and when the run must end for it."""

from __future__ import annotations

import math
from collections import Counter
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from robolamp.lamp import Lamp
from robolamp.runtime.clock import MAX_PERIOD
from robolamp.signals import Observation, ServoTraits

ANGLE_AGE = 0.1
"""Age of an angle at which the run ends [s]: five ticks at 50 Hz; until then the last goal is held."""

FOOT_AGE = 0.05
"""Age of the foot force that is a fault [s] (hardware/firmware/README.md)."""

FOOT_AGE_STOP = 0.1
"""Age of the foot force at which the run ends [s]: the controller is blind to the floor."""

FOOT_STUCK, FOOT_STUCK_AIR = 0.1, 0.5
"""How long the foot force may stay the same to the millinewton while a joint moves by FOOT_STUCK_MOVE [s]: on the
floor, and in the air, where a sensor may show its zero. Estimates: a hop's flight is 0.2 s."""

FOOT_STUCK_MOVE = 0.05
"""Movement of a joint in which the floor's force must change [rad]: it moves the lamp's weight by centimetres."""

FOOT_FRESH = 0.001
"""Time after a force's sample at which another is a new one [s]: half of what is between two frames."""

FOOT_STUCK_SPEED = 0.3
"""Speed below which movement does not count [rad/s]: the floor then feels the lamp's weight and nothing else."""

TEMPERATURE = 65.0
"""Temperature at which the run ends [degC]: below the servos' own limits of 70 and 72 (Temperature Limit(31))."""

WARM = 60.0
"""Temperature that is a fault, and only a fault [degC]: 5 below the end of the run."""

OVER_TIME = 2.0
"""Time constant of the running means of duty and current [s]. Estimate: a stall heats a winding within seconds."""

DUTY = 0.9
"""Running mean of a servo's duty at which the run ends: a hop saturates it for tens of milliseconds."""

CURRENT = 0.8
"""Running rms of a servo's current at which the run ends [A]: half its stall current at 5 V (e-manual: 1.47 A)."""

VOLTAGE_TIME = 0.2
"""How long a voltage below the servo's limit is only a fault [s]; a hop's sag is shorter."""

GOALS_LOST = 5
"""Readings in a row that show a servo without the goal sent to it at which the run ends: 0.1 s at 50 Hz, as for an
angle that is missing. A line that loses one packet in ten loses five goals in a row once in 100,000 ticks."""


class Action(IntEnum):
    """What the guards say, the more urgent the larger."""

    GO = 0
    LAND = 1
    CUT = 2


class RunningMean:
    """A first-order running mean of n values; a value that is missing leaves its mean as it is.

    A value counts for the time since the one before it, and for MAX_PERIOD at most: of more, nothing is known.

    Args:
        n: How many values.
        time_constant: [s].
    """

    def __init__(self, n: int, time_constant: float) -> None:
        self._mean = np.zeros(n)
        self._time = np.full(n, math.nan)  # when each was last there [s]
        self._constant = time_constant

    def add(self, values: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        """Take values and return the means, which start at 0.

        Args:
            values: Shape (n,); NaN where missing.
            time: When they were measured [s].
        """
        there = np.isfinite(values)
        passed = np.where(np.isfinite(self._time), np.clip(time - self._time, 0.0, MAX_PERIOD), 0.0)
        share = -np.expm1(-passed / self._constant)
        self._mean += np.where(there, share * (values - self._mean), 0.0)
        self._time = np.where(there, time, self._time)
        return self._mean


class Guard:
    """Judges one observation after the other.

    Args:
        lamp: Gives joint names.
        traits: What its servos are like.
        powered: Whether torque is on, as it must be from then on; False for a run that only watches.
        clamped: Whether the base is clamped: what its foot sensor shows is no ground for anything then.

    Attributes:
        faults: How many observations showed each fault, by its text.
        reason: The fault behind the last verdict, the most urgent; empty where that was GO.
    """

    def __init__(self, lamp: Lamp, traits: ServoTraits, *, powered: bool = True, clamped: bool = False) -> None:
        self.faults: Counter[str] = Counter()
        self.reason = ""
        self._names = lamp.names
        self._traits = traits
        self._low_since = np.full(len(lamp.joints), math.nan)  # [s]; NaN: the supply is not low
        self._astray = np.zeros(len(lamp.joints), np.int64)  # readings in a row without the goal sent
        self._powered = powered
        self._clamped = clamped
        self._duty = RunningMean(len(lamp.joints), OVER_TIME)
        self._heating = RunningMean(len(lamp.joints), OVER_TIME)
        self._still = _Still(len(lamp.joints), lamp.contact_on)

    def check(self, observation: Observation) -> Action:
        """Take note of an observation's faults (its own and those found here) and judge it.

        Args:
            observation: One of a lamp whose torque is on.

        Returns:
            GO; LAND where the lamp should be put down; CUT where nothing can be told to it any more.
        """
        for text in observation.faults:
            self.faults[text] += 1
        verdict, self.reason = Action.GO, ""
        for text, found in [*self._servos(observation), *([] if self._clamped else self._foot(observation))]:
            self.faults[text] += 1
            if found > verdict:
                verdict, self.reason = found, text
        return verdict

    def resume(self) -> None:
        """Begin anew what is timed, after a pause in which nobody looked and after which torque was turned on anew."""
        self._low_since[:] = math.nan
        self._astray[:] = 0

    def _servos(self, observation: Observation) -> list[tuple[str, Action]]:
        found: list[tuple[str, Action]] = []
        health = observation.health
        old = observation.angle_age > ANGLE_AGE
        duty = self._duty.add(np.abs(health.pwm), observation.time)
        current = np.sqrt(self._heating.add(observation.current**2, observation.time))
        # What a lost reading does not tell changes nothing, here and below: not low, low, or astray as before.
        lowest = self._traits.lowest_voltage
        low, fine = health.voltage < lowest, health.voltage >= lowest
        self._low_since = np.where(low & np.isnan(self._low_since), observation.time, self._low_since)
        self._low_since[fine] = math.nan
        if health.goal.size:
            self._astray = np.where(health.goal > 0, 0, self._astray + (health.goal == 0))
        late = bool(old.all() and np.isfinite(observation.angle).any())  # it answered; whoever asked stood still
        if late:
            found.append((f"a reading took more than {ANGLE_AGE:g} s: this computer stood still", Action.CUT))
        elif old.all():
            found.append((f"no servo has answered for {ANGLE_AGE:g} s", Action.CUT))
        for index, name in enumerate(self._names):
            error = int(health.hardware_error[index])
            if error > 0:
                found.append((f"{name}: hardware error ({self._traits.error_words(error)})", Action.LAND))
            if health.torque[index] == 0 and self._powered:
                found.append((f"{name}: torque went off", Action.LAND))
            if old[index] and not late:
                found.append((f"{name}: no answer for {ANGLE_AGE:g} s", Action.LAND))
            if health.temperature[index] > TEMPERATURE:
                found.append((f"{name}: above {TEMPERATURE:g} degC", Action.LAND))
            elif health.temperature[index] > WARM:
                found.append((f"{name}: above {WARM:g} degC", Action.GO))
            if duty[index] > DUTY:
                found.append((f"{name}: stalled, duty above {DUTY:.0%} over {OVER_TIME:g} s", Action.LAND))
            if current[index] > CURRENT:
                found.append((f"{name}: current above {CURRENT:g} A over {OVER_TIME:g} s", Action.LAND))
            if low[index]:
                lasting = observation.time - self._low_since[index] >= VOLTAGE_TIME
                text = f"{name}: supply below {lowest[index]:.1f} V"
                found.append((text, Action.LAND if lasting else Action.GO))
            if self._astray[index] >= GOALS_LOST:
                found.append((f"{name}: {GOALS_LOST} goals in a row did not arrive", Action.LAND))
        return found

    def _foot(self, observation: Observation) -> list[tuple[str, Action]]:
        stuck = self._still.stuck(observation)
        if observation.foot_age > FOOT_AGE_STOP:
            return [(f"foot: no force for {FOOT_AGE_STOP:g} s", Action.LAND)]
        if observation.foot_age > FOOT_AGE:
            return [(f"foot: no force for {FOOT_AGE:g} s", Action.GO)]
        if stuck:
            return [("foot: stuck, the force stays the same while the lamp moves", Action.LAND)]
        return []


class _Still:
    """Watches for a foot force that does not change though it must.

    Args:
        n: How many joints.
        contact_on: Force of ground contact [N].
    """

    def __init__(self, n: int, contact_on: float) -> None:
        self._contact_on = contact_on
        self._force = math.nan
        self._since = self._seen = self._sampled = math.nan
        self._angle = np.full(n, math.nan)  # the last that is known of each joint [rad]
        self._measured = np.full(n, math.nan)  # when [s]
        self._way = self._low = self._high = np.zeros(n)

    def stuck(self, observation: Observation) -> bool:
        """Return whether the force has been measured as the same for too long while a joint moved."""
        passed, self._seen = observation.time - self._seen, observation.time
        sampled = observation.time - observation.foot_age
        fresh = math.isfinite(observation.foot_force) and not sampled - self._sampled <= FOOT_FRESH
        self._sampled = sampled if fresh else self._sampled
        there = np.isfinite(observation.angle)
        step, took = observation.angle - self._angle, observation.time - self._measured
        self._angle = np.where(there, observation.angle, self._angle)
        self._measured = np.where(there, observation.time, self._measured)
        if not fresh:  # nobody measured
            return False
        if observation.foot_force != self._force or not passed <= MAX_PERIOD:
            self._force, self._since = observation.foot_force, sampled
            self._way = self._low = self._high = np.zeros(len(step))
            return False
        self._way = self._way + np.where(np.abs(step) > FOOT_STUCK_SPEED * took, step, 0.0)  # not where it is NaN
        self._low, self._high = np.minimum(self._low, self._way), np.maximum(self._high, self._way)
        moved = bool((self._high - self._low > FOOT_STUCK_MOVE).any())
        allowed = FOOT_STUCK if self._force > self._contact_on else FOOT_STUCK_AIR
        return moved and sampled - self._since > allowed
