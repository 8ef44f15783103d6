"""What a reality does to the twin's mechanics: play, links that bend, floors, masses, friction.

**Play.** The encoder of an XL330 sits on the output shaft; between it and the gear train there is play. So the motor
turns a rotor of its own, a hinge beside the joint: its inertia, friction and torque move there from the joint. A
limited tendon, rotor minus output within plus or minus half the play, lets the two meet at the ends alone. A torque
passed through a dead zone would need springs too stiff for a step of 2 ms; MuJoCo solves the limit implicitly, and an
open gap leaves the link free, as it is.

**Links that bend.** An arm link gets a second hinge at the joint that turns it, behind the encoder: a spring with a
damper in parallel. The damper is the spring times `RETARDATION`, which damps a lamp's 20 to 40 Hz by a seventh to a
quarter of critical.

**Both at one joint.** A horn between play and spring would weigh next to nothing, and be unstable. It is left out: the
tendon is a spring that is slack within the play (and damped only beyond it), the joint's angle is the link's with its
bending, and the horn, where the encoder is, stands at the nearest angle to it that the rotor's play allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robolamp.emulator.difference import PerJoint, Reality
from robolamp.lamp import Lamp
from robolamp.twin.model import Bend, TwinModel

if TYPE_CHECKING:
    import mujoco

RETARDATION = 0.002
"""Of the arm links: damping by stiffness [s]. Chosen: one step of the physics; see above."""

_ROTOR_MASS, _ROTOR_INERTIA = 1e-6, 1e-9  # kg, kg m^2: what MuJoCo wants of a body; its inertia is the armature
_LIMIT_SOLIMP = (0.98, 0.999, 1e-4, 0.5, 2.0)  # teeth: the limit gives some tenths of a milliradian
_CONTACT_STEPS = 2.0  # time constant of the limit, in steps: the shortest that MuJoCo takes

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
        motor_qpos: Position address of what each motor turns: a rotor, or the joint itself; shape (n,).
        motor_dof: Its degree of freedom, shape (n,).
        slack: Half the play of joints whose springs are in the tendon, shape (n,) [rad]; infinite for all others.
        springs: Those tendons, in the order of the joints.
        damping: Of each, beyond the slack [Nm s/rad].
        encoders: How the encoders are off; None: not at all.
        own_delay: Whether the servos' delay was taken out of the model: their loops see other angles than it has.
    """

    twin: TwinModel
    motor_qpos: NDArray[np.int64]
    motor_dof: NDArray[np.int64]
    slack: Array
    springs: NDArray[np.int64]
    damping: float
    encoders: Encoders | None = None
    own_delay: bool = False

    @classmethod
    def straight(cls, twin: TwinModel) -> Bent:
        """Return a twin that nothing bends."""
        return cls(twin, twin.qpos, twin.dof, np.full(len(twin.dof), np.inf), np.zeros(0, np.int64), 0.0)


