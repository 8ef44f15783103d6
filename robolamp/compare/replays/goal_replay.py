"""The replay: the twin is driven with a log's goal angles, at the times they were sent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.controller.hop_counter import SignalLimits
from robolamp.controller.terminals import Signals
from robolamp.dynamixel.registers import RAD_PER_COUNT
from robolamp.dynamixel.wire_time import wire_time
from robolamp.errors import FileError
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.signals import Health, Observation, Tick
from robolamp.twin.engine import deal, state_of
from robolamp.twin.judges.lamp_judge import Judge
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.lanes.lamp_lanes import Lamps
from robolamp.twin.lanes.open_loop import goals_by_step
from robolamp.twin.sensor_model import measure_angle, measure_force

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Replay:
    """What the twin did, M physics steps. Times are on the log's clock [s].

    Attributes:
        twin: The compiled lamp.
        time: Shape (M,) [s].
        angle: True joint angles, shape (M, n) [rad].
        base_x: The base centre along the floor, shape (M,) [m].
        base_z: Its height, shape (M,) [m].
        pitch: Lean of the foot, shape (M,) [rad].
        force: Foot sensor reading, shape (M,) [N].
        qpos: MuJoCo's positions, shape (M, nq).
        ticks: The same run tick by tick, as the twin's sensors saw it.
        fell: Whether it fell after the start of phase "run".
    """

    twin: TwinModel
    time: Array
    angle: Array
    base_x: Array
    base_z: Array
    pitch: Array
    force: Array
    qpos: Array
    ticks: Sequence[Tick]
    fell: bool


@dataclass(frozen=True)
class Starts:
    """How replays differ that start a hair apart, k of them.

    Attributes:
        nudge: By how much their joints begin elsewhere than at the log's readings, shape (k, n) [rad].
        late: By how much later than the log says goals reach their servos, shape (k,) [s].
    """

    nudge: Array
    late: Array

    def part(self, share: slice) -> Starts:
        """Return some of them."""
        return Starts(self.nudge[share], self.late[share])


def replay(run: Run, lamp: Lamp, calibration: Calibration, assets: Assets) -> Replay:
    """Drive the twin with a log's goal angles; arguments and errors are those of `replays`."""
    return replays(run, lamp, calibration, assets)[0]


def replays(
    run: Run,
    lamp: Lamp,
    calibration: Calibration,
    assets: Assets,
    starts: Callable[[TwinModel], Starts] | None = None,
) -> tuple[Replay, ...]:
    """Drive twins that start a little apart with a log's goal angles.

    A goal arrives at a twin's servos when its packet has passed the line, within a physics step too. The
    calibration's line delay, which stands for that time where there is no log, plays no part. A stage's duty limit
    holds for the twins' motors too.

    Args:
        run: The log.
        lamp: The lamp's description.
        calibration: The twin's numbers.
        assets: Where the model is.
        starts: Says of the twin how each replay differs; without it there is one, which begins as the log says.

    Raises:
        FileError: The log is of a lamp with other joints, or its duty limit is none.
        SafetyError: A logged goal is outside the lamp's limits.
    """
    if run.joints != lamp.names:
        raise FileError(f"is of joints {', '.join(run.joints)}; {lamp.path} has {', '.join(lamp.names)}", str(run.path))
    duty = duty_of(run)
    for goal in run.goal:
        lamp.check_goal(goal)
    twin = build(lamp, calibration, assets)
    begun = starts(twin) if starts else Starts(np.zeros((1, len(lamp.joints))), np.zeros(1))
    parts, order = deal(len(begun.late), None, lambda share: _Share(run, twin, begun.part(share), duty).play())
    made = [each for part in parts for each in part]
    return tuple(made[place] for place in order)


def duty_of(run: Run) -> float:
    """Return the Goal PWM(100) that the stage of a run had set, 0 to 1; 1 where the log names none.

    Args:
        run: The log.

    Raises:
        FileError: It is no duty.
    """
    text = run.context.get("duty_limit", "1")
    try:
        duty = float(text)
    except ValueError:
        duty = 0.0
    if not 0.0 < duty <= 1.0:
        raise FileError(f"duty_limit is {text!r}; expected more than 0, up to 1", str(run.path))
    return duty


