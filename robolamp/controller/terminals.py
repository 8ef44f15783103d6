"""Terminals: the signals that controllers read, derived from what was measured by ONE piece of code.

`Signals` runs over many lanes in the twin and over one lane on the lamp: a controller meets the same numbers in both.
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.hop_counter import HopCounter, SignalLimits
from robolamp.controller.odometry import Odometry
from robolamp.errors import ExpressionError
from robolamp.figure import POINT, Driven, Figure
from robolamp.signals import Way

WAY = ("way", "way_left", "way_stderr")
"""Terminals of the odometer [m]: how far the lamp has come by its own measure, what is left to the goal, and the
standard error of both."""

FOOT_WINDOW = ("foot_mean", "foot_contact")
"""What the odometer is learnt from beside terminals: mean floor force [N] of the last tick, and share of it on the
ground."""


def on_board_terminals(joints: int, *, odometer: bool = True) -> tuple[str, ...]:
    """Terminals that the servos and one foot sensor can supply.

    t [s]; a0.. joint angles [rad], from the foot up; w0.. joint velocities [rad/s]; s0 floor force on the foot [N];
    contact 1 or 0; air_time and ground_time since the last change of contact [s]; hops so far; goal_dist as
    commanded [m]; and `WAY`.

    Args:
        joints: Number of joints.
        odometer: Whether the lamp has one.
    """
    angles = [f"a{joint}" for joint in range(joints)]
    speeds = [f"w{joint}" for joint in range(joints)]
    return (
        "t",
        *angles,
        *speeds,
        "s0",
        "contact",
        "air_time",
        "ground_time",
        "hops",
        "goal_dist",
        *(WAY if odometer else ()),
    )


OPTIONAL = ("goal_time",)
"""Terminals that only some commands give: goal_time, the time to take for the way [s] (Gritz & Hahn 1997, section 3.3:
the "time to spend traveling" as a parameter of a skill)."""


TWIN_ONLY = ("px", "py", "pz", "vx", "vy", "vz", "goal_met")
"""Terminals of Gritz & Hahn 1997 that nothing on the lamp measures: foot relative to the goal [m], its velocity [m/s]
(x forward, z up), and 1 once the foot has come within 1.5 cm of the goal."""


def all_terminals(joints: int, *, odometer: bool = True) -> tuple[str, ...]:
    """Every terminal that a controller of a lamp with that many joints may name."""
    return on_board_terminals(joints, odometer=odometer) + OPTIONAL + TWIN_ONLY


GOAL_SIGNALS = ("goal_ahead", "goal_left", "goal_dist")
"""Terminals that tell where the goal is from a figure: ahead and to the left of its heading, and how far [m]."""


def figure_terminals(figure: Figure) -> tuple[str, ...]:
    """Every terminal that a controller of a figure may name (Kwasnicka & Wozniak, Table 2, and `GOAL_SIGNALS`).

    t [s]; k0.. joint angles [rad]; O*.px O*.py O*.pz positions [m] and V*.x V*.y V*.z velocities [m/s] of its objects;
    Ogoal.px Ogoal.py where the goal is a point.

    Args:
        figure: The figure.
    """
    angles = [f"k{joint}" for joint in range(len(figure.joints))]
    objects = [f"O{name}.{axis}" for name in figure.objects for axis in ("px", "py", "pz")]
    speeds = [f"V{name}.{axis}" for name in figure.objects for axis in ("x", "y", "z")]
    point = ("Ogoal.px", "Ogoal.py") if figure.goal == POINT else ()
    return ("t", *angles, *objects, *speeds, *point, *GOAL_SIGNALS)


def terminals_of(driven: Driven) -> tuple[str, ...]:
    """Every terminal that a controller of this lamp, or of another figure, can be given."""
    if isinstance(driven, Figure):
        return figure_terminals(driven)
    return all_terminals(len(driven.joints), odometer=driven.odometer is not None)


class Signals:
    """Turns measurements into terminal values, lane by lane.

    A missing measurement (NaN) keeps its last value. Velocities are differences of the angles over a control period,
    because both sides can form them alike.

    Args:
        lanes: Number of lanes.
        joints: Number of joints.
        limits: Thresholds, period and odometer.
        terminals: Which terminals to give, in which order.
        read: Those of them that are read; None: all. What costs time is given only where it is read.

    Raises:
        ExpressionError: One is the odometer's, and the lamp has none, or it is of another control period.
    """

    def __init__(
        self, lanes: int, joints: int, limits: SignalLimits, terminals: Sequence[str], read: Set[str] | None = None
    ) -> None:
        self._limits = limits
        self.terminals = tuple(terminals)
        self._column = {name: index for index, name in enumerate(self.terminals)}
        self.values = np.zeros((lanes, len(self.terminals)))
        self._angle = np.zeros((lanes, joints))
        self._velocity = np.zeros((lanes, joints))
        self._force = np.zeros(lanes)
        self._counter = HopCounter(lanes, limits)
        self._tick = -1
        read = frozenset(self.terminals) if read is None else read
        self._odometry = _odometry(lanes, limits) if read & {*WAY} else None
        self.feels_all = self._odometry is not None or bool(read & {*FOOT_WINDOW})

    @property
    def contact(self) -> NDArray[np.bool_]:
        """Whether the foot is on the ground, shape (lanes,)."""
        return self._counter.contact

    @property
    def hops(self) -> NDArray[np.float64]:
        """Hops so far, shape (lanes,)."""
        return self._counter.hops

    @property
    def way(self) -> Way | None:
        """How far the first lane has come by its odometer; None where none is at work."""
        made = self._odometry
        return None if made is None else Way(float(made.way[0]), float(made.stderr[0]), int(made.unlike[0]))

    def update(
        self,
        angle: NDArray[np.float64],
        force: NDArray[np.float64],
        goal: NDArray[np.float64],
        base: NDArray[np.float64] | None = None,
        elapsed: int = 1,
        goal_time: NDArray[np.float64] | float = 0.0,
        foot: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ) -> NDArray[np.float64]:
        """Take one tick's measurements and return the terminals' values.

        Args:
            angle: Joint angles, shape (lanes, joints) [rad].
            force: Foot force, shape (lanes,) [N].
            goal: Commanded distances, shape (lanes,) [m].
            base: For the twin alone: px py pz vx vy vz goal_met, shape (lanes, 7); None on the lamp.
            elapsed: Control periods since the last call: more than 1 where ticks were missed.
            goal_time: Commanded times to take, shape (lanes,) or one for all [s].
            foot: What `FootWindow.take` gave; None, or NaN: the tick was like its last sample.

        Returns:
            Terminal values, shape (lanes, terminals); overwritten by the next call.
        """
        passed = self._limits.period * elapsed
        angle = np.where(np.isnan(angle), self._angle, angle)
        if self._tick >= 0:
            self._velocity = (angle - self._angle) / passed
        self._angle = angle
        self._force = np.where(np.isnan(force), self._force, force)
        counter = self._counter
        counter.update(self._force, elapsed)
        self._tick += elapsed
        self._set("t", self._tick * self._limits.period)
        for joint in range(angle.shape[1]):
            self._set(f"a{joint}", angle[:, joint])
            self._set(f"w{joint}", self._velocity[:, joint])
        self._set("s0", self._force)
        self._set("contact", counter.contact)
        self._set("air_time", counter.air_time)
        self._set("ground_time", counter.ground_time)
        self._set("hops", counter.hops)
        self._set("goal_dist", goal)
        self._set("goal_time", goal_time)
        if self.feels_all:
            self._feel(foot, goal, elapsed)
        if base is not None:
            for index, name in enumerate(TWIN_ONLY):
                self._set(name, base[:, index])
        return self.values

    def _feel(
        self, foot: tuple[NDArray[np.float64], NDArray[np.float64]] | None, goal: NDArray[np.float64], elapsed: int
    ) -> None:
        mean, contact = foot or (self._force, self._counter.contact)
        mean = np.where(np.isnan(mean), self._force, mean)
        contact = np.where(np.isnan(contact), self._counter.contact, contact)
        self._set("foot_mean", mean)
        self._set("foot_contact", contact)
        if self._odometry is not None:
            self._odometry.update(self._angle, self._velocity, mean, contact, self._counter.contact, elapsed)
            self._set("way", self._odometry.way)
            self._set("way_left", goal - self._odometry.way)
            self._set("way_stderr", self._odometry.stderr)

    def _set(self, name: str, value: NDArray[np.float64] | NDArray[np.bool_] | float) -> None:
        column = self._column.get(name)
        if column is not None:
            self.values[:, column] = value


def _odometry(lanes: int, limits: SignalLimits) -> Odometry:
    odometer = limits.odometer
    if odometer is None:
        raise ExpressionError(f"{' '.join(WAY)} need an odometer; the lamp has none", "odometer in hardware/lamp.toml")
    if abs(odometer.control_period - limits.period) > 1e-9:
        raise ExpressionError(
            f"{' '.join(WAY)} need a control period of {odometer.control_period:g} s, the odometer's;"
            f" the controller's is {limits.period:g} s",
            "control_period",
        )
    return Odometry(lanes, odometer)
