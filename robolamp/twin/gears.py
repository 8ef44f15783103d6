"""What lies between a lamp's motors and its links: play in the gears, and shafts and arms that bend.

Each is a hinge of its own, in the same body as the joint and on the same axis: **joint, play, bending**. The joint is
what the motor turns, with its inertia and friction. The encoder of an XL330 sits on the output shaft, so what it reads
is joint plus play; the link stands at the sum of all three. A joint without one has no such hinge.

**Play** is a hinge with limits at plus and minus half of it. The limits are contacts of a fixed time constant, so what
they give does not depend on the step.

**Bending** is a hinge with a spring, and a damper that is the spring times `RETARDATION`. Left explicit, a spring of K
is unstable where it carries little: the free foot weighs 3e-5 kg m^2 on the ankle's. So its hinge gets the inertia
h^2 K / 4 + h D / 2, with the step h and the damper D, which makes the trapezoidal rule of it: stable whatever it
carries, and exact at rest (Stern and Grinspun 2009, "Implicit-explicit variational integration of highly oscillatory
problems"). That inertia opposes bending alone, never the link.

Both need MuJoCo's Euler integrator with no implicit damping: an implicit one weakens what contacts give in a step.
`benchmarks/convergence.py` measures how far all this depends on the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

RETARDATION = 0.0005
"""Damping of what bends by its stiffness [s]. Chosen: it damps a lamp's 20 to 40 Hz by 3 to 6 % of critical, as printed
plastic and screws do."""

YIELDING_STEP = 0.001
"""Longest physics step of a lamp that has play or bends [s]."""

_TEETH = (0.002, 1.0)  # solref of the ends of the play: time constant, twice `YIELDING_STEP` [s], and damping ratio
_TEETH_SOLIMP = (0.98, 0.999, 1e-4, 0.5, 2.0)  # at rest they give some tenths of a milliradian


@dataclass(frozen=True)
class Gears:
    """Where a compiled lamp's play is; arrays have shape (n,) over its joints.

    Attributes:
        play: Position address of each joint's play; -1: it has none.
        play_dof: Its degree of freedom; -1: it has none.
        bending: Position address of each joint's bending; -1: it is rigid.
        bending_dof: Its degree of freedom; -1: it is rigid.
    """

    play: Indices
    play_dof: Indices
    bending: Indices
    bending_dof: Indices

    @classmethod
    def of(cls, model: mujoco.MjModel, joints: tuple[str, ...]) -> Gears:
        """Return those of a compiled model.

        Args:
            model: The model.
            joints: Names of its joints.
        """

        def addresses(suffix: str, of: NDArray[np.int32]) -> Indices:
            ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{name}{suffix}") for name in joints]
            return np.array([of[number] if number >= 0 else -1 for number in ids], np.int64)

        return cls(
            *(addresses(suffix, of) for suffix in (_PLAY, _BENDING) for of in (model.jnt_qposadr, model.jnt_dofadr))
        )

    @classmethod
    def rigid(cls, n: int) -> Gears:
        """Return those of n joints without play that do not bend."""
        return cls(*(np.full(n, -1) for _ in range(4)))

    def dofs(self, dof: Indices) -> list[Indices]:
        """Return the degrees of freedom that turn each link, n lists.

        Args:
            dof: Of the joints, shape (n,).
        """
        every = np.stack([dof, self.play_dof, self.bending_dof], axis=1)
        return [row[row >= 0] for row in every]


_PLAY, _BENDING = "_play", "_bending"


def add_gears(spec: mujoco.MjSpec, joints: tuple[str, ...], play: Array, stiffness: Array) -> None:
    """Put play and springs into a lamp's specification; without either it stays as it is.

    Args:
        spec: Of the lamp; its physics step becomes `YIELDING_STEP` where it is longer.
        joints: Names of the joints, n of them.
        play: Between motor and output of each, from end to end, shape (n,) [rad].
        stiffness: Between each servo and what it turns, shape (n,) [Nm/rad]; infinite: rigid.
    """
    yielding = (play > 0.0) | np.isfinite(stiffness)
    if not yielding.any():
        return
    spec.option.timestep = step = min(spec.option.timestep, YIELDING_STEP)
    homes = _homes(spec)
    for name, gap, spring in zip(joints, play, stiffness, strict=True):
        joint = spec.joint(name)
        if gap > 0.0:
            hinge = joint.parent.add_joint(name=name + _PLAY, axis=joint.axis, pos=joint.pos)
            hinge.limited, hinge.range = True, [-gap / 2, gap / 2]
            hinge.solref_limit, hinge.solimp_limit = _TEETH, _TEETH_SOLIMP
        if np.isfinite(spring):
            hinge = joint.parent.add_joint(name=name + _BENDING, axis=joint.axis, pos=joint.pos)
            damping = RETARDATION * spring
            hinge.stiffness[0], hinge.damping[0] = spring, damping
            hinge.armature = step**2 * spring / 4 + step * damping / 2
    model = spec.copy().compile()
    for key, home in zip(spec.keys, homes, strict=True):
        qpos = np.zeros(model.nq)
        for name, values in home.items():
            address = int(model.joint(name).qposadr[0])
            qpos[address : address + len(values)] = values
        key.qpos = qpos


def _homes(spec: mujoco.MjSpec) -> list[dict[str, Array]]:
    """Take the key poses out of a specification that gets more joints, and return them by joint."""
    model = spec.copy().compile()
    joints = [model.joint(number) for number in range(model.njnt)]
    ends = [*(int(joint.qposadr[0]) for joint in joints[1:]), model.nq]
    homes = []
    for index, key in enumerate(spec.keys):
        qpos = model.key_qpos[index].copy()
        homes.append({each.name: qpos[int(each.qposadr[0]) : end] for each, end in zip(joints, ends, strict=True)})
        key.qpos = []
    return homes
