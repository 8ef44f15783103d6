"""A bank of twins, each bent in its own way, that are all sent the same goals: what a lamp so bent would have done."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from robolamp.twin.engine import Variants, deal, state_of
from robolamp.twin.lamp_model import TwinModel
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.lanes.lamp_lanes import Lamps

Array = NDArray[np.float64]

SETTLE = 0.3
"""How long each twin stands with the first goals before the record begins [s]."""


@dataclass(frozen=True)
class Member:
    """One twin of a bank.

    Attributes:
        twin: The lamp; members differ in numbers only.
        late: How much later than it was sent a goal arrives [s].
        resistance: Of the supply, added to the calibrated one [Ohm]: its voltage falls with the current drawn.
        drain: By how much the supply falls as time goes [V/s].
        zero: True angle less the angle its servos report, shape (n,) [rad].
        slope: Of the desk, downhill ahead positive [rad].
        nudge: By how much its joints begin elsewhere than told, shape (n,) [rad].
    """

    twin: TwinModel
    late: float = 0.0
    resistance: float = 0.0
    drain: float = 0.0
    zero: Array = field(default_factory=lambda: np.zeros(0))
    slope: float = 0.0
    nudge: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Record:
    """What the members did, M physics steps.

    Attributes:
        time: On the clock of the goals, shape (M,) [s].
        angle: Joint angles as their servos would report them, not quantised, shape (M, members, n) [rad].
        current: Currents drawn from the supply, shape (M, members, n) [A].
        force: Readings of the foot sensor, shape (M, members) [N].
    """

    time: Array
    angle: Array
    current: Array
    force: Array


@dataclass(frozen=True)
class GoalSchedule:
    """What is played: goals and when they are sent.

    Attributes:
        begin: Where the record begins [s].
        end: Where it ends [s].
        powered: When the supply was last full, for a drain [s].
        pose: Joint angles at the beginning, as reported, shape (n,) [rad].
        hold: Goals before the first of `goal`, shape (n,) [rad].
        sent: When each goal reaches the servos, rising, shape (k,) [s].
        goal: Shape (k, n) [rad].
    """

    begin: float
    end: float
    powered: float
    pose: Array
    hold: Array
    sent: Array
    goal: Array


def play_bank(members: Sequence[Member], score: GoalSchedule, workers: int | None = None) -> Record:
    """Play goals on every member; the same to the bit for any number of workers.

    Args:
        members: The twins.
        score: What to play.
        workers: Threads; None: one for each core.
    """
    twins = [replace(each.twin, supply_resistance=each.twin.supply_resistance + each.resistance) for each in members]
    variants, every = Variants([twin.model for twin in twins]), np.arange(len(members))
    state = _start(twins[0], score)

    def work(share: slice) -> Record:
        drains = any(member.drain for member in members[share])
        return _Share(members[share], Lamps(twins, every[share], variants, state, gains=drains), score).play()

    parts, order = deal(len(members), workers, work)
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=1)[:, order]
        for name in ("angle", "current", "force")
    }
    return Record(time=parts[0].time, **joined)


def _start(twin: TwinModel, score: GoalSchedule) -> Array:
    body = Body(twin)
    body.place(score.pose)
    body.set_goal(score.hold)
    return state_of(body.model, body.data)


def goals_by_step(hold: Array, goal: Array, sent: Array, dt: float, steps: int) -> Array:
    """Return the goals in force in each physics step, shape (steps, n) [rad].

    One that arrives within a step is mixed with the one before, weighted by the time that each holds in that step.

    Args:
        hold: Goals before the first of `goal`, shape (n,) [rad].
        goal: Shape (k, n) [rad].
        sent: When each reaches the servos, from the first step's begin on, rising, shape (k,) [s].
        dt: Physics step [s].
        steps: How many.
    """
    goals = np.tile(hold, (steps, 1))
    for told, at in zip(goal, np.maximum(sent / dt, 0.0).tolist(), strict=True):
        whole = math.floor(at + 1e-6)
        if whole < steps:
            goals[whole] = told + max(at - whole, 0.0) * (goals[whole] - told)
            goals[whole + 1 :] = told
    return goals


class _Share:
    """The members of one worker."""

    def __init__(self, members: Sequence[Member], lamps: Lamps, score: GoalSchedule) -> None:
        twin = members[0].twin
        lanes, n = len(members), len(twin.qpos)
        self._twin, self._score, self._lamps, self._lanes = twin, score, lamps, np.arange(lanes)
        self._batch = lamps.batch
        gravity = twin.model.opt.gravity
        slope = np.array([member.slope for member in members])
        if slope.any():
            fall = -gravity[2]
            pull = np.column_stack([fall * np.sin(slope), np.zeros(lanes), -fall * np.cos(slope)])
            self._batch.expand("opt.gravity")[:] = pull
        self._zero = np.array([member.zero if member.zero.size else np.zeros(n) for member in members])
        self._nudge = np.array([member.nudge if member.nudge.size else np.zeros(n) for member in members])
        self._late = np.array([round(member.late / twin.timestep) for member in members])
        self._drain = np.array([member.drain for member in members])
        self._gain = np.array([member.twin.foot_gain for member in members])

    def play(self) -> Record:
        """Return the record of this share."""
        batch, twin, score, lanes = self._batch, self._twin, self._score, self._lanes
        motors, qpos = self._lamps.motors, self._lamps.qpos
        motors.place(qpos[:, twin.qpos] + self._zero + self._nudge)
        motors.forget(score.hold + self._zero)
        dt = twin.timestep
        settle, steps = round(SETTLE / dt), math.ceil((score.end - score.begin) / dt)
        goals = goals_by_step(
            score.hold, score.goal, score.sent - score.begin, dt, steps + max(int(-self._late.min()), 0)
        )
        full, n = motors.full.copy(), len(twin.qpos)
        angle, current = np.empty((steps, len(lanes), n)), np.empty((steps, len(lanes), n))
        force = np.empty((steps, len(lanes)))
        batch.forward()
        motors.held[:] = True  # while the foot comes to rest on the floor
        for step in range(-settle, steps):
            if step == -settle // 2:
                motors.held[:] = False
            if step >= 0:
                angle[step] = motors.angle - self._zero
                current[step] = motors.current
                force[step] = self._lamps.force
            motors.full[:] = full - (self._drain * (score.begin + step * dt - score.powered))[:, None]
            motors.goal[:] = goals[np.maximum(step - self._late, 0)] + self._zero
            self._lamps.step(lanes)
        return Record(
            time=score.begin + np.arange(steps, dtype=np.float64) * dt,
            angle=angle,
            current=current,
            force=force * self._gain,
        )
