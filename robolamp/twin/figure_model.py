"""A figure's MuJoCo model, compiled: Jumper, Madzia and whatever else has a sim/NAME/figure.toml.

The motors are ODE's angular motors (its manual, section "Stops and motor parameters": dParamVel, dParamFMax): a
constraint brings the joint to the velocity that is asked for, with no more than the motor's torque. MuJoCo has that
constraint as dry friction, which brings a velocity to zero. So each motor is dry friction, as strong as the motor,
between the joint and a drive: a body of its own that turns as fast as the actuator says and is too heavy to feel its
load. MuJoCo's `velocity` actuator with a high gain and a `forcerange` is no such motor: at the paper's step of 10 ms it
either creeps under load or, where its gain is above inertia / step, chatters about the velocity that it is to reach.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.errors import FileError
from robolamp.figure import POINT, Figure
from robolamp.twin.engine import state_of
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.model_file import load_spec

_SETTLE_TIME = 0.5  # how long a figure stands before a run, its motors at zero velocity [s]


@dataclass(frozen=True)
class World:
    """What a task changes of a figure and of the body at its goal.

    Attributes:
        strength: All motors, times this.
        mass: All masses and inertias of the figure, times this.
        goal_mass: Mass of the body at the goal [kg]; None: the model's.
    """

    strength: float = 1.0
    mass: float = 1.0
    goal_mass: float | None = None


@dataclass(frozen=True)
class FigureTwin:
    """A compiled figure and where its parts are.

    Attributes:
        figure: Its description.
        model: The MuJoCo model.
        state: MuJoCo's integration state of the figure standing, shape (nstate,).
        qpos: Position address of each joint, shape (n,).
        dof: Degree of freedom of each joint, shape (n,).
        actuator: Actuator of each joint, shape (n,).
        root: Position address of the root's free joint.
        goal: Position address of the free joint of the body at the goal; None where the goal is a point.
        position: Address in `sensordata` of the position of each object, by name.
        velocity: Address in `sensordata` of the velocity of each object, by name.
        ahead: Address in `sensordata` of the direction that the heading body faces.
        unsafe: Address in `sensordata` of the number of contacts that are a collision.
        support: Address in `sensordata` of the number of contacts that carry the figure.
    """

    figure: Figure
    model: mujoco.MjModel
    state: NDArray[np.float64]
    qpos: NDArray[np.int64]
    dof: NDArray[np.int64]
    actuator: NDArray[np.int64]
    root: int
    goal: int | None
    position: dict[str, int]
    velocity: dict[str, int]
    ahead: int
    unsafe: int
    support: int

    @property
    def seen(self) -> mujoco.MjModel:
        """The model, for pictures."""
        return self.model

    @property
    def driven(self) -> Figure:
        """What controllers drive."""
        return self.figure

    @property
    def timestep(self) -> float:
        """Physics step [s]."""
        return float(self.model.opt.timestep)

    @property
    def source(self) -> str:
        """The text of the figure's description."""
        return self.figure.source


Twin = TwinModel | FigureTwin
"""A compiled lamp, or a compiled figure."""


