"""A reality: how an emulated lamp differs from its twin. `file`, beside this, reads one; `draw` draws one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.lamp import Lamp

NONE = "none"
"""Name of the reality that is the twin itself."""

AIR = 30.0
"""Of the air around the servos, unless a reality says otherwise [degC]; calibrated resistances hold there."""

PerJoint = NDArray[np.float64] | float


@dataclass(frozen=True)
class Reality:
    """How an emulated lamp differs from its twin; the default is not at all.

    Values of joints have shape (n,) over the lamp's joints, or are scalars for all of them.

    Attributes:
        name: The reality's name.
        strength: Torque constants, times this.
        friction: All friction of the servos, times this.
        encoder_noise: Standard deviation of each angle reading [rad].
        latency: How late every instruction reaches the servos [s].
        jitter: Mean of how much later still [s].
        resistance: Of the supply [Ohm].
        drain: By how much the supply falls as time goes [V/s].
        foot_gain: Foot sensor reading, times this.
        foot_offset: Added to each force reading [N].
        foot_drift: By how much that grows [N/s].
        foot_noise: Standard deviation of each force reading [N].
        floor_friction: Sliding friction of foot on floor, times this.
        mass: All masses, times this.
        seed: Of all noise.
        coulomb: Dry friction, times this and `friction`.
        viscous: Viscous friction, times this and `friction`.
        stribeck: Friction added at standstill, times this and `friction`.
        stribeck_velocity: Speed at which that is gone, times this.
        load_friction: Friction by load, times this and `friction`.
        armature: Rotor inertias, times this.
        link_mass: Masses of the links that the joints turn, times this.
        backlash: Play between gear train and output, from end to end [rad].
        encoder_offset: Added to each angle reading [rad].
        encoder_nonlinearity: Amplitude of a sine over one turn of the encoder, added to each angle reading [rad].
        encoder_phase: Of that sine [rad].
        delay: Added to the servos' delay [s].
        temperature: Of the air around the servos [degC].
        resistance_per_kelvin: By which windings' resistance grows, of its value at 30 degC, in place of what the
            calibration says; 0: as that says [1/K].
        supply: Added to the supply voltage [V].
        foot_dead_time: Age of the force in each foot reading [s].
        floor_tilt: Slope of the floor, positive where it rises ahead [rad].
        floor_softness: Time constant of all contacts, times this.
        stiffness: Between each servo and what it turns [Nm/rad]; infinite: rigid.
    """

    name: str
    strength: PerJoint = 1.0
    friction: PerJoint = 1.0
    encoder_noise: PerJoint = 0.0
    latency: float = 0.0
    jitter: float = 0.0
    resistance: float = 0.0
    drain: float = 0.0
    foot_gain: float = 1.0
    foot_offset: float = 0.0
    foot_drift: float = 0.0
    foot_noise: float = 0.0
    floor_friction: float = 1.0
    mass: float = 1.0
    seed: int = 0
    coulomb: PerJoint = 1.0
    viscous: PerJoint = 1.0
    stribeck: PerJoint = 1.0
    stribeck_velocity: PerJoint = 1.0
    load_friction: PerJoint = 1.0
    armature: PerJoint = 1.0
    link_mass: PerJoint = 1.0
    backlash: PerJoint = 0.0
    encoder_offset: PerJoint = 0.0
    encoder_nonlinearity: PerJoint = 0.0
    encoder_phase: PerJoint = 0.0
    delay: float = 0.0
    temperature: float = AIR
    resistance_per_kelvin: float = 0.0
    supply: float = 0.0
    foot_dead_time: float = 0.0
    floor_tilt: float = 0.0
    floor_softness: float = 1.0
    stiffness: float = math.inf

    @classmethod
    def none(cls, lamp: Lamp) -> Reality:
        """Return the reality that is the twin itself."""
        n = len(lamp.joints)
        return cls(NONE, np.ones(n), np.ones(n), np.zeros(n))
