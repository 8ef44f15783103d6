"""What a reality does to the twin's mechanics: play, links that bend, floors, masses, friction.

Play and springs are `robolamp.twin.gears`, as in a calibrated twin; here is the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robolamp.emulator.reality.reality import PerJoint, Reality
from robolamp.lamp import Lamp
from robolamp.twin.lamp_model import Bend, TwinModel

if TYPE_CHECKING:
    import mujoco

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Encoders:
    """Encoders that are off: by a constant, and by a sine over each turn. Arrays have shape (n,) over the joints.

    Attributes:
        offset: Added to each angle [rad].
        amplitude: Of the sine [rad].
        phase: Of the sine [rad].
        zero: Shaft angle of each joint's 0 [rad].
        sign: Sense of each joint against its shaft.
    """

    offset: Array
    amplitude: Array
    phase: Array
    zero: Array
    sign: Array

    def read(self, angle: Array) -> Array:
        """Return what the encoders read at true joint angles, shape (n,) [rad]."""
        sine = np.sin(self.zero + self.sign * angle + self.phase)
        return angle + self.offset + self.sign * self.amplitude * sine


@dataclass(frozen=True)
class Bent:
    """A bent twin.

    Attributes:
        twin: The compiled lamp.
        encoders: How the encoders are off; None: not at all.
    """

    twin: TwinModel
    encoders: Encoders | None = None


class Bender:
    """Bends a lamp's model: `bend` and `reshape` before it is compiled, `finish` after.

    Args:
        lamp: The lamp.
        reality: How it is bent.
    """

    def __init__(self, lamp: Lamp, reality: Reality) -> None:
        self._lamp, self._reality = lamp, reality
        off, wave = self._each(reality.encoder_offset), self._each(reality.encoder_nonlinearity)
        self._encoders = None
        if off.any() or wave.any():
            self._encoders = Encoders(
                off,
                wave,
                self._each(reality.encoder_phase),
                np.array([joint.zero for joint in lamp.joints]),
                np.array([float(joint.sign) for joint in lamp.joints]),
            )

    @property
    def bend(self) -> Bend:
        """What a `Bend` can express."""
        bent = self._reality
        return Bend(
            strength=bent.strength,
            friction=bent.friction,
            mass=bent.mass,
            floor=bent.floor_friction,
            delay=bent.delay,
            supply=bent.supply,
            backlash=self._each(bent.backlash),
            stiffness=bent.stiffness,
        )

    def reshape(self, spec: mujoco.MjSpec) -> None:
        """Change what is compiled."""
        bent = self._reality
        for name, armature, viscous in zip(
            self._lamp.names, self._each(bent.armature), self._each(bent.viscous), strict=True
        ):
            actuator = spec.actuator(name)
            actuator.armature *= armature
            actuator.damping[0] *= viscous
        if bent.floor_tilt:
            gravity = float(np.linalg.norm(spec.option.gravity))
            spec.option.gravity = [-gravity * math.sin(bent.floor_tilt), 0.0, -gravity * math.cos(bent.floor_tilt)]
        if bent.floor_softness != 1.0:
            for geom in spec.geoms:
                geom.solref[0] *= bent.floor_softness

    def finish(self, twin: TwinModel) -> Bent:
        """Return the compiled lamp with what is left to be changed."""
        bent, model = self._reality, twin.model
        for name, mass in zip(self._lamp.names, self._each(bent.link_mass), strict=True):
            body = int(model.jnt_bodyid[model.joint(name).id])
            model.body_mass[body] *= mass
            model.body_inertia[body] *= mass
        factors = {
            "coulomb": bent.coulomb,
            "viscous": bent.viscous,
            "stribeck": bent.stribeck,
            "stribeck_velocity": bent.stribeck_velocity,
            "load_motor": bent.load_friction,
            "load_external": bent.load_friction,
            "load_external_stribeck": bent.load_friction,
            "armature": bent.armature,
        }
        servos = replace(twin.servos, **{key: getattr(twin.servos, key) * by for key, by in factors.items()})
        if bent.resistance_per_kelvin:  # in place of what the calibration says of it
            growth = np.full(len(servos.resistance), bent.resistance_per_kelvin)
            servos = replace(servos, resistance_temperature=growth)
        return Bent(replace(twin, servos=servos), self._encoders)

    def _each(self, values: PerJoint) -> Array:
        return np.array(np.broadcast_to(values, len(self._lamp.joints)), float)