def build_figure(
    figure: Figure, assets: Assets, world: World | None = None, *, timestep: float | None = None
) -> FigureTwin:
    """Compile a figure's model with the motors and limits of its description.

    Args:
        figure: The description; names the model file.
        assets: Where the model file is.
        world: What a task changes.
        timestep: Physics step [s]; None: the model's own.

    Raises:
        FileError: The model does not load, or lacks a joint, drive, body or sensor that the description names.
    """
    world = world or World()
    path = assets.path(figure.model)
    spec = load_spec(path, timestep)
    _check(spec, figure, str(path))
    for joint in figure.joints:
        spec.joint(joint.name).range = [joint.lower, joint.upper]
        spec.tendon(joint.name).frictionloss = joint.strength * world.strength
        actuator = spec.actuator(joint.name)
        drive = spec.body(f"drive_{joint.name}")
        actuator.set_to_velocity(kv=float(drive.inertia[2]) / spec.option.timestep)  # reaches its speed in one step
        actuator.ctrlrange = [-joint.speed, joint.speed]
    watched = [figure.root, *figure.objects, *([] if figure.goal == POINT else [figure.goal])]
    watched = sorted(set(watched))
    for name in watched:
        _watch(spec, f"O{name}", name, mujoco.mjtSensor.mjSENS_FRAMEPOS)
        _watch(spec, f"V{name}", name, mujoco.mjtSensor.mjSENS_FRAMELINVEL)
    _watch(spec, "ahead", figure.heading, mujoco.mjtSensor.mjSENS_FRAMEXAXIS)
    model = spec.compile()
    own = model.body_rootid == model.body(figure.root).id
    model.body_mass[own] *= world.mass
    model.body_inertia[own] *= world.mass
    if figure.goal != POINT and world.goal_mass is not None:
        body = model.body(figure.goal).id
        model.body_inertia[body] *= world.goal_mass / model.body_mass[body]
        model.body_mass[body] = world.goal_mass
    mujoco.mj_setConst(model, mujoco.MjData(model))

    def sensor(name: str) -> int:
        return int(model.sensor(name).adr[0])

    def free(name: str) -> int:
        return int(model.jnt_qposadr[model.body(name).jntadr[0]])

    return FigureTwin(
        figure=figure,
        model=model,
        state=_settled(model),
        qpos=np.array([model.joint(name).qposadr[0] for name in figure.names]),
        dof=np.array([model.joint(name).dofadr[0] for name in figure.names]),
        actuator=np.array([model.actuator(name).id for name in figure.names]),
        root=free(figure.root),
        goal=None if figure.goal == POINT else free(figure.goal),
        position={name: sensor(f"O{name}") for name in watched},
        velocity={name: sensor(f"V{name}") for name in watched},
        ahead=sensor("ahead"),
        unsafe=sensor("unsafe"),
        support=sensor("support"),
    )


def _check(spec: mujoco.MjSpec, figure: Figure, where: str) -> None:
    def need(kind: str, found: object, name: str) -> None:
        if found is None:
            raise FileError(f"no {kind} named {name!r}, which {figure.path} needs", where)

    for name in figure.names:
        need("joint", spec.joint(name), name)
        for kind, found in (("body", spec.body), ("joint", spec.joint)):
            need(kind, found(f"drive_{name}"), f"drive_{name}")
        need("tendon", spec.tendon(name), name)
        need("actuator", spec.actuator(name), name)
    free = [figure.root] if figure.goal == POINT else [figure.root, figure.goal]
    for name in dict.fromkeys((*free, figure.heading, *figure.objects)):
        need("body", spec.body(name), name)
    for name in free:
        joints = spec.body(name).joints
        if not joints or joints[0].type != mujoco.mjtJoint.mjJNT_FREE:
            raise FileError(f"body {name!r} has no free joint; {figure.path} has it move freely", where)
    for name in ("unsafe", "support"):
        need("contact sensor", spec.sensor(name), name)
    if not spec.keys:
        raise FileError("no keyframe; expected one with the figure standing", where)


def _watch(spec: mujoco.MjSpec, name: str, body: str, kind: mujoco.mjtSensor) -> None:
    """Add a sensor of a body: of the frame at its centre of mass, or for directions of its own frame."""
    axis = kind == mujoco.mjtSensor.mjSENS_FRAMEXAXIS
    frame = mujoco.mjtObj.mjOBJ_XBODY if axis else mujoco.mjtObj.mjOBJ_BODY
    spec.add_sensor(name=name, type=kind, objtype=frame, objname=body)


def _settled(model: mujoco.MjModel) -> NDArray[np.float64]:
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(round(_SETTLE_TIME / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return state_of(model, data)
