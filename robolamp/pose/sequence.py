"""Sequences: gestures, pauses and hops one after the other, in one run."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.controller.controller_file import Controller, check_goal_time, load_controller, time_for
from robolamp.controller.goal_pilot import GoalPilot
from robolamp.controller.pilot import Pilot, PilotStep
from robolamp.ease import MINIMUM_JERK
from robolamp.errors import FileError
from robolamp.files import Table, kind_of, read_text, read_toml
from robolamp.lamp import Lamp
from robolamp.pose.gesture import LONGEST, MOST_LOOPS, PERIOD, QUICKEST, SLOWEST, Frame, Gesture, altered, check_length
from robolamp.pose.gesture_file import find_gesture, legal_name, load_gesture
from robolamp.signals import Interventions, Observation

Array = NDArray[np.float64]

FOLDER = "sim/lamp/sequences"
"""Where the lamp's sequences are."""

MOVE = 1.0
"""Time to the neutral pose before a hop and after one [s]: the widest way is 1 rad, at 1.9 rad/s."""

HOLD = 0.5
"""Time that it stands there before a hop [s]: as after the loop's soft start."""

_FURTHEST = 5.0  # a goal [m], as on the command line


@dataclass(frozen=True)
class Hop:
    """A controller's part of a sequence.

    Attributes:
        controller: What drives.
        goal: Commanded distance [m].
        duration: How long it drives [s].
        goal_time: Commanded time to take for the way [s]; None: none is commanded.
    """

    controller: Controller
    goal: float
    duration: float
    goal_time: float | None = None


@dataclass(frozen=True)
class Sequence:
    """What is played in one run, torque on from the first act to the last.

    Attributes:
        name: Its name.
        acts: Gestures (a pause is one that stays) and hops.
        period: Time from goal to goal [s].
        source: The text of its file.
        path: That file, for messages.
    """

    name: str
    acts: tuple[Gesture | Hop, ...]
    period: float = PERIOD
    source: str = field(default="", repr=False)
    path: str = ""

    @property
    def goal(self) -> float:
        """How far all hops go together [m]; NaN: there are none."""
        hops = [act.goal for act in self.acts if isinstance(act, Hop)]
        return sum(hops) if hops else math.nan

    @property
    def planned(self) -> bool:
        """Whether every goal is known before."""
        return not any(isinstance(act, Hop) for act in self.acts)

    @property
    def parts(self) -> list[Gesture | Hop]:
        """The acts with what is between them: to a hop and from one the lamp goes through its neutral pose."""
        parts: list[Gesture | Hop] = []
        for act in self.acts:
            if parts and isinstance(act, Hop):
                parts.append(_neutral(act.controller.joints, HOLD))
            elif parts and isinstance(parts[-1], Hop):
                parts.append(_neutral(act.joints if isinstance(act, Gesture) else act.controller.joints, 0.0))
            parts.append(act)
        return parts

    def ticks(self, part: Gesture | Hop) -> int:
        """Return how many ticks a part takes; the last one is at its end."""
        return math.ceil(part.duration / self.period - 1e-9) + 1

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return sum(map(self.ticks, self.parts)) * self.period

    @property
    def texts(self) -> Mapping[str, str]:
        """What a log keeps of it: its text, and as JSON those of the files that it names."""
        acts = [
            {"gesture": act.name, "text": act.source}
            if isinstance(act, Gesture)
            else {"controller": act.controller.name, "text": act.controller.source}
            for act in self.acts
        ]
        return {"sequence": self.source, "sequence_acts": json.dumps(acts)}

    def pilot(self, lamp: Lamp) -> SequencePilot:
        """Return what plays it in the loop, everything compiled.

        Args:
            lamp: Limits and slew.

        Raises:
            ExpressionError: A controller needs a signal that the lamp has not.
        """
        return SequencePilot(self, lamp)


def _neutral(joints: tuple[str, ...], hold: float) -> Gesture:
    frames = [Frame(MOVE, np.zeros(len(joints)), MINIMUM_JERK)]
    if hold:
        frames.append(Frame(MOVE + hold, np.zeros(len(joints)), MINIMUM_JERK))
    return Gesture("to the neutral pose", joints, tuple(frames))


