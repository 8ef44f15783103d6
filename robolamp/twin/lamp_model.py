"""The lamp's MuJoCo model: sim/ and a calibration, compiled."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import SERVO, Calibration
from robolamp.errors import FileError
from robolamp.lamp import Lamp
from robolamp.twin.actuators.encoders import Encoders
from robolamp.twin.actuators.gears import Gears, add_gears
from robolamp.twin.actuators.servo import ServoParameters, hold, set_motor
from robolamp.twin.bend import Bend
from robolamp.twin.model_file import load_spec

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pole:
    """A horizontal pole across the lamp's way, to get under (limbo) or over.

    Attributes:
        height: Of its lower edge above the floor [m].
        x: Distance ahead of where the lamp starts [m].
    """

    height: float
    x: float


POLE_RADIUS = 0.004
"""Of the bar [m]."""
_POLE_HALF_LENGTH = 0.16  # wider than the lamp can sidestep [m]
_POST_RADIUS = 0.002
_POST_HALF_LENGTH = 0.5  # down through the floor, which hides the rest: poles differ by where they are alone [m]
_SITE_MARGIN = 0.010  # the touch sensor's volume reaches further than contacts sink in [m]


@dataclass(frozen=True)
class TwinModel:
    """A compiled lamp and where its parts are.

    Attributes:
        lamp: The lamp's description.
        model: The MuJoCo model, without geoms that touch nothing and weigh nothing.
        dressed: Builds the same lamp with them.
        servos: The servos' parameters as compiled (bent, if it is).
        voltage: Supply voltage as compiled [V].
        line_delay: Time from the start of a tick to the goal's arrival at the servo [s].
        foot_gain: Foot sensor reading per true force.
        foot_noise: Standard deviation of each reading [N].
        seed: Of that noise.
        encoders: How the joints' encoders are off.
        qpos: Position address of each joint, shape (n,).
        dof: Degree of freedom of each joint, shape (n,).
        actuator: Actuator of each joint, shape (n,).
        gears: Where the joints' play and bending are.
        supply_resistance: Of the supply that all servos share [Ohm].
        foot_sensor: Address of the foot's touch sensor in `sensordata`.
        foot_radius: Radius of the round foot [m].
        head_site: Site in the middle of the head.
        head_size: Radius and half length of the head's collision cylinder [m].
        pole_sensor: Address of the pole's touch sensor in `sensordata`; None without a pole.
    """

    lamp: Lamp
    model: mujoco.MjModel
    dressed: Callable[[], TwinModel]
    servos: ServoParameters
    voltage: float
    line_delay: float
    foot_gain: float
    foot_noise: float
    seed: int
    encoders: Encoders
    qpos: NDArray[np.int64]
    dof: NDArray[np.int64]
    actuator: NDArray[np.int64]
    gears: Gears
    supply_resistance: float
    foot_sensor: int
    foot_radius: float
    head_site: int
    head_size: tuple[float, float]
    pole_sensor: int | None = None

    @cached_property
    def seen(self) -> mujoco.MjModel:
        """The model with all that is seen, for pictures; its positions are those of `model`."""
        return self.dressed().model

    @property
    def driven(self) -> Lamp:
        """What controllers drive."""
        return self.lamp

    @property
    def timestep(self) -> float:
        """Physics step [s]."""
        return float(self.model.opt.timestep)

    @property
    def p_gain(self) -> NDArray[np.float64]:
        """Position P Gain registers (84) of the servos, shape (n,)."""
        return np.array([joint.position_p_gain for joint in self.lamp.joints], float)

    @property
    def source(self) -> str:
        """The text of the lamp's description, and what a file without it stands for."""
        return f"{self.lamp.source}flight_time = {self.lamp.flight_time:g}\n"


def _bent(servos: ServoParameters, bend: Bend) -> ServoParameters:
    rubbing, load = bend.friction, bend.friction * bend.load_friction
    return replace(
        servos,
        torque_constant=servos.torque_constant * bend.strength,
        armature=servos.armature * bend.armature,
        delay=np.clip(servos.delay + bend.delay, SERVO["delay"].low, SERVO["delay"].high),
        viscous=servos.viscous * rubbing * bend.viscous,
        coulomb=servos.coulomb * rubbing * bend.coulomb,
        stribeck=servos.stribeck * rubbing * bend.stribeck,
        stribeck_velocity=servos.stribeck_velocity * bend.stribeck_velocity,
        load_motor=servos.load_motor * load,
        load_external=servos.load_external * load,
        load_external_stribeck=servos.load_external_stribeck * load,
    )


