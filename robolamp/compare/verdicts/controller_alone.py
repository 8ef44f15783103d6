"""The controller alone on the twin: its own closed loop, to the goal of the log, without anything that the lamp did.

This is not the replay, in which the goal angles that the lamp was sent drive the twin.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.compare.replays.controller_replay import logged_pilot
from robolamp.compare.replays.goal_replay import duty_of, head_of
from robolamp.compare.run_ending import Ending
from robolamp.compare.verdicts.ensemble import starts
from robolamp.controller.foot_window import FootWindow
from robolamp.errors import RobolampError
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.log.schemas import DURATION
from robolamp.signals import Health, Observation
from robolamp.twin.engine import state_of
from robolamp.twin.judges.lamp_judge import REST_MOTION, Judge
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.lanes.lamp_lanes import Lamps
from robolamp.twin.sensor_model import measure_angle, measure_force

Array = NDArray[np.float64]

STAND = 1.0
"""How long the twin stands in the neutral pose first [s]: as in the fleet that evolves and scores controllers."""
LONG = 5.0
"""How long the controller drives where the log does not say, and was cut [s]: what dry-run and deploy took
when logs did not say."""
RUNS = 5
"""How many of the starts a hair apart it drives from: each takes as long as running the log's controller again."""
STILL = 5.0
"""How long after a run was stopped a controller must send the same goals, to a lamp at rest, to be done [s]: chosen.
What was to drive for minutes is judged within seconds; one that drove to its end drives as long here."""
_SAME_GOAL = 0.001  # rad
LONGEST = 600.0
"""The longest that dry-run and deploy let a controller drive [s]: a log that says more was not made by them."""


@dataclass(frozen=True)
class Alone:
    """What a controller does alone on the twin, and how far that can be said: it drives from starts a hair apart.

    Attributes:
        travel: Where the twin lands from the start of the model [m]; NaN where the controller could not be run.
        least: The shortest way from any of the starts [m].
        most: The longest [m].
        hops: Hops that it counts.
        flown: Hops that fly, from any of the starts at least.
        fell: Whether the twin falls.
        hit: Whether it is at rest at the goal, upright, at the end.
        why: Why it could not be run.
    """

    travel: float = math.nan
    least: float = math.nan
    most: float = math.nan
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
        duration, duty = _duration(run, ending), duty_of(run)
        pilots = [logged_pilot(run, lamp) for _ in range(RUNS)]
        twin = build(lamp, calibration, assets)
    except RobolampError as error:
        return Alone(why=error.message)
    body, every = Body(twin), np.arange(RUNS)
    lamps = Lamps([twin], np.zeros(RUNS, np.int64), states=state_of(body.model, body.data), gains=duty < 1.0)
    motors, dt, period = lamps.motors, twin.timestep, pilots[0].control_period
    lamps.batch.forward()
    motors.limit[:] = duty
    motors.place(starts(twin).nudge[:RUNS])
    for _ in range(round(STAND / dt)):
        lamps.step(every)
    judge, begun = Judge(twin, np.full(RUNS, run.goal_m), duration), lamps.qpos[:, 0].copy()
    judge.begin(begun)
    head, axis = head_of(lamps, twin)
    line, arriving, n = round(twin.line_delay / dt), deque[tuple[int, Array]](), len(lamp.joints)
    unknown, fresh, hops = Health.unknown(n), np.zeros(n), [0] * RUNS
    felt = FootWindow(RUNS, lamp.contact_on, lamp.contact_off)
    held, where, since, still = np.zeros((RUNS, n)), begun, 0, False
    for tick in range(round(duration / period)):
        first, last = (round((STAND + moment * period) / dt) for moment in (tick, tick + 1))
        angle, force = measure_angle(motors.angle), measure_force(lamps.force, twin.foot_gain)
        velocity, current = motors.velocity, motors.current
        steps = [
            pilot.step(
                Observation(
                    first * dt,
                    *seen,
                    angle_age=fresh,
                    foot_force=float(pressed),
                    foot_age=0.0,
                    health=unknown,
                    foot_mean=float(mean),
                    foot_contact=float(contact),
                ),
                tick * period,
            )
            for pilot, pressed, mean, contact, *seen in zip(
                pilots, force, *felt.take(), angle, velocity, current, strict=True
            )
        ]
        hops = [step.hops for step in steps]
        goals, x = np.array([step.goal for step in steps]), lamps.qpos[:, 0]
        if np.abs(goals - held).max() > _SAME_GOAL or np.abs(x - where).max() > REST_MOTION:
            held, where, since = goals, x.copy(), tick
        still = tick * period >= ending.drove and (tick - since) * period >= STILL
        if still:
            break
        arriving.append((first + line, goals))
        for now in range(first, last):
            while arriving and arriving[0][0] <= now:
                motors.goal[:] = arriving.popleft()[1]
            lamps.step(every)
            felt.add(measure_force(lamps.force, twin.foot_gain))
            judge.step(every, lamps.qpos, lamps.force, head, axis)
    outcome = judge.outcome(motors.angle, lamps.diverged, np.zeros(RUNS, np.int64))
    travel = outcome.x - begun
    rests = bool((still or outcome.motion[0] <= REST_MOTION) and outcome.upright[0])
    return Alone(
        travel=float(travel[0]),
        least=float(travel.min()),
        most=float(travel.max()),
        hops=hops[0],
        flown=int(outcome.hops.min()),
        fell=bool(outcome.fallen[0]),
        hit=rests and abs(float(travel[0]) - run.goal_m) <= allowed,
    )


def _duration(run: Run, ending: Ending) -> float:
    """Return how long the controller was to drive [s]."""
    told = run.number(DURATION, above=0.0)
    if math.isfinite(told):
        return min(told, LONGEST)
    return max(ending.drove, LONG) if ending.cut else ending.drove
