"""Bit-exact replay of the controller: the logged observations through the logged controller give the logged goals."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robolamp.compare.pauses import pauses
from robolamp.controller.controller_file import load_controller
from robolamp.controller.pilot import Pilot
from robolamp.controller.terminals import FOOT_WINDOW
from robolamp.errors import FileError, RobolampError
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.log.run_context import ODOMETER, PLAYED
from robolamp.odometer import parse_odometer
from robolamp.signals import Health, Observation

_FLIGHT_TIME_0_1_0 = 0.04  # the shortest flight that 0.1.0 counted, whose logs do not say [s]


@dataclass(frozen=True)
class ControlReplay:
    """The result of running the controller again.

    Attributes:
        ticks: Ticks of phase "run" that were run again.
        exact: Whether inputs, outputs and goals were the same to the bit in all of them; None: it could not be run.
        first: Index of the first tick that differs; -1 where none does.
        what: What differs there, or why it could not be run.
    """

    ticks: int
    exact: bool | None
    first: int = -1
    what: str = ""

    @property
    def text(self) -> str:
        """Return it in words."""
        if self.exact is None:
            return (
                f"not run again: {self.what}"
                if not self.ticks
                else f"run again on the logged observations: {self.what}"
            )
        if self.exact:
            return f"run again on the logged observations: the same to the bit in all {self.ticks} ticks"
        return f"run again on the logged observations: differs from tick {self.first} on ({self.what})"


def replay_controller(run: Run, lamp: Lamp) -> ControlReplay:
    """Run the log's controller on the log's observations.

    Args:
        run: The log.
        lamp: The lamp's description: limits and slew of the envelope, thresholds of contact.
    """
    rows = np.flatnonzero(run.phase == "run")
    if not rows.size:
        return ControlReplay(0, None, what="the log holds no controller, no goal, or no run")
    try:
        pilot = logged_pilot(run, lamp)
    except RobolampError as error:
        return ControlReplay(0, None, what=error.message)
    begun = float(run.scheduled[rows[0]])
    stood = {pause.next: pause.length for pause in pauses(run)}
    ticks, paused, followed = 0, 0.0, True
    for row in rows.tolist():
        if row in stood:
            paused, followed = paused + stood[row], False
        if not np.isfinite(run.angle[row]).all():
            continue  # the loop held its goal, and asked no controller
        step = pilot.step(_observation(run, row), float(run.scheduled[row]) - begun - paused)
        ticks += 1
        for what, ours, logged in (
            ("inputs", step.inputs, run.inputs[row]),
            ("outputs", step.outputs, run.outputs[row]),
            ("goals", step.goal, run.goal[row]),
        ):
            if ours.shape != logged.shape or not np.array_equal(ours, logged, equal_nan=True):
                if not followed:  # goals that could not be sent, as the port was just gone, are in no log
                    text = f"the same to the bit up to tick {run.index[row]}, before which the servos were gone"
                    return ControlReplay(ticks - 1, None, what=f"{text}: what it was last asked is not in the log")
                return ControlReplay(ticks, False, int(run.index[row]), what)
        followed = True
    return ControlReplay(ticks, True)


def logged_pilot(run: Run, lamp: Lamp) -> Pilot:
    """Return the controller of a log, ready to drive to the log's goal.

    Args:
        run: The log.
        lamp: The lamp's description.

    Raises:
        RobolampError: The log holds no controller or no goal, or the controller does not fit the lamp.
    """
    text = run.context.get("controller", "")
    for kind in PLAYED:
        if run.context.get(kind):
            raise FileError(f"the log is of a {kind}, and names no controller", str(run.path))
    if not text or not np.isfinite(run.goal_m):
        raise FileError("the log holds no controller, no goal, or no run", str(run.path))
    # A gentle stage slews at a share of the lamp's own rate; the log says at which.
    try:
        share = float(run.context.get("slew_share", 1.0))
        goal_time = float(run.context["goal_time_s"]) if "goal_time_s" in run.context else None
        flight_time = float(run.context.get("flight_time_s", _FLIGHT_TIME_0_1_0))
    except ValueError as error:
        raise FileError(f"slew_share, goal_time_s or flight_time_s is no number: {error}", str(run.path)) from None
    for name, value in (("slew_share", share), ("goal_time_s", goal_time), ("flight_time_s", flight_time)):
        if value is not None and not 0.0 < value < math.inf:
            raise FileError(f"{name} is {value:g}; expected a number above 0", str(run.path))
    lamp = dataclasses.replace(
        lamp,
        joints=tuple(dataclasses.replace(joint, slew=joint.slew * share) for joint in lamp.joints),
        flight_time=flight_time,
        odometer=parse_odometer(run.context[ODOMETER], str(run.path)) if ODOMETER in run.context else None,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "controller.toml"
        path.write_text(text, encoding="utf-8")
        return Pilot(load_controller(path, lamp), lamp, run.goal_m, goal_time)


def _observation(run: Run, row: int) -> Observation:
    mean, contact = (
        float(run.inputs[row, run.terminals.index(name)]) if name in run.terminals else math.nan for name in FOOT_WINDOW
    )
    return Observation(
        time=float(run.measured_at[row]),
        angle=run.angle[row],
        velocity=run.velocity[row],
        current=run.current[row],
        angle_age=run.angle_age[row],
        foot_force=float(run.foot_force[row]),
        foot_age=float(run.foot_age[row]),
        health=Health.unknown(len(run.joints)),
        foot_mean=mean,
        foot_contact=contact,
    )
