"""A reality: how an emulated lamp differs from its twin. `file`, beside this, reads one; `draw` draws one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robolamp.lamp import Lamp
from robolamp.twin.bend import Bend, PerJoint

NONE = "none"
"""Name of the reality that is the twin itself."""

AIR = 30.0
"""Of the air around the servos, unless a reality says otherwise [degC]; calibrated resistances hold there."""


@dataclass(frozen=True, kw_only=True)
class Reality(Bend):
    """How an emulated lamp differs from its twin: a bent lamp, and what the twin cannot express; by default not at all.

    Attributes:
        name: The reality's name.
        encoder_noise: Standard deviation of each angle reading [rad].
        latency: How late every instruction reaches the servos [s].
        jitter: Mean of how much later still [s].
        drain: By how much the supply falls as time goes [V/s].
        foot_offset: Added to each force reading [N].
        foot_drift: By how much that grows [N/s].
        foot_dead_time: Age of the force in each foot reading [s].
        temperature: Of the air around the servos [degC].
        resistance_per_kelvin: By which windings' resistance grows, of its value at 30 degC, in place of what the
            calibration says; 0: as that says [1/K].
    """

    name: str
    encoder_noise: PerJoint = 0.0
    latency: float = 0.0
    jitter: float = 0.0
    drain: float = 0.0
    foot_offset: float = 0.0
    foot_drift: float = 0.0
    foot_dead_time: float = 0.0
    temperature: float = AIR
    resistance_per_kelvin: float = 0.0

    @classmethod
    def none(cls, lamp: Lamp) -> Reality:
        """Return the reality that is the twin itself."""
        n = len(lamp.joints)
        return cls(name=NONE, strength=np.ones(n), friction=np.ones(n), encoder_noise=np.zeros(n))
