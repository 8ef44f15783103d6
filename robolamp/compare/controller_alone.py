"""The controller alone on the twin: its own closed loop, to the goal of the log, without anything that the lamp did.

This is not the replay, in which the goal angles that the lamp was sent drive the twin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.compare.controller_replay import logged_pilot
from robolamp.compare.goal_replay import duty_of
from robolamp.compare.run_ending import Ending
from robolamp.errors import RobolampError
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.log.schemas import DURATION
from robolamp.signals import Command
from robolamp.twin.judge import REST_MOTION
from robolamp.twin.lamp_model import build
from robolamp.twin.twin_lamp import TwinLamp

STAND = 1.0
"""How long the twin stands in the neutral pose first [s]: as in the fleet that evolves and scores controllers."""
LONG = 5.0
"""How long the controller drives where the log does not say, and was cut [s]: what dry-run and deploy take."""
LONGEST = 600.0
"""The longest that dry-run and deploy let a controller drive [s]: a log that says more was not made by them."""


@dataclass(frozen=True)
class Alone:
    """What a controller does alone on the twin.

    Attributes:
        travel: Where the twin lands [m]; NaN where the controller could not be run.
        hops: Hops that it counts.
        flown: Hops that fly.
        fell: Whether the twin falls.
        hit: Whether it is at rest at the goal, upright, at the end.
        why: Why it could not be run.
    """

    travel: float = math.nan
    hops: int = 0
    flown: int = 0
    fell: bool = False
    hit: bool = False
    why: str = ""


def alone_of(run: Run, ending: Ending, lamp: Lamp, calibration: Calibration, assets: Assets, allowed: float) -> Alone:
    """Let a log's controller drive the twin by itself.

    Args:
        run: The log: gives controller, goal, goal_time, how long it drives, slew and duty of the stage.
        ending: Whether it drove to its end.
        lamp: The lamp's description.
        calibration: The twin's numbers.
        assets: Where the model is.
        allowed: Distance from the goal that is there [m].
    """
    try:
        pilot = logged_pilot(run, lamp)
        duration = _duration(run, ending)
        twin = TwinLamp(build(lamp, calibration, assets), run.goal_m, duration, duty=duty_of(run))
    except RobolampError as error:
        return Alone(why=error.message)
    period = pilot.control_period
    twin.open()
    twin.torque(True)
    twin.advance_to(STAND)
    twin.start_judging()
    start, hops = float(twin.body.base[0]), 0
    for tick in range(round(duration / period)):
        step = pilot.step(twin.observe(), tick * period)
        hops = step.hops
        twin.command(Command(step.goal))
        twin.advance_to(STAND + (tick + 1) * period)
    outcome = twin.outcome
    twin.close()
    travel = float(outcome.x[0]) - start
    rests = bool(outcome.motion[0] <= REST_MOTION and outcome.upright[0])
    return Alone(
        travel=travel,
        hops=hops,
        flown=int(outcome.hops[0]),
        fell=bool(outcome.fallen[0]),
        hit=rests and abs(travel - run.goal_m) <= allowed,
    )


def _duration(run: Run, ending: Ending) -> float:
    """Return how long the controller was to drive [s]."""
    told = run.number(DURATION, above=0.0)
    if math.isfinite(told):
        return min(told, LONGEST)
    return max(ending.drove, LONG) if ending.cut else ending.drove