def _yielding(lamp: Lamp, calibration: Calibration, bend: Bend) -> tuple[Array, Array]:
    """Return the play [rad] and the stiffness [Nm/rad] of a bent lamp's joints, shape (n,) each."""
    play = np.array([calibration.joint(name, "backlash") for name in lamp.names])
    stiffness = calibration.lamp("arm_stiffness") if math.isnan(bend.stiffness) else bend.stiffness
    return np.where(np.isnan(bend.backlash), play, bend.backlash), np.full(len(play), stiffness)


def _raise_pole(spec: mujoco.MjSpec, pole: Pole) -> None:
    """Put a pole into a scene: a bar that every part of the lamp meets as it meets the floor, and two posts to see."""
    floor, length = spec.geom("floor"), _POLE_HALF_LENGTH
    body = spec.worldbody.add_body(name="pole", pos=[pole.x, 0.0, pole.height + POLE_RADIUS])
    body.explicitinertial, body.mass, body.ipos = True, 0.0, [0.0, 0.0, 0.0]  # it never moves
    lying = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]  # along y
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    body.add_geom(
        name="pole", type=capsule, size=[POLE_RADIUS, length, 0.0], quat=lying, rgba=[0.85, 0.25, 0.20, 1.0],
        contype=floor.contype, conaffinity=floor.conaffinity, condim=floor.condim, friction=floor.friction,
        solref=floor.solref,
    )  # fmt: skip
    for side in (-1.0, 1.0):
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[_POST_RADIUS, _POST_HALF_LENGTH, 0.0],
            pos=[0.0, side * length, -_POST_HALF_LENGTH],
            rgba=[0.35, 0.36, 0.38, 1.0], group=2, contype=0, conaffinity=0,
        )  # fmt: skip
    body.add_site(
        name="pole", type=capsule, size=[POLE_RADIUS + _SITE_MARGIN, length + _SITE_MARGIN, 0.0], quat=lying, group=4
    )
    spec.add_sensor(name="pole", type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="pole")


def _undress(spec: mujoco.MjSpec) -> None:
    """Take out what is there to be seen alone: geoms that meet nothing, in links whose mass does not depend on them."""
    named = {name for sensor in spec.sensors for name in (sensor.objname, sensor.refname)}
    for body in spec.bodies:
        for geom in body.geoms if body.explicitinertial or body.name == "world" else ():
            if not geom.contype and not geom.conaffinity and geom.name not in named:
                spec.delete(geom)
    worn = {geom.meshname for geom in spec.geoms}
    for mesh in spec.meshes:
        if mesh.name not in worn:
            spec.delete(mesh)


