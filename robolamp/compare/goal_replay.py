"""The replay: the twin is driven with a log's goal angles, at the times they were sent."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.controller.hop_counter import SignalLimits
from robolamp.controller.terminals import Signals
from robolamp.dynamixel.wire_time import wire_time
from robolamp.errors import FileError
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.signals import Command, Interventions, Tick
from robolamp.twin.judge import Outcome
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.twin_lamp import TwinLamp

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
        outcome: What the twin truly did from the start of phase "run" (hops, falls, travel).
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
    outcome: Outcome


def replay(run: Run, lamp: Lamp, calibration: Calibration, assets: Assets) -> Replay:
    """Drive the twin with a log's goal angles.

    A goal arrives at the twin's servos when its packet has passed the line, within a physics step too. The
    calibration's line delay, which stands for that time where there is no log, plays no part. A stage's duty limit
    holds for the twin's motors too.

    Args:
        run: The log.
        lamp: The lamp's description.
        calibration: The twin's numbers.
        assets: Where the model is.

    Raises:
        FileError: The log is of a lamp with other joints, or its duty limit is none.
        SafetyError: A logged goal is outside the lamp's limits.
    """
    if run.joints != lamp.names:
        raise FileError(f"is of joints {', '.join(run.joints)}; {lamp.path} has {', '.join(lamp.names)}", str(run.path))
    twin = TwinLamp(build(lamp, calibration, assets), duty=duty_of(run))
    origin = float(run.began[0])
    read = run.measured_at - origin
    commands = _commands(run, twin.twin)
    recorder = _Recorder(twin, origin)
    counter = _HopCounter(run, lamp)
    twin.open()
    _pose(twin, run.angle)
    twin.torque(True)
    recorder.record()
    ticks = []
    for index in range(run.index.size):
        if run.phase[index] == "run" and (index == 0 or run.phase[index - 1] != "run"):
            twin.start_judging()
        while commands and commands[0][0] < read[index]:
            at, goal = commands.popleft()
            recorder.advance(at)
            twin.command(Command(goal))
        recorder.advance(read[index])
        seen = twin.observe()
        seen.time += origin
        hops, contact = counter.count(index, seen.angle, seen.foot_force)
        began = float(run.began[index])
        ticks.append(
            Tick(
                index=int(run.index[index]),
                phase=str(run.phase[index]),
                scheduled=float(run.scheduled[index]),
                began=began,
                read_done=seen.time,
                write_done=float(run.write_done[index]),
                observation=seen,
                goal=run.goal[index],
                interventions=Interventions(),
                hops=hops,
                contact=contact,
            )
        )
    for at, goal in commands:
        recorder.advance(at)
        twin.command(Command(goal))
    recorder.advance(run.write_done[-1] - origin + run.control_period)
    outcome = twin.outcome
    twin.close()
    return recorder.replay(ticks, outcome)


def _commands(run: Run, twin: TwinModel) -> deque[tuple[float, Array]]:
    """Return when to command what, so that goals arrive at the servos when the log says [s, rad].

    A goal that arrives within a physics step is first mixed with the one before, weighted by the time that each holds
    in that step: rounded to whole steps, every tick of a run would be early or late by the same.
    """
    step = twin.timestep
    line = round(twin.line_delay / step) * step  # as the twin keeps it
    wire = wire_time("goals", len(run.joints), twin.lamp.bus_baud)  # write_done is when the packet was handed over
    arrival = np.maximum((run.write_done + wire - run.began[0] - line) / step, 0.0)
    commands: deque[tuple[float, Array]] = deque()
    before = run.goal[0]
    for goal, at in zip(run.goal, arrival.tolist(), strict=True):
        whole = math.floor(at)
        commands.append((whole * step, goal + (at - whole) * (before - goal)))
        commands.append(((whole + 1) * step, goal))
        before = goal
    return commands


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


def _pose(twin: TwinLamp, angle: Array) -> None:
    """Put the joints where the lamp's first readings found them; one that never answered stays neutral."""
    start = twin.body.angle.copy()
    for joint, readings in enumerate(angle.T):
        known = readings[np.isfinite(readings)]
        if known.size:
            start[joint] = known[0]
    twin.body.place(start)


class _HopCounter:
    """Counts the twin's hops with the lamp's own code, from the start of phase "run"."""

    def __init__(self, run: Run, lamp: Lamp) -> None:
        self._signals = Signals(1, len(lamp.joints), SignalLimits.of(lamp, run.control_period), ())
        self._run = run

    def count(self, index: int, angle: Array, force: float) -> tuple[int, bool]:
        """Return hops so far and whether the foot is on the ground, after one more tick."""
        if self._run.phase[index] == "run":
            self._signals.update(angle[None], np.array([force]), np.zeros(1))
        return int(self._signals.hops[0]), bool(self._signals.contact[0])


class _Recorder:
    """Steps the twin and keeps every physics step."""

    def __init__(self, twin: TwinLamp, origin: float) -> None:
        self._twin = twin
        self._origin = origin
        self._rows: list[Array] = []

    def record(self) -> None:
        body = self._twin.body
        self._rows.append(np.concatenate(([self._twin.time, *body.base, body.force], body.angle, body.data.qpos)))

    def advance(self, time: float) -> None:
        step = self._twin.twin.timestep
        while self._twin.time < time - step / 2:
            self._twin.advance_to(self._twin.time + step)
            self.record()

    def replay(self, ticks: Sequence[Tick], outcome: Outcome) -> Replay:
        rows, twin = np.array(self._rows), self._twin.twin
        joints = 5 + len(twin.qpos)
        return Replay(
            twin=twin,
            time=rows[:, 0] + self._origin,
            angle=rows[:, 5:joints],
            base_x=rows[:, 1],
            base_z=rows[:, 2],
            pitch=rows[:, 3],
            force=rows[:, 4] * twin.foot_gain,
            qpos=rows[:, joints:],
            ticks=ticks,
            outcome=outcome,
        )