def _start(run: Run) -> Array:
    """Return the angles that the lamp's first readings found, shape (n,) [rad]; a joint that never answered is at 0."""
    start = np.zeros(len(run.joints))
    for joint, readings in enumerate(run.angle.T):
        known = readings[np.isfinite(readings)]
        if known.size:
            start[joint] = known[0]
    return start


@dataclass(frozen=True)
class _Ticks(Sequence[Tick]):
    """A replay's ticks, made when they are looked at: a long log has many, and there are many replays.

    Attributes:
        run: The log.
        time: When the sensors were read, shape (ticks,) [s].
        angle: What the encoders read, shape (ticks, n) [rad].
        velocity: Shape (ticks, n) [rad/s].
        current: Shape (ticks, n) [A].
        force: What the foot sensor read, shape (ticks,) [N].
        hops: Hops so far, shape (ticks,).
        contact: Whether the foot is on the ground, shape (ticks,).
        voltage: Of the supply [V].
    """

    run: Run
    time: Array
    angle: Array
    velocity: Array
    current: Array
    force: Array
    hops: NDArray[np.int64]
    contact: NDArray[np.bool_]
    voltage: float

    def __len__(self) -> int:
        return len(self.time)

    @overload
    def __getitem__(self, index: int) -> Tick: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Tick]: ...

    def __getitem__(self, index: int | slice) -> Tick | Sequence[Tick]:
        if isinstance(index, slice):
            return [self[row] for row in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(index)
        run, n = self.run, self.angle.shape[1]
        gap, seen = np.full(n, np.nan), float(self.time[index])
        return Tick(
            index=int(run.index[index]),
            phase=str(run.phase[index]),
            scheduled=float(run.scheduled[index]),
            began=float(run.began[index]),
            read_done=seen,
            write_done=float(run.write_done[index]),
            observation=Observation(
                time=seen,
                angle=self.angle[index],
                velocity=self.velocity[index],
                current=self.current[index],
                angle_age=np.zeros(n),
                foot_force=float(self.force[index]),
                foot_age=0.0,
                health=Health(np.full(n, self.voltage), gap, gap, np.ones(n, np.int64), np.zeros(n, np.int64)),
            ),
            goal=run.goal[index],
            hops=int(self.hops[index]),
            contact=bool(self.contact[index]),
        )


class _Share:
    """The twins of one thread."""

    def __init__(self, run: Run, twin: TwinModel, starts: Starts, duty: float) -> None:
        self._run, self._twin, self._starts = run, twin, starts
        body = Body(twin)
        lanes = np.zeros(len(starts.late), np.int64)
        self._lamps = Lamps([twin], lanes, states=state_of(body.model, body.data), gains=duty < 1.0)
        self._lamps.batch.forward()  # the first step's friction is that of standing there
        motors = self._lamps.motors
        motors.limit[:] = duty
        motors.place(_start(run) + starts.nudge)
        motors.goal[:] = motors.angle

    def play(self) -> list[Replay]:
        """Return what each twin did."""
        run, twin, lamps = self._run, self._twin, self._lamps
        dt, origin, lanes = twin.timestep, float(run.began[0]), lamps.count
        motors, every = lamps.motors, np.arange(lanes)
        # On the grid of physics steps: when each tick reads, and which goals are in force.
        read = np.maximum.accumulate(np.maximum(_steps(run.measured_at - origin, dt), 0))
        end = max(int(_steps(run.write_done[-1:] - origin + run.control_period, dt)[0]), int(read[-1]))
        wire = wire_time("goals", len(run.joints), twin.lamp.bus_baud)  # write_done is when the packet was handed over
        sent = [np.maximum(run.write_done + wire - origin + late, _line(twin)) for late in self._starts.late]
        goal = np.round(run.goal / RAD_PER_COUNT) * RAD_PER_COUNT  # registers hold whole counts
        goals = np.stack([goals_by_step(goal[0], goal, each, dt, end) for each in sent], axis=1)
        told = int(min(each[0] for each in sent) / dt)
        again = {int(read[row]): row for row in run.restarts.tolist()}
        starts = set(read[(run.phase == "run") & (np.append("", run.phase[:-1]) != "run")].tolist())
        judge = Judge(twin, np.zeros(lanes), 0.0)
        head, axis = head_of(lamps, twin)
        n = len(run.joints)
        angle, force = np.empty((end + 1, lanes, n)), np.empty((end + 1, lanes))
        qpos = np.empty((end + 1, lanes, twin.model.nq))
        velocity, current = np.empty((run.index.size, lanes, n)), np.empty((run.index.size, lanes, n))
        tick = 0
        for step in range(end + 1):
            angle[step], force[step], qpos[step] = motors.angle, lamps.force, lamps.qpos
            while tick < read.size and read[tick] == step:
                velocity[tick], current[tick] = motors.velocity, motors.current
                tick += 1
            if step == end:
                break
            if step in again:  # what the lamp did without its servos no twin replays: it goes on from where they are
                seen = run.angle[again[step]]
                motors.turn(np.where(np.isfinite(seen), seen + self._starts.nudge, motors.angle))
            if step in starts:
                judge = Judge(twin, np.zeros(lanes), 0.0)
                judge.begin(lamps.qpos[:, 0])
            if step >= told:
                motors.goal[:] = goals[step]
            lamps.step(every)
            judge.step(every, lamps.qpos, lamps.force, head, axis)
        pressed = measure_force(force[read], twin.foot_gain)
        seen = measure_angle(angle[read])
        hops, contact = _count(run, twin.lamp, seen, pressed)
        time = origin + np.arange(end + 1, dtype=np.float64) * dt
        fell = ~np.isnan(judge.fall_time)
        return [
            Replay(
                twin=twin,
                time=time,
                angle=angle[:, lane],
                base_x=qpos[:, lane, 0],
                base_z=qpos[:, lane, 2],
                pitch=_pitch(qpos[:, lane]),
                force=force[:, lane] * twin.foot_gain,
                qpos=qpos[:, lane],
                ticks=_Ticks(
                    run,
                    time[read],
                    seen[:, lane],
                    velocity[:, lane],
                    current[:, lane],
                    pressed[:, lane],
                    hops[:, lane],
                    contact[:, lane],
                    twin.voltage,
                ),
                fell=bool(fell[lane]),
            )
            for lane in range(lanes)
        ]


def head_of(lamps: Lamps, twin: TwinModel) -> tuple[Array, Array]:
    """Return where lamps' heads are for `Judge.step`: height and vertical part of the axis, live, shape (k,) each.

    Args:
        lamps: The lamps.
        twin: What they are of.
    """
    sites, axes = lamps.batch.bind("site_xpos"), lamps.batch.bind("site_xmat").reshape(lamps.count, -1, 9)
    return sites[:, twin.head_site, 2], axes[:, twin.head_site, 8]


def _pitch(qpos: Array) -> Array:
    """Return the foot's lean along positions, shape (m,) [rad]: angle of its axis in the x-z plane."""
    w, x, y, z = qpos[:, 3:7].T
    return np.arctan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y))


