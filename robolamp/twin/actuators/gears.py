"""What lies between a lamp's motors and its links: play in the gears, and teeth, shafts and arms that bend.

A joint that yields has a hinge of its own beside it, in the same body and on the same axis: the **joint** is what the
motor turns, with its inertia and friction; the **gear** is by how far the link stands beyond it. Half the play to
either side, a gear meets nothing; further out, a spring, in series the teeth (`TEETH`, where there is play) and all
that bends behind the encoder. The encoder of an XL330 sits on the output shaft, between teeth and shaft: it reads the
joint, the gear's play, and the teeth's share of the bending. The shaft weighs nothing. That share is then as the
springs are, and the shaft needs no coordinate of its own; one as light as that would make what is simulated depend on
the step.

Springs are damped by `RETARDATION` and never pull a link back to where the play begins. Left explicit, a spring of K is
unstable where it carries little: the free foot weighs 3e-5 kg m^2 on the ankle's. So a gear that grips has the inertia
h^2 K / 4 + h D / 2, with the step h and the damper D, which makes the trapezoidal rule of it: stable whatever it
carries, and exact at rest (Stern and Grinspun 2009, "Implicit-explicit variational integration of highly oscillatory
problems"). That inertia opposes the gear alone, never the link, and is gone within the play.

It needs MuJoCo's Euler integrator with no implicit damping: an implicit one weakens what contacts give in a step.
`benchmarks/convergence.py` measures how far all this depends on the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.jit import njit
from robolamp.twin.actuators.servo import hold

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

RIGID = 1e4
"""Stiffness that is as good as none: a hop lands where it does on a rigid lamp [Nm/rad]."""

RETARDATION = 0.0005
"""Damping of what bends by its stiffness [s]. Chosen: it damps a lamp's 20 to 40 Hz by 3 to 6 % of critical, as printed
plastic and screws do."""

TEETH = 36.0
"""Stiffness of a gear train that has play, seen from the output [Nm/rad]: hardware/cad/README.md, 20 to 65."""

LOOSE = 0.001
"""Play from which on that holds [rad]. Below it the teeth give in proportion to the play, down to `_TIGHT`: with next
to none a joint is all but rigid."""

_TIGHT = 0.1

_SUFFIX = "_gear"

_HALF, _STIFFNESS, _DAMPING, _BEFORE, _INERTIA = range(5)  # columns of `Gears.table`


@dataclass(frozen=True)
class Gears:
    """The gears of a compiled lamp; arrays have shape (n,) over its joints.

    Attributes:
        qpos: Position address of each; -1: the joint is rigid.
        dof: Its degree of freedom; -1: the joint is rigid.
        table: A gear a row, shape (n, 5): half of the play [rad], stiffness [Nm/rad], damping [Nm s/rad], the share of
            the bending that the encoder reads, and the inertia of a gear that grips [kg m^2].
    """

    qpos: Indices
    dof: Indices
    table: Array

    @property
    def play(self) -> Array:
        """Play of each, from end to end, shape (n,) [rad]."""
        return 2.0 * self.table[:, _HALF]

    @classmethod
    def of(cls, model: mujoco.MjModel, joints: tuple[str, ...], play: Array, stiffness: Array) -> Gears:
        """Return those of a compiled model.

        Args:
            model: The model.
            joints: Names of its joints, n of them.
            play: As given to `add_gears`.
            stiffness: As given to `add_gears`.
        """
        ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name + _SUFFIX) for name in joints]
        qpos, dof = (
            np.array([addresses[number] if number >= 0 else -1 for number in ids], np.int64)
            for addresses in (model.jnt_qposadr, model.jnt_dofadr)
        )
        return cls(qpos, dof, _table(play, stiffness, model.opt.timestep))

    @classmethod
    def rigid(cls, n: int) -> Gears:
        """Return those of n joints without play that do not bend."""
        return cls(np.full(n, -1), np.full(n, -1), np.zeros((n, 5)))


def _table(play: Array, stiffness: Array, step: float) -> Array:
    """Return `Gears.table` of joints."""
    teeth = np.where(play > 0.0, np.clip(play / LOOSE, _TIGHT, 1.0) / TEETH, 0.0)
    softness = teeth + 1.0 / stiffness
    bends = softness > 0.0
    spring = np.divide(1.0, softness, out=np.zeros_like(softness), where=bends)
    before = np.divide(teeth, softness, out=np.zeros_like(softness), where=bends)
    damping = RETARDATION * spring
    return np.stack([play / 2.0, spring, damping, before, step**2 * spring / 4.0 + step * damping / 2.0], axis=1)


@njit(nogil=True, error_model="numpy")
def gear_torque(gear: Array, angle: float, speed: float) -> float:
    """Return what a gear's spring and damper give [Nm].

    Args:
        gear: Its row of `Gears.table`.
        angle: Of the link beyond the joint [rad].
        speed: Of it [rad/s].
    """
    beyond = angle - min(max(angle, -gear[_HALF]), gear[_HALF])
    torque = -gear[_STIFFNESS] * beyond - gear[_DAMPING] * speed
    if gear[_HALF] == 0.0:
        return torque
    if beyond > 0.0:
        return min(torque, 0.0)
    return max(torque, 0.0) if beyond < 0.0 else 0.0


@njit(nogil=True, error_model="numpy")
def gear_inertia(gear: Array, angle: float) -> float:
    """Return what the step adds to a gear's inertia [kg m^2]; arguments as `gear_torque`'s."""
    return 0.0 if abs(angle) < gear[_HALF] else gear[_INERTIA]


@njit(nogil=True, error_model="numpy")
def read_beyond(gear: Array, angle: float) -> float:
    """Return what an encoder reads beyond its joint [rad]; arguments as `gear_torque`'s."""
    play = min(max(angle, -gear[_HALF]), gear[_HALF])
    return play + gear[_BEFORE] * (angle - play)


@njit(nogil=True, error_model="numpy")
def read_speed(gear: Array, angle: float, speed: float) -> float:
    """Return how fast that changes [rad/s]; arguments as `gear_torque`'s."""
    return speed if abs(angle) < gear[_HALF] else gear[_BEFORE] * speed


def add_gears(spec: mujoco.MjSpec, joints: tuple[str, ...], play: Array, stiffness: Array) -> None:
    """Give the joints of a lamp's specification that yield their gears; without any it stays as it is.

    Args:
        spec: Of the lamp, with the physics step it will have.
        joints: Names of the joints, n of them.
        play: Between motor and output of each, from end to end, shape (n,) [rad].
        stiffness: Between each servo and what it turns, shape (n,) [Nm/rad]; infinite: rigid.
    """
    yielding = (play > 0.0) | np.isfinite(stiffness)
    if not yielding.any():
        return
    homes, table = _homes(spec), _table(play, stiffness, spec.option.timestep)
    for name, yields, gear in zip(joints, yielding, table, strict=True):
        if yields:
            joint = spec.joint(name)
            hinge = joint.parent.add_joint(name=name + _SUFFIX, axis=joint.axis, pos=joint.pos)
            hinge.armature = gear[_INERTIA]  # until the first step says
            hold(hinge)  # by a hand
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