class Bender:
    """Bends a lamp's model: `bend` and `reshape` before it is compiled, `finish` after.

    Args:
        lamp: The lamp.
        reality: How it is bent.
    """

    def __init__(self, lamp: Lamp, reality: Reality) -> None:
        self._lamp, self._reality = lamp, reality
        self._play = self._each(reality.backlash)
        self._slack = np.full(len(lamp.joints), np.inf)
        self._home: list[dict[str, Array]] = []
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
        self._own_delay = bool(self._play.any()) or self._encoders is not None

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
            if self._own_delay:
                actuator.delay, actuator.nsample = 0.0, 0
        if bent.floor_tilt:
            gravity = float(np.linalg.norm(spec.option.gravity))
            spec.option.gravity = [-gravity * math.sin(bent.floor_tilt), 0.0, -gravity * math.cos(bent.floor_tilt)]
        if bent.floor_softness != 1.0:
            for geom in spec.geoms:
                geom.solref[0] *= bent.floor_softness
        if self._play.any() or math.isfinite(bent.stiffness):
            self._remember(spec)
            joints = [spec.joint(name) for name in self._lamp.names]
            carrying = {joint.parent.parent.name for joint in joints}  # an arm link carries a further joint
            for index, joint in enumerate(joints):
                play, springy = self._play[index], math.isfinite(bent.stiffness) and joint.parent.name in carrying
                if play and springy:
                    self._slack[index] = play / 2
                    _add_rotor(spec, joint, play, bent.stiffness)
                elif play:
                    _add_rotor(spec, joint, play, None)
                elif springy:
                    joint.parent.add_joint(
                        name=f"{joint.parent.name}_bend",
                        axis=joint.axis,
                        pos=joint.pos,
                        stiffness=bent.stiffness,
                        damping=RETARDATION * bent.stiffness,
                    )

    def finish(self, twin: TwinModel) -> Bent:
        """Return the compiled lamp with what is left to be changed."""
        bent, model = self._reality, twin.model
        for name, mass in zip(self._lamp.names, self._each(bent.link_mass), strict=True):
            body = int(model.jnt_bodyid[model.joint(name).id])
            model.body_mass[body] *= mass
            model.body_inertia[body] *= mass
        for index, home in enumerate(self._home):
            for name, qpos in home.items():
                address = int(model.joint(name).qposadr[0])
                model.key_qpos[index, address : address + len(qpos)] = qpos
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
        turned = [_rotor(name) if play else name for name, play in zip(self._lamp.names, self._play > 0, strict=True)]
        springy = [name for name, slack in zip(self._lamp.names, self._slack, strict=True) if np.isfinite(slack)]
        return Bent(
            replace(twin, servos=servos),
            np.array([model.joint(name).qposadr[0] for name in turned]),
            np.array([model.joint(name).dofadr[0] for name in turned]),
            self._slack,
            np.array([model.tendon(f"{name}_play").id for name in springy], np.int64),
            RETARDATION * bent.stiffness if springy else 0.0,
            self._encoders,
            self._own_delay,
        )

    def _each(self, values: PerJoint) -> Array:
        return np.array(np.broadcast_to(values, len(self._lamp.joints)), float)

    def _remember(self, spec: mujoco.MjSpec) -> None:
        """Take the key poses out of a specification that gets more joints, to put them back joint by joint."""
        model = spec.copy().compile()
        for index, key in enumerate(spec.keys):
            joints = [model.joint(number) for number in range(model.njnt)]
            size = {0: 7, 1: 4}  # free and ball joints; else 1
            home = {
                joint.name: model.key_qpos[index][(at := int(joint.qposadr[0])) : at + size.get(int(joint.type[0]), 1)]
                for joint in joints
            }
            for name, play in zip(self._lamp.names, self._play, strict=True):
                if play > 0.0:
                    home[_rotor(name)] = home[name]
            self._home.append({name: np.array(qpos) for name, qpos in home.items()})
            key.qpos = []


def _rotor(joint: str) -> str:
    return f"{joint}_rotor"


def _add_rotor(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, play: float, stiffness: float | None) -> None:
    """Part a joint's rotor from its output.

    Args:
        spec: Where.
        joint: The joint.
        play: Between them, from end to end [rad].
        stiffness: Of a spring behind the play [Nm/rad]; None: rigid.
    """
    name, body = joint.name, joint.parent
    rotor = body.parent.add_body(name=_rotor(name), pos=body.pos, quat=body.quat)
    rotor.alt = body.alt
    rotor.explicitinertial, rotor.mass = True, _ROTOR_MASS
    rotor.ipos, rotor.inertia = [0.0, 0.0, 0.0], [_ROTOR_INERTIA] * 3
    rotor.add_joint(name=_rotor(name), axis=joint.axis, pos=joint.pos)
    spec.actuator(name).target = _rotor(name)
    tendon = spec.add_tendon(name=f"{name}_play")
    tendon.wrap_joint(_rotor(name), 1.0)
    tendon.wrap_joint(name, -1.0)
    ends = [-play / 2, play / 2]
    if stiffness is None:
        tendon.limited, tendon.range = True, ends
        tendon.solref_limit = [_CONTACT_STEPS * spec.option.timestep, 1.0]
        tendon.solimp_limit = _LIMIT_SOLIMP
    else:
        tendon.springlength = ends
        tendon.stiffness[0] = stiffness