class SequencePilot:
    """Plays a sequence in the loop, each part from the goals that the one before left.

    Args:
        sequence: What to play.
        lamp: Limits and slew.

    Raises:
        ExpressionError: A controller needs a signal that the lamp has not.
    """

    def __init__(self, sequence: Sequence, lamp: Lamp) -> None:
        self._lamp = lamp
        self.control_period = sequence.period
        self._parts = sequence.parts
        self._pilots = [
            Pilot(part.controller, lamp, part.goal, part.goal_time) if isinstance(part, Hop) else None
            for part in self._parts
        ]
        lengths = [sequence.ticks(part) for part in self._parts]
        self._begins = np.concatenate([[0], np.cumsum(lengths)[:-1]])  # [ticks]
        named = [pilot.terminals for pilot in self._pilots if pilot]
        self.terminals: tuple[str, ...] = max(named, key=len, default=())
        self._goal = np.zeros(len(lamp.joints))
        self._at = -1
        self._pilot: Pilot | GoalPilot | None = None
        self._last: PilotStep | None = None  # of the part that is played
        self._hops, self._interventions = 0, Interventions()  # of the parts before

    def step(self, observation: Observation, time: float) -> PilotStep:
        """Return the goals for one tick.

        Args:
            observation: What was measured.
            time: Since the run began, by the schedule [s].
        """
        tick = round(time / self.control_period)
        at = int(np.searchsorted(self._begins, tick, side="right")) - 1
        if at != self._at or self._pilot is None:
            self._begin(at)
        assert self._pilot is not None
        step = self._pilot.step(observation, time - float(self._begins[at]) * self.control_period)
        self._last, self._goal = step, step.goal
        inputs = np.full(len(self.terminals), np.nan)
        inputs[: len(step.inputs)] = step.inputs
        return PilotStep(
            inputs=inputs,
            outputs=step.outputs,
            goal=step.goal,
            hops=self._hops + step.hops,
            contact=step.contact,
            interventions=_sum(self._interventions, step.interventions),
        )

    def _begin(self, at: int) -> None:
        if self._last is not None:
            self._hops += self._last.hops
            self._interventions = _sum(self._interventions, self._last.interventions)
            self._last = None
        self._at, part, pilot = at, self._parts[at], self._pilots[at]
        if pilot is not None:
            pilot.reset(self._goal)
            self._pilot = pilot
        else:
            assert isinstance(part, Gesture)
            self._pilot = GoalPilot(part.motion(self._goal), self._lamp, self.control_period, self._goal)


def _sum(one: Interventions, other: Interventions) -> Interventions:
    return Interventions(
        one.not_finite + other.not_finite, one.limited + other.limited, one.slewed + other.slewed
    )  # fmt: skip


def load_sequence(name: str, lamp: Lamp, assets: Assets) -> Sequence:
    """Read a sequence file, and the gestures and controllers that it names.

    Args:
        name: A path, or the name of a shipped sequence.
        lamp: The lamp that plays it.
        assets: Where gestures and controllers are.

    Raises:
        FileError: A file is missing or malformed, or the controllers' periods differ.
        ExpressionError: A controller does not parse, or needs what the lamp cannot supply.
    """
    path = assets.named(name, FOLDER, "sequence")
    where = str(path)
    root = Table(read_toml(path), where)
    root.integer("schema", 1, 1)
    title = legal_name(root)
    acts = tuple(_act(table, path.parent, lamp, assets) for table in root.tables("act"))
    root.done()
    periods = {act.controller.control_period for act in acts if isinstance(act, Hop)}
    if len(periods) > 1:
        said = ", ".join(f"{period:g}" for period in sorted(periods))
        raise FileError(f"its controllers have control periods of {said} s; expected the same for all", where)
    sequence = Sequence(title, acts, periods.pop() if periods else PERIOD, read_text(path), where)
    check_length(sequence.duration, where)
    return sequence


def _beside(name: str, folder: Path) -> str:
    """Return the file of that name that is beside the sequence; the name itself where there is none."""
    beside = folder / name
    return str(beside) if kind_of(beside) == "file" else name


def _act(table: Table, folder: Path, lamp: Lamp, assets: Assets) -> Gesture | Hop:
    kinds = [kind for kind in ("gesture", "controller", "pause") if kind in table]
    if len(kinds) != 1:
        found = " and ".join(kinds) or "none"
        raise table.fail("gesture", f"an act has one of gesture, controller, pause; found {found}")
    act: Gesture | Hop
    if kinds == ["pause"]:
        pause = table.number("pause", PERIOD, LONGEST, "s")
        act = Gesture("pause", lamp.names, (Frame(pause, np.full(len(lamp.joints), math.nan), MINIMUM_JERK),))
    elif kinds == ["gesture"]:
        speed = table.number("speed", SLOWEST, QUICKEST, default=None)
        loops = table.integer("loops", 1, MOST_LOOPS, default=None)
        path = find_gesture(_beside(table.text("gesture"), folder), assets)
        act = altered(load_gesture(path, lamp), speed, loops)
    else:
        path = assets.named(_beside(table.text("controller"), folder), "sim/lamp/controllers", "controller")
        goal = table.number("goal", 0.001, _FURTHEST, "m")
        act = Hop(
            load_controller(path, lamp, on_board=True),
            goal,
            table.number("duration", 0.5, LONGEST, "s", default=time_for(goal)),
            table.number("goal_time", 0.1, LONGEST, "s", default=None),
        )
        check_goal_time(act.controller, act.goal_time)
    table.done()
    return act
