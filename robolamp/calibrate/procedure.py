"""The procedure: which recordings are made of a lamp, in which order, and what a person does for each with their hands.

The base is clamped first, so that each joint moves alone against known gravity; then the lamp stands and hops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from robolamp.calibrate.excitations import (
    Excitation,
    Signal,
    chirp,
    ramp,
    sine_of_square,
    steps,
    still,
)
from robolamp.lamp import Lamp

MARGIN = 0.85
"""Share of a joint's range that an excitation uses: the rest is for its overshoot."""

_STANDING = 0.12  # share of the range that a lamp that stands free may be swung without tipping or hopping
_FASTEST = 3.0  # speed of a chirp: a third of a servo's at no load, so that it does not heat [rad/s]
_LIMP = 2.0  # how long a drop is watched [s]

CLAMP = "Clamp the base to the table with the foot flat, so that the whole arm is free and nothing is in its way."
STAND = "Take the clamp off. Stand the lamp upright on a bare desk, with 40 cm of room ahead and a hand near its plug."
WEIGH = "Weigh the whole lamp, its cables lying beside the scale."
HANDS_OFF = "Leave everything as it is."
LET_DROP = "Leave the clamp on and keep your hands away: the arm is raised, let go, and swings down by itself."


@dataclass(frozen=True)
class Step:
    """One recording of the procedure.

    Attributes:
        name: Of the recording; a file name without suffix.
        hands: What the person does before it, in a sentence or two.
        shows: What the recording is for.
        clamped: Whether the base is clamped.
        p_gain: Position P Gain register (84) of every servo; None: as lamp.toml has it.
        excitation: What is played; None: a controller.
        drop: Pose from which all joints are let go at the end, and watched [rad]; None: a soft landing.
        limp: How long they are watched then [s].
        controller: Name of a shipped controller, where one drives.
        goal: Where that is sent [m].
    """

    name: str
    hands: str
    shows: str
    clamped: bool
    p_gain: int | None = None
    excitation: Excitation | None = None
    drop: tuple[float, ...] | None = None
    limp: float = 0.0
    controller: str = ""
    goal: float = 0.0

    def lamp(self, lamp: Lamp) -> Lamp:
        """Return the lamp as this step drives it: its P gain, and the pose that its joints are left in."""
        rest = self.drop or [joint.rest for joint in lamp.joints]
        return replace(
            lamp,
            joints=tuple(
                replace(joint, position_p_gain=self.p_gain or joint.position_p_gain, rest=angle)
                for joint, angle in zip(lamp.joints, rest, strict=True)
            ),
        )

    @property
    def duration(self) -> float:
        """Length of its run phase [s]."""
        return self.excitation.duration if self.excitation else 4.0


@dataclass(frozen=True)
class _Bench:
    """Makes excitations for one lamp."""

    lamp: Lamp
    middle: np.ndarray = field(init=False)
    swing: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        lower, upper = self.lamp.lower, self.lamp.upper
        object.__setattr__(self, "middle", (lower + upper) / 2)
        object.__setattr__(self, "swing", MARGIN * (upper - lower) / 2)

    def play(self, signals: Sequence[Signal], duration: float, *, share: float = 1.0) -> Excitation:
        return Excitation(tuple(signals), self.middle, share * self.swing, duration)

    def alone(self, joint: int, signal: Signal, duration: float) -> Excitation:
        return self.play([signal if index == joint else still() for index in range(len(self.lamp.joints))], duration)

    def pose(self, *shares: float) -> tuple[float, ...]:
        """Return a pose by shares of each joint's swing; joints beyond those given are in the middle."""
        padded = np.resize(np.array(shares), len(self.lamp.joints))
        return tuple((self.middle + self.swing * padded).tolist())


def procedure(lamp: Lamp) -> tuple[Step, ...]:
    """Return the steps of calibrating a lamp, in the order in which they are recorded.

    Args:
        lamp: Its joints and limits.
    """
    bench, joints = _Bench(lamp), range(len(lamp.joints))
    made: list[Step] = []

    def clamped(name: str, shows: str, gain: int, excitation: Excitation) -> None:
        made.append(Step(name, CLAMP if not made else HANDS_OFF, shows, True, gain, excitation))

    clamped(
        "ramps", "friction at low speed and under load, and where the joints' zeros are", 400,
        bench.play([ramp(4.0 + index, 0.4 * index) for index in joints], 9.0),
    )  # fmt: skip
    for index, joint in enumerate(lamp.joints):
        fastest = _FASTEST / float(bench.swing[index])
        clamped(
            f"chirp-{joint.name}",
            f"speed constant and inertia of the {joint.name}",
            800,
            bench.alone(index, chirp(0.4, 3.5, 5.0, fastest), 5.6),
        )
    clamped(
        "squares", "all joints at once: how they load one another", 400,
        bench.play([sine_of_square(0.9 + 0.35 * index) for index in joints], 6.0, share=0.8),
    )  # fmt: skip
    clamped(
        "steps-soft", "delay, and how the gain turns an error into voltage", 200,
        bench.play([steps(0.55 + 0.09 * index, 3 * index) for index in joints], 6.0, share=0.7),
    )  # fmt: skip
    clamped(
        "steps-firm", "the same at the gain that the lamp hops with; saturated voltage", 800,
        bench.play([steps(0.45 + 0.07 * index, 4 * index + 1) for index in joints], 5.0, share=0.7),
    )  # fmt: skip
    for number, shares in enumerate([(-0.2, -0.9, -0.2), (0.9, -0.6, -0.8), (0.9, 0.3, 0.9)], 1):
        made.append(
            Step(
                f"drop-{number}",
                LET_DROP,
                "torque constant apart from resistance: only here is the winding open",
                True,
                800,
                bench.play([still() for _ in joints], 1.2),
                bench.pose(*shares),
                _LIMP,
            )
        )
    made.append(
        Step(
            "nod",
            STAND,
            "gain of the foot sensor: it carries the lamp's weight, at rest and in motion",
            False,
            800,
            Excitation(
                tuple(chirp(0.3, 2.0, 4.0, 6.0) if index == len(joints) - 1 else still() for index in joints),
                0.0 * bench.middle,
                _STANDING * bench.swing,
                5.0,
            ),
        )
    )
    for goal in (0.15, 0.30):
        made.append(
            Step(
                f"hop-{round(goal * 100)}cm",
                "Mark with tape where the front of the base stands. When it has hopped, measure how far it went.",
                "softness of the ground contact and friction of the floor, from flight times and length of the hop",
                False,
                controller="hop-counting",
                goal=goal,
            )
        )
    return tuple(made)
