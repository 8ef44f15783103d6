"""How one lamp differs from the calibrated one in what the twin can express; the emulator's realities add the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PerJoint = NDArray[np.float64] | float
"""Shape (n,) over the joints, or one for all of them."""


@dataclass(frozen=True, kw_only=True)
class Bend:
    """How one lamp differs from the calibrated one; the default is not at all.

    Attributes:
        strength: Torque constants, times this.
        friction: All friction of the servos, times this.
        coulomb: Dry friction, times this and `friction`.
        viscous: Viscous friction, times this and `friction`.
        stribeck: Friction added at standstill, times this and `friction`.
        stribeck_velocity: Speed at which that is gone, times this.
        load_friction: Friction by load, times this and `friction`.
        armature: Rotor inertias, times this.
        link_mass: Masses and inertias of the links that the joints turn, times this.
        backlash: Play between gear train and output, from end to end [rad]; NaN: the calibration's.
        encoder_offset: Added to each angle reading [rad].
        encoder_nonlinearity: Amplitude of a sine over one turn of the encoder, added to each angle reading [rad].
        encoder_phase: Of that sine [rad].
        delay: Added to the servos' delay, which stays within what a calibration may hold [s].
        supply: Added to the supply voltage [V].
        resistance: Added to the supply's [Ohm].
        foot_gain: Foot sensor reading, times this.
        foot_noise: Standard deviation of each force reading [N].
        floor_friction: Sliding friction of foot on floor, times this.
        floor_tilt: Slope of the floor, positive where it rises ahead [rad].
        floor_softness: Time constant of all contacts, times this.
        mass: All masses and inertias, times this.
        sideways: How far to the left of the plane of motion all centres of mass are [m].
        stiffness: Between each servo and what it turns [Nm/rad]; infinite: rigid; NaN: the calibration's.
        seed: Of all noise.
    """

    strength: PerJoint = 1.0
    friction: PerJoint = 1.0
    coulomb: PerJoint = 1.0
    viscous: PerJoint = 1.0
    stribeck: PerJoint = 1.0
    stribeck_velocity: PerJoint = 1.0
    load_friction: PerJoint = 1.0
    armature: PerJoint = 1.0
    link_mass: PerJoint = 1.0
    backlash: PerJoint = math.nan
    encoder_offset: PerJoint = 0.0
    encoder_nonlinearity: PerJoint = 0.0
    encoder_phase: PerJoint = 0.0
    delay: float = 0.0
    supply: float = 0.0
    resistance: float = 0.0
    foot_gain: float = 1.0
    foot_noise: float = 0.0
    floor_friction: float = 1.0
    floor_tilt: float = 0.0
    floor_softness: float = 1.0
    mass: float = 1.0
    sideways: float = 0.0
    stiffness: float = math.nan
    seed: int = 0
