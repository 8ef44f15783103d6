"""Gestures: a few key frames, and the motion through them."""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple

import numpy as np
import tomlkit
from numpy.typing import NDArray

from robolamp.controller.goal_pilot import GoalPilot
from robolamp.ease import EASES
from robolamp.errors import FileError, SafetyError
from robolamp.lamp import Lamp

Array = NDArray[np.float64]

PERIOD = 0.02
"""Time from goal to goal [s]: 50 Hz, as controllers have it unless their files say otherwise."""

LONGEST = 600.0
"""Longest time that a gesture or a sequence may take, loops and all [s]: as long as a controller may drive."""

MOST_LOOPS = 10_000
"""Most times over that a gesture may be played."""

SLOWEST, QUICKEST = 0.05, 20.0
"""How much slower and faster than written a gesture may be played: chosen; the joints' slew limits come sooner."""

_ROUNDING = 1e-9  # share by which a speed on its limit may be above it


@dataclass(frozen=True)
class Frame:
    """A key frame: a pose and when it is reached.

    Attributes:
        time: Since the gesture began, at speed 1 [s].
        pose: Joint angles, shape (n,) [rad]; NaN: the joint stays where the frame before left it.
        ease: How the lamp gets there from the frame before, one of `robolamp.ease.EASES`.
    """

    time: float
    pose: Array
    ease: str


class Turn(NamedTuple):
    """How fast a joint turns on the way to a frame.

    Attributes:
        time: When it is fastest, since the gesture began [s].
        joint: Which joint.
        speed: [rad/s].
    """

    time: float
    joint: int
    speed: float


@dataclass(frozen=True)
class Gesture:
    """A short motion of key frames. It begins wherever the lamp is.

    Attributes:
        name: Its name.
        joints: The joints' names, from the foot up.
        frames: At least one, their times rising from more than 0.
        says: What a person is to see in it.
        loops: How many times over it is played.
        speed: How much faster than written.
        source: The text of its file; empty for one that was never in a file.
        path: That file, for messages.
    """

    name: str
    joints: tuple[str, ...]
    frames: tuple[Frame, ...]
    says: str = ""
    loops: int = 1
    speed: float = 1.0
    source: str = field(default="", repr=False)
    path: str = ""
    goal: ClassVar[float] = math.nan  # it goes nowhere

    @property
    def once(self) -> float:
        """How long it takes once over [s]."""
        return self.frames[-1].time / self.speed

    @property
    def duration(self) -> float:
        """How long it takes, all loops [s]."""
        return self.loops * self.once

    @property
    def planned(self) -> bool:
        """Whether every goal is known before."""
        return True

    @property
    def texts(self) -> Mapping[str, str]:
        """What a log keeps of it."""
        return {"gesture": self.source}

    def motion(self, start: Array | None = None) -> Motion:
        """Return the motion through its frames.

        Args:
            start: Where the joints are at the beginning, shape (n,) [rad]; None: in the neutral pose.
        """
        return Motion(self, np.zeros(len(self.joints)) if start is None else start)

    def pilot(self, lamp: Lamp) -> GoalPilot:
        """Return what plays it in the loop, from the neutral pose.

        Args:
            lamp: Limits and slew.
        """
        return GoalPilot(self.motion(), lamp, PERIOD)


class Motion:
    """A gesture's motion from a given pose: goals as a function of time.

    Args:
        gesture: The gesture.
        start: Where the joints are at the beginning, shape (n,) [rad].
    """

    def __init__(self, gesture: Gesture, start: Array) -> None:
        self._gesture = gesture
        self._times = [0.0, *(frame.time for frame in gesture.frames)]
        first = self._poses(start)
        self._first, self._again = first, self._poses(first[-1])

    def _poses(self, start: Array) -> list[Array]:
        poses = [start]
        for frame in self._gesture.frames:
            poses.append(np.where(np.isnan(frame.pose), poses[-1], frame.pose))
        return poses

    @property
    def end(self) -> Array:
        """Where it ends, shape (n,) [rad]."""
        return self._first[-1]

    def __call__(self, time: float) -> Array:
        """Return the goals at a time since it began [s], shape (n,) [rad]; before and after it, its ends."""
        gesture, length = self._gesture, self._times[-1]
        loop, at = divmod(max(time, 0.0) * gesture.speed, length)
        if loop >= gesture.loops:
            return self.end
        poses = self._again if loop else self._first
        after = bisect.bisect_right(self._times, at)
        begin, end = self._times[after - 1], self._times[after]
        share = EASES[gesture.frames[after - 1].ease]((at - begin) / (end - begin))
        return poses[after - 1] + share * (poses[after] - poses[after - 1])

    def samples(self, period: float = PERIOD) -> Array:
        """Return the goals at each tick from 0 to the end, shape (k, n) [rad].

        Args:
            period: Between ticks [s].
        """
        count = math.ceil(self._gesture.duration / period - _ROUNDING)
        return np.array([self(tick * period) for tick in range(count + 1)])

    def turns(self) -> list[Turn]:
        """Return how fast each joint turns on the way to each frame, the first time over and every other."""
        gesture, found = self._gesture, []
        for loop, poses in enumerate((self._first, self._again)[: gesture.loops]):
            for index, frame in enumerate(gesture.frames):
                length = (frame.time - self._times[index]) / gesture.speed
                middle = loop * gesture.once + self._times[index] / gesture.speed + length / 2
                fastest = np.abs(poses[index + 1] - poses[index]) * EASES[frame.ease].fastest / length
                found += [Turn(middle, joint, float(speed)) for joint, speed in enumerate(fastest)]
        return found


def check_slew(gesture: Gesture, lamp: Lamp, start: Array | None = None) -> None:
    """Refuse a gesture that asks a joint to turn faster than its slew limit.

    Args:
        gesture: The gesture.
        lamp: Its limits.
        start: Where the joints are at the beginning, shape (n,) [rad]; None: in the neutral pose.

    Raises:
        SafetyError: Names the joint, the moment and the speed of the first that does.
    """
    for turn in gesture.motion(start).turns():
        joint = lamp.joints[turn.joint]
        if turn.speed > joint.slew * (1.0 + _ROUNDING):
            raise SafetyError(
                f"at {turn.time:.2f} s {joint.name} would turn at {turn.speed:.1f} rad/s; its slew limit in "
                f"{lamp.path.name} is {joint.slew:g} rad/s",
                gesture.path or gesture.name,
            )


def altered(gesture: Gesture, speed: float | None = None, loops: int | None = None) -> Gesture:
    """Return a gesture at another speed or so many times over, its text with it.

    Args:
        gesture: The gesture.
        speed: How much faster than written; None: as its file has it.
        loops: How many times over; None: as its file has it.

    Raises:
        FileError: It would take too long.
    """
    document = tomlkit.parse(gesture.source)
    for key, value in (("speed", speed), ("loops", loops)):
        if value is not None:
            document[key] = value
            gesture = replace(gesture, **{key: value})
    check_length(gesture.duration, gesture.path or gesture.name)
    return replace(gesture, source=tomlkit.dumps(document))


def check_length(duration: float, where: str) -> None:
    """Refuse what takes too long.

    Args:
        duration: How long it takes [s].
        where: The file, for the message.

    Raises:
        FileError: That is longer than `LONGEST`.
    """
    if duration > LONGEST:
        raise FileError(f"takes {duration:.0f} s with loops and speed; expected {LONGEST:g} s at most", where)
