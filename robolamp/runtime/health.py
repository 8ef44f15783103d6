"""Guards over time: what in the observations is a fault, and when the run must end for it."""

from __future__ import annotations

from collections import Counter
from enum import IntEnum

import numpy as np

from robolamp.dynamixel.registers import MODELS, VOLTAGE_UNIT, HardwareError, Name
from robolamp.lamp import Lamp
from robolamp.signals import Observation

ANGLE_AGE = 0.1
"""Age of an angle at which the run ends [s]: five ticks at 50 Hz; until then the last goal is held."""

FOOT_AGE = 0.05
"""Age of the foot force that is a fault [s] (hardware/firmware/README.md)."""

FOOT_AGE_STOP = 0.1
"""Age of the foot force at which the run ends [s]: the controller is blind to the floor."""

TEMPERATURE = 65.0
"""Temperature at which the run ends [degC]: below the servos' own limits of 70 and 72 (Temperature Limit(31))."""

VOLTAGE_TIME = 0.2
"""How long a voltage below the servo's limit is only a fault [s]; a hop's sag is shorter."""


class Verdict(IntEnum):
    """What the guards say, the more urgent the larger."""

    GO = 0
    LAND = 1
    CUT = 2


class Guard:
    """Judges one observation after the other.

    Args:
        lamp: Gives joint names and servo models.

    Attributes:
        faults: How many observations showed each fault, by its text.
        reason: The fault that ended the run; empty while there is none.
    """

    def __init__(self, lamp: Lamp) -> None:
        self.faults: Counter[str] = Counter()
        self.reason = ""
        self._names = lamp.names
        self._lowest = np.array(
            [(MODELS[joint.servo][Name.MIN_VOLTAGE_LIMIT].initial or 0) * VOLTAGE_UNIT for joint in lamp.joints]
        )
        self._low_since: dict[str, float] = {}

    def check(self, observation: Observation) -> Verdict:
        """Take note of an observation's faults (its own and those found here) and judge it.

        Args:
            observation: One of a lamp whose torque is on.

        Returns:
            GO; LAND where the lamp should be put down; CUT where nothing can be told to it any more.
        """
        for text in observation.faults:
            self.faults[text] += 1
        verdict = Verdict.GO
        for text, found in [*self._servos(observation), *self._foot(observation)]:
            self.faults[text] += 1
            if found > verdict:
                verdict = found
                if not self.reason:
                    self.reason = text
        return verdict

    def _servos(self, observation: Observation) -> list[tuple[str, Verdict]]:
        found: list[tuple[str, Verdict]] = []
        health = observation.health
        old = observation.angle_age > ANGLE_AGE
        if old.all():
            found.append((f"no servo has answered for {ANGLE_AGE:g} s", Verdict.CUT))
        for index, name in enumerate(self._names):
            error = int(health.hardware_error[index])
            if error > 0:
                found.append((f"{name}: hardware error ({HardwareError.words(error)})", Verdict.LAND))
            if health.torque[index] == 0:
                found.append((f"{name}: torque went off", Verdict.LAND))
            if old[index]:
                found.append((f"{name}: no answer for {ANGLE_AGE:g} s", Verdict.LAND))
            if health.temperature[index] > TEMPERATURE:
                found.append((f"{name}: above {TEMPERATURE:g} degC", Verdict.LAND))
            if health.voltage[index] < self._lowest[index]:
                since = self._low_since.setdefault(name, observation.time)
                lasting = observation.time - since >= VOLTAGE_TIME
                text = f"{name}: supply below {self._lowest[index]:.1f} V"
                found.append((text, Verdict.LAND if lasting else Verdict.GO))
            else:
                self._low_since.pop(name, None)
        return found

    def _foot(self, observation: Observation) -> list[tuple[str, Verdict]]:
        if observation.foot_age > FOOT_AGE_STOP:
            return [(f"foot: no force for {FOOT_AGE_STOP:g} s", Verdict.LAND)]
        if observation.foot_age > FOOT_AGE:
            return [(f"foot: no force for {FOOT_AGE:g} s", Verdict.GO)]
        return []