def _count(run: Run, lamp: Lamp, angle: Array, force: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Count twins' hops with the lamp's own code, from the start of phase "run".

    Args:
        run: The log.
        lamp: Tells what a hop is.
        angle: What their encoders read, shape (ticks, k, n) [rad].
        force: What their foot sensors read, shape (ticks, k) [N].

    Returns:
        Hops so far and whether the foot is on the ground, shape (ticks, k) each.
    """
    lanes = force.shape[1]
    signals, nowhere = Signals(lanes, len(lamp.joints), SignalLimits.of(lamp, run.control_period), ()), np.zeros(lanes)
    hops, contact = np.empty(force.shape, np.int64), np.empty(force.shape, np.bool_)
    for tick, phase in enumerate(run.phase):
        if phase == "run":
            signals.update(angle[tick], force[tick], nowhere)
        hops[tick], contact[tick] = signals.hops, signals.contact
    return hops, contact


def _line(twin: TwinModel) -> float:
    """Return the line's delay as the twin keeps it [s]."""
    return round(twin.line_delay / twin.timestep) * twin.timestep


def _steps(time: Array, dt: float) -> NDArray[np.int64]:
    """Return the physics steps that are nearest to times from the begin on [s]."""
    return np.ceil(time / dt - 0.5).astype(np.int64)
