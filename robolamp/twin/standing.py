"""A lamp that moves where it stands: does it keep its balance, touch itself, or strain its servos?"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.errors import SafetyError
from robolamp.lamp import Lamp
from robolamp.signals import Command
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.lanes.lamp_lanes import SETTLE_TIME
from robolamp.twin.twin_lamp import TwinLamp

Array = NDArray[np.float64]

STRAIN_TIME = 2.0
"""Time constant over which torques are averaged [s]: a winding heats within seconds, as the loop's guard has it."""

MARGIN = 0.008
"""How far inside the foot's rim the floor must push at least [m]. Chosen: a lamp 2.5 % heavier at the head, on a desk
that slopes by 1 degree, keeps half of it."""

STRAIN = 0.5
"""Most of the stall torque that a motor may give on the average: at half the stall current the loop ends a run
(`robolamp.runtime.health.CURRENT`)."""

PEAK = 0.8
"""Most of the stall torque that it may give at any moment: beyond it a servo counts as overloaded."""

_FAR = 0.1  # distances of links beyond this are not looked for [m]
_FORCE = 1e-6  # a foot that presses less than this is in the air [N]


@dataclass(frozen=True)
class Standing:
    """What a lamp did that was sent goals where it stands, a row a tick, k of them.

    Attributes:
        time: Since the first goal, shape (k,) [s].
        goal: What was sent, shape (k, n) [rad].
        angle: True joint angles, shape (k, n) [rad].
        margin: How far inside the foot's rim the floor's push on it acts, the least since the tick before, shape (k,)
            [m]; 0: it tips, or is in the air.
        gap: The nearest that two links of the lamp come which no joint connects, shape (k,) [m]; negative: they meet.
        links: Their names, at the nearest.
        torque: The motors' torques, the largest since the tick before, shape (k, n) [Nm].
        strain: Running root mean square of those over `STRAIN_TIME`, shape (k, n) [Nm].
        stall: The motors' torques at a stall, shape (n,) [Nm].
        shift: How far each joint's angle puts the centre of mass ahead of where it is with that joint at 0, shape
            (k, n) [m].
        base_x: The base centre, from where it stood, shape (k,) [m].
        lean: Of the base from upright, positive forward, shape (k,) [rad].
        fell: When it fell [s]; NaN: it did not.
        qpos: MuJoCo's positions, shape (k, nq).
    """

    time: Array
    goal: Array
    angle: Array
    margin: Array
    gap: Array
    links: tuple[str, str]
    torque: Array
    strain: Array
    stall: Array
    shift: Array
    base_x: Array
    lean: Array
    fell: float
    qpos: Array


def stand(twin: TwinModel, goals: Array, period: float) -> Standing:
    """Send goals to a lamp that stands in the first of them.

    Args:
        twin: The lamp.
        goals: One row a tick, shape (k, n) [rad].
        period: Time between them [s].

    Raises:
        SafetyError: A goal is outside its joint's limits.
    """
    lamp = TwinLamp(twin)
    lamp.open()
    lamp.body.place(goals[0])
    lamp.torque(True)
    lamp.advance_to(SETTLE_TIME)
    lamp.start_judging()
    look = _Look(twin, lamp.body)
    share = -math.expm1(-twin.timestep / STRAIN_TIME)
    mean = np.zeros(len(twin.lamp.joints))
    steps = round(period / twin.timestep)
    start = lamp.body.base[0]
    rows = []
    for tick, goal in enumerate(goals):
        lamp.command(Command(goal))
        margin, most = math.inf, np.zeros(len(mean))
        for step in range(tick * steps, (tick + 1) * steps):
            lamp.advance_to(SETTLE_TIME + (step + 1) * twin.timestep)
            torque = np.abs(lamp.body.torque)
            margin, most = min(margin, look.margin()), np.maximum(most, torque)
            mean += share * (torque**2 - mean)
        base, qpos = lamp.body.base, lamp.body.data.qpos.copy()
        row = (margin, look.gap(), base[0] - start, base[2])
        rows.append((row, lamp.body.angle.copy(), most, np.sqrt(mean), look.shift(qpos), qpos))
    fall = float(lamp.outcome.fall_time[0]) if lamp.outcome.fallen[0] else math.nan
    lamp.close()
    single, angle, torque, strain, shift, qpos = (np.array(each) for each in zip(*rows, strict=True))
    return Standing(
        time=np.arange(len(goals), dtype=np.float64) * period,
        goal=goals,
        angle=angle,
        margin=single[:, 0],
        gap=single[:, 1],
        links=look.nearest,
        torque=torque,
        strain=strain,
        stall=twin.servos.torque_constant * twin.voltage / twin.servos.resistance,
        shift=shift,
        base_x=single[:, 2],
        lean=single[:, 3],
        fell=fall,
        qpos=qpos,
    )


