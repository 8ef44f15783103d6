"""What lies between a lamp's motors and its links: play in the gears, and arm links that bend.

**Play.** The encoder of an XL330 sits on the output shaft; between it and the gear train there is play. So the motor
turns a rotor of its own, a hinge beside the joint: its inertia, friction and torque move there from the joint. A
limited tendon, rotor minus output within plus or minus half the play, lets the two meet at the ends alone. A torque
passed through a dead zone would need springs too stiff for a step of 2 ms; MuJoCo solves the limit implicitly, and an
open gap leaves the link free, as it is.

**Links that bend.** The tendon of a joint that turns an arm link is a spring instead, slack within the play (and
damped only beyond it). A horn between play and spring would weigh next to nothing, and be unstable. It is left out: the
joint's angle is the link's with its bending, and the horn, where the encoder is, stands at the nearest angle to it that
the rotor's play allows. The damper is the spring times `RETARDATION`, which damps a lamp's 20 to 40 Hz by 3 to 6 % of
critical, as printed plastic and screws do.

A lamp that bends is simulated in steps of `BENDING_STEP`. Clamped, with 45 Nm/rad and 4 mrad of play, its joints then
are 1.6 mrad from where steps of 0.25 ms have them, as without springs; with 2 ms for step and retardation it was 12.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RETARDATION = 0.0005
"""Of the arm links: damping by stiffness [s]. Chosen: half a step of the physics, from which on a spring that is
integrated explicitly with an implicit damper is stable whatever it carries."""

BENDING_STEP = 0.001
"""Longest physics step of a lamp whose arm links bend [s]."""

_ROTOR_MASS, _ROTOR_INERTIA = 1e-6, 1e-9  # kg, kg m^2: what MuJoCo wants of a body; its inertia is the armature
_LIMIT_SOLIMP = (0.98, 0.999, 1e-4, 0.5, 2.0)  # teeth: the limit gives some tenths of a milliradian
_CONTACT_STEPS = 2.0  # time constant of the limit, in steps: the shortest that MuJoCo takes


@dataclass(frozen=True)
class Gears:
    """Where a compiled lamp's motors and springs are; arrays have shape (n,) over its joints.

    Attributes:
        qpos: Position address of what each motor turns: a rotor, or the joint itself.
        dof: Its degree of freedom.
        parted: Whether it is a rotor.
        slack: Half the play of joints whose springs are in the tendon [rad]; infinite for all others.
        springs: Those tendons; -1 for all others.
        damping: Of each of them, beyond the slack [Nm s/rad].
    """

    qpos: NDArray[np.int64]
    dof: NDArray[np.int64]
    parted: NDArray[np.bool_]
    slack: Array
    springs: NDArray[np.int64]
    damping: float

    @classmethod
    def rigid(cls, qpos: NDArray[np.int64], dof: NDArray[np.int64]) -> Gears:
        """Return those of motors that turn their joints themselves."""
        n = len(dof)
        return cls(qpos, dof, np.zeros(n, bool), np.full(n, np.inf), np.full(n, -1), 0.0)

    @property
    def springy(self) -> NDArray[np.bool_]:
        """Whether each joint's spring is in a tendon, shape (n,)."""
        return self.springs >= 0


class GearBuilder:
    """Puts play and springs into a lamp's model: `reshape` before it is compiled, `finish` after.

    Args:
        joints: Names of the joints, n of them.
        play: Between motor and output of each, from end to end, shape (n,) [rad].
        stiffness: Of each arm link [Nm/rad]; infinite: rigid.
    """

    def __init__(self, joints: tuple[str, ...], play: Array, stiffness: float) -> None:
        self._joints, self._play, self._stiffness = joints, play, stiffness
        self._slack = np.full(len(joints), np.inf)
        self._parted = play > 0.0
        self._home: list[dict[str, Array]] = []

    @property
    def bends(self) -> bool:
        """Whether arm links bend."""
        return math.isfinite(self._stiffness)

    def reshape(self, spec: mujoco.MjSpec) -> None:
        """Add rotors, tendons and springs to a specification; without play and bending it stays as it is."""
        if not self._play.any() and not self.bends:
            return
        joints = [spec.joint(name) for name in self._joints]
        carrying = {joint.parent.parent.name for joint in joints}  # an arm link carries a further joint
        if self.bends:
            springy = np.array([joint.parent.name in carrying for joint in joints])
            self._slack[springy] = self._play[springy] / 2
            self._parted = self._parted | springy
        self._remember(spec)
        for joint, play, slack, parted in zip(joints, self._play, self._slack, self._parted, strict=True):
            if parted:
                _add_rotor(spec, joint, float(play), self._stiffness if np.isfinite(slack) else None)

    def finish(self, model: mujoco.MjModel) -> Gears:
        """Put the key poses back into the compiled model, and return where its motors are."""
        for index, home in enumerate(self._home):
            for name, qpos in home.items():
                address = int(model.joint(name).qposadr[0])
                model.key_qpos[index, address : address + len(qpos)] = qpos
        turned = [_rotor(name) if parted else name for name, parted in zip(self._joints, self._parted, strict=True)]
        springy = np.isfinite(self._slack)
        return Gears(
            qpos=np.array([model.joint(name).qposadr[0] for name in turned]),
            dof=np.array([model.joint(name).dofadr[0] for name in turned]),
            parted=self._parted,
            slack=self._slack,
            springs=np.array(
                [
                    model.tendon(f"{name}_play").id if spring else -1
                    for name, spring in zip(self._joints, springy, strict=True)
                ],
                np.int64,
            ),
            damping=RETARDATION * self._stiffness if springy.any() else 0.0,
        )

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
            for name, parted in zip(self._joints, self._parted, strict=True):
                if parted:
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