def build(
    lamp: Lamp,
    calibration: Calibration,
    assets: Assets,
    bend: Bend | None = None,
    *,
    timestep: float | None = None,
    pole: Pole | None = None,
    clamped: bool = False,
    looks: bool = False,
) -> TwinModel:
    """Compile the lamp's model with a calibration's numbers.

    Args:
        lamp: The lamp's description; names the model file.
        calibration: The numbers.
        assets: Where the model file is.
        bend: How this lamp differs from the calibrated one.
        timestep: Physics step [s]; None: the model's own.
        pole: A pole across its way; None: a free desk.
        clamped: Whether the base is clamped to the desk.
        looks: Whether it has the geoms that are there to be seen: `TwinModel.seen`. Without them it does the same, to
            the bit, and sooner.

    Raises:
        FileError: The model does not load, or lacks a joint, actuator, sensor or site that the lamp needs.
    """
    bend = bend or Bend()
    path = assets.path(lamp.model)
    spec = load_spec(path, timestep)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP  # see `robolamp.twin.actuators.gears`
    servos = _bent(ServoParameters.of(lamp, calibration), bend)
    voltage = calibration.lamp("supply_voltage") + bend.supply
    table = servos.table
    for index, joint in enumerate(lamp.joints):
        actuator = spec.actuator(joint.name)
        if actuator is None or spec.joint(joint.name) is None:
            raise FileError(f"no joint and actuator named {joint.name!r}, which {lamp.path} has", str(path))
        set_motor(actuator, table[index], joint.position_p_gain, voltage)
        hinge, offset = spec.joint(joint.name), calibration.joint(joint.name, "encoder_offset")
        hold(hinge)
        if offset:  # the model's angles are what the encoders read
            hinge.ref, hinge.range = offset, [bound + offset for bound in hinge.range]
    for kind, found, name in (
        ("sensor", spec.sensor("foot_force"), "foot_force"),
        ("site", spec.site("base"), "base"),
        ("site", spec.site("head"), "head"),
        ("geom", spec.geom("foot"), "foot"),
        ("geom", spec.geom("head"), "head"),
        ("geom", spec.geom("floor"), "floor"),
    ):
        if found is None:
            raise FileError(f"no {kind} named {name!r}, which a lamp's model needs", str(path))
    if pole is not None:
        _raise_pole(spec, pole)
    if clamped:
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="base",
            solref=[2.0 * spec.option.timestep, 1.0], solimp=[0.999, 0.9999, 0.001, 0.5, 2.0],
        )  # fmt: skip
    friction = calibration.lamp("floor_friction") * bend.floor_friction
    for geom in spec.geoms:
        if geom.name in ("floor", "foot"):
            geom.friction[0] = friction
            geom.solref[0] *= calibration.lamp("contact_softness")
    play, stiffness = _yielding(lamp, calibration, bend)
    add_gears(spec, lamp.names, play, stiffness)
    for geom in spec.geoms if bend.floor_softness != 1.0 else ():
        geom.solref[0] *= bend.floor_softness
    if bend.floor_tilt:
        gravity = float(np.linalg.norm(spec.option.gravity))
        spec.option.gravity = [-gravity * math.sin(bend.floor_tilt), 0.0, -gravity * math.cos(bend.floor_tilt)]
    if not looks:
        _undress(spec)
    model = spec.compile()
    for joint, own in zip(lamp.joints, np.broadcast_to(bend.link_mass, len(lamp.joints)), strict=True):
        link, body = calibration.joint(joint.name, "link_mass") * own, model.joint(joint.name).bodyid
        model.body_mass[body] *= link
        model.body_inertia[body] *= link
    scale = calibration.lamp("mass_scale") * bend.mass
    model.body_mass[:] *= scale
    model.body_inertia[:] *= scale
    model.body_ipos[model.body_mass > 0.0, 1] += bend.sideways
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return TwinModel(
        lamp=lamp,
        model=model,
        dressed=partial(
            build,
            lamp,
            calibration,
            assets,
            bend,
            timestep=timestep,
            pole=pole,
            clamped=clamped,
            looks=True,
        ),
        servos=servos,
        voltage=voltage,
        line_delay=calibration.lamp("line_delay"),
        foot_gain=calibration.lamp("foot_gain") * bend.foot_gain,
        foot_noise=bend.foot_noise,
        seed=bend.seed,
        encoders=Encoders.of(lamp, bend),
        qpos=np.array([model.joint(name).qposadr[0] for name in lamp.names]),
        dof=np.array([model.joint(name).dofadr[0] for name in lamp.names]),
        actuator=np.array([model.actuator(name).id for name in lamp.names]),
        gears=Gears.of(model, lamp.names, play, stiffness),
        supply_resistance=calibration.lamp("supply_resistance") + bend.resistance,
        foot_sensor=int(model.sensor("foot_force").adr[0]),
        foot_radius=float(model.geom("foot").size[0]),
        head_site=int(model.site("head").id),
        head_size=(float(model.geom("head").size[0]), float(model.geom("head").size[1])),
        pole_sensor=None if pole is None else int(model.sensor("pole").adr[0]),
    )


class Described(Protocol):
    """A compiled lamp or figure."""

    @property
    def source(self) -> str:
        """The text of its description."""
        ...

    @property
    def model(self) -> mujoco.MjModel:
        """Its MuJoCo model."""
        ...


def fingerprint(twins: Sequence[Described]) -> str:
    """Return the SHA-256 of lamps or figures: their descriptions, and their models as compiled."""
    digest = hashlib.sha256()
    for twin in twins:
        buffer = np.empty(mujoco.mj_sizeModel(twin.model), np.uint8)
        mujoco.mj_saveModel(twin.model, None, buffer)
        digest.update(twin.source.encode())
        digest.update(buffer.tobytes())
    return digest.hexdigest()