def check_standing(standing: Standing, lamp: Lamp, where: str) -> None:
    """Refuse goals that would tip the lamp, let its links meet, or strain its servos.

    Args:
        standing: What the twin did.
        lamp: Its joints.
        where: What the goals are of, for the message.

    Raises:
        SafetyError: Names the first moment at which it would, and the joint that does it.
    """
    found: list[tuple[int, str]] = []
    for at in np.flatnonzero(standing.margin < MARGIN)[:1].tolist():
        shift = standing.shift[at]
        joint = lamp.names[int(np.argmax(shift * np.sign(shift.sum())))]
        inside, least = standing.margin[at] * 1e3, MARGIN * 1e3
        text = (
            f"it would tip: the floor would push {inside:.1f} mm inside the foot's rim, expected {least:g} mm or more"
        )
        found.append((at, f"{text}; {joint} puts its weight there"))
    for at in np.flatnonzero(standing.gap <= 0.0)[:1].tolist():
        joint = lamp.names[int(np.argmax(np.abs(standing.angle[at])))]
        found.append((at, f"{' and '.join(standing.links)} would meet; {joint} is turned the furthest"))
    for most, torque, what in ((PEAK, standing.torque, "peak"), (STRAIN, standing.strain, "mean over 2 s")):
        share = torque / standing.stall
        for at, joint in np.argwhere(share > most)[:1].tolist():
            gives = f"{share[at, joint]:.0%} of its stall torque ({what}), expected {most:.0%} at most"
            found.append((at, f"{lamp.names[joint]} would strain its servo: {gives}"))
    if found:
        at, text = min(found)
        raise SafetyError(f"at {standing.time[at]:.2f} s {text}", where)


class _Look:
    """Looks at one lamp: where the floor pushes it, and how near its links are to one another."""

    def __init__(self, twin: TwinModel, body: Body) -> None:
        model = body.model
        self._twin, self._model, self._data = twin, model, body.data
        self._other = mujoco.MjData(model)  # for poses that are only thought of
        self._floor, self._base = model.geom("floor").id, model.site("base").id
        self._force = np.zeros(6)
        solid = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] and model.geom_contype[geom]]
        order = {geom: self._links_below(model.geom_bodyid[geom]) for geom in solid}
        self._pairs = [pair for pair in itertools.combinations(solid, 2) if abs(order[pair[0]] - order[pair[1]]) > 1]
        self._smallest = math.inf
        self.nearest = ("", "")

    def _links_below(self, body: int) -> int:
        """Return how many joints of the lamp are between a body and the base."""
        named, count = {self._model.joint(name).bodyid[0] for name in self._twin.lamp.names}, 0
        while body:
            count += body in named
            body = int(self._model.body_parentid[body])
        return count

    def margin(self) -> float:
        """Return how far inside the foot's rim the floor's push acts [m]."""
        data, pushed, at = self._data, 0.0, np.zeros(2)
        for number in range(data.ncon):
            contact = data.contact[number]
            if self._floor in contact.geom:
                mujoco.mj_contactForce(self._model, data, number, self._force)
                pushed += self._force[0]
                at += self._force[0] * contact.pos[:2]
        if pushed < _FORCE:
            return 0.0
        away = math.dist(at / pushed, data.site_xpos[self._base, :2])
        return max(self._twin.foot_radius - away, 0.0)

    def gap(self) -> float:
        """Return the smallest distance of links that no joint connects [m]."""
        found = _FAR
        for one, other in self._pairs:
            distance = mujoco.mj_geomDistance(self._model, self._data, one, other, _FAR, None)
            found = min(found, distance)
            if distance < self._smallest:
                self._smallest = distance
                names = [self._model.body(self._model.geom_bodyid[geom]).name for geom in (one, other)]
                self.nearest = (names[0], names[1])
        return found

    def shift(self, qpos: Array) -> Array:
        """Return how far each joint's angle puts the centre of mass ahead, shape (n,) [m]."""
        whole = self._centre(qpos)
        without = []
        for address in self._twin.qpos:
            pose = qpos.copy()
            pose[address] = 0.0
            without.append(self._centre(pose))
        return whole - np.array(without)

    def _centre(self, qpos: Array) -> float:
        self._other.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._other)
        mujoco.mj_comPos(self._model, self._other)
        return float(self._other.subtree_com[self._model.body("base").id, 0])
