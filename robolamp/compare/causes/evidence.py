"""A log's readings against those of twins with changed knobs: one vector each, and how well they agree.

Agreement is the negative log-likelihood of a Student-t with NU degrees of freedom and a fixed scale for each kind of
reading: readings that are far off (an impact a tick early, all that follows a missed landing) weigh by the logarithm
of how far, not by its square.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.compare.causes.knobs import Change
from robolamp.compare.pauses import pauses, silent
from robolamp.compare.verdicts.ensemble import starts
from robolamp.dynamixel.registers import RAD_PER_COUNT
from robolamp.dynamixel.wire_time import wire_time
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.open_loop import GoalSchedule, Member, Record, play_bank

Array = NDArray[np.float64]

NU = 3.0
"""Degrees of freedom: heavy tails, as `scipy.stats.t` has them."""
SCALES = {"angle": 0.001, "current": 0.010, "force": 0.05, "voltage": 0.05, "answer": 0.001}
"""What two readings of one thing may differ by [rad, A, N, V, s]: a little over each sensor's step; a USB frame."""
BEFORE = 0.3
"""How much of standing before the controller's first tick is looked at [s]."""
AFTER = 2.2
"""How much of its run is [s]: hops multiply small differences, and later ones say little of their cause."""
DRIVEN = 0.3
"""How long the controller must have driven for its motion to show a cause [s]. Chosen: 15 ticks, in which the
shipped hop crouches and stretches; before that any lamp stands, and stiction bears any friction there."""
MOVED = 0.05
"""How far a joint's goal angles must have moved for its motion to show a cause [rad]. Chosen: below that sag and
stiction (10 mrad, as `robolamp.compare.align.STILL` has it) are a large part of the way."""


@dataclass(frozen=True)
class Readings:
    """What a log holds of the stretch that is looked at; K readings in all.

    Attributes:
        value: Readings, whitened: angles, currents, forces, voltages, the time that answers take beyond that of their
            packets, shape (K,); NaN where missing.
        scale: What each was divided by, shape (K,): what two good readings may differ by, and as much more as twins
            that start a hair apart differ by (standard deviation).
        parts: Where each kind of reading is in `value`.
    """

    value: Array
    scale: Array
    parts: dict[str, slice]


class Evidence:
    """A log's readings, and the twins with changed knobs that may explain them.

    Args:
        run: The log.
        lamp: The lamp's description.
        calibration: The twin's numbers.
        assets: Where the model is.
    """

    def __init__(self, run: Run, lamp: Lamp, calibration: Calibration, assets: Assets) -> None:
        self.run = run
        self._build = lambda change: build(lamp, calibration, assets, change.bend)
        self._base: TwinModel = self._build(Change())
        self.rows = stretch(run)
        self.readings = _readings(run, self.rows)
        self._score = _score(run, self.rows, lamp, self._base.timestep) if self.rows.size else None
        self._played: dict[str, Array] = {}
        self._alike = np.empty((0, self.readings.value.size))
        if self._score is not None:
            members = [Member(self._base, nudge=each) for each in starts(self._base).nudge]
            record = play_bank(members, self._score)
            alike = np.array([self._read(record, lane, Change()) for lane in range(len(members))])
            wider = np.hypot(1.0, alike.std(axis=0, ddof=1))
            self.readings = replace(self.readings, value=self.readings.value / wider, scale=self.readings.scale * wider)
            self._alike = alike / wider

    @property
    def missing(self) -> str:
        """Why no cause can be found from it, in words; empty where some can."""
        rows = self.rows[self.run.phase[self.rows] == "run"]
        driven = (
            float(np.isfinite(self.run.angle[rows]).all(axis=1).sum()) * self.run.control_period if rows.size else 0.0
        )
        if driven < DRIVEN:
            return f"the controller drove for {driven:.2f} s; finding a cause takes {DRIVEN:g} s"
        return ""

    @property
    def moved(self) -> NDArray[np.bool_]:
        """Which joints' goal angles moved far enough to show a cause, shape (n,)."""
        return np.ptp(self.run.goal[self.rows], axis=0) >= MOVED

    @property
    def held_up(self) -> float:
        """Time that answers take beyond that of their packets, median [s]; NaN where the log does not say."""
        return float(np.median(self.run.read_done - self.run.began)) - self.run.answer_wire

    @property
    def chance(self) -> tuple[float, float]:
        """How far the log disagrees with the nearest and the furthest of calibrated twins that start a hair apart."""
        costs = [disagreement(self.readings.value, alike) for alike in self._alike]
        return min(costs), max(costs)

    def predict(self, changes: Sequence[Change]) -> list[Array]:
        """Return what twins with these changes would have read, whitened, shape (K,) each.

        Args:
            changes: How the twins differ from the calibrated one.
        """
        missing = {repr(each): each for change in changes for each, _ in self._whole(change)}
        missing = {key: change for key, change in missing.items() if key not in self._played}
        if missing:
            assert self._score is not None
            moved = {repr(_moving(change)): _moving(change) for change in missing.values()}
            record = play_bank([self._member(change) for change in moved.values()], self._score)
            lanes = {key: lane for lane, key in enumerate(moved)}
            for key, change in missing.items():
                self._played[key] = self._read(record, lanes[repr(_moving(change))], change)
        return [
            np.sum([share * self._played[repr(each)] for each, share in self._whole(change)], axis=0)
            for change in changes
        ]

    def _whole(self, change: Change) -> list[tuple[Change, float]]:
        """Return a change as a mixture of changes that are late by whole physics steps: between two, both count."""
        late = change.late / self._base.timestep
        below = math.floor(late + 1e-9)
        share = late - below
        if share < 1e-6:
            return [(change, 1.0)]
        times = below * self._base.timestep, (below + 1) * self._base.timestep
        return [(replace(change, late=times[0]), 1 - share), (replace(change, late=times[1]), share)]

    def _member(self, change: Change) -> Member:
        twin = self._base if repr(change.bend) == repr(Change().bend) else self._build(change)
        return Member(
            twin,
            change.late,
            change.resistance,
            change.drain,
            np.array(change.zero, np.float64),
            change.slope,
        )

    def _read(self, record: Record, lane: int, change: Change) -> Array:
        run, rows, parts = self.run, self.rows, self.readings.parts
        predicted = np.full(self.readings.value.size, np.nan)
        n = len(run.joints)
        at = run.measured_at[rows]
        seen = run.sampled_at[rows] + change.asked
        angle = np.column_stack([np.interp(seen[:, j], record.time, record.angle[:, lane, j]) for j in range(n)])
        # Currents and forces are those of the step before: an impact is not smeared over two of them.
        held = record.current[_before(record.time, seen.ravel()).reshape(seen.shape), lane, np.arange(n)]
        moment = at - np.where(np.isfinite(run.foot_age[rows]), run.foot_age[rows], 0.0)
        force = record.force[_before(record.time, moment), lane]
        force = force * change.foot_gain + change.foot_offset + change.foot_drift * (moment - run.began[0])
        drawn = np.nan_to_num(np.abs(run.current)).sum(axis=1)  # where some are missing, no voltage is held against it
        volts = self._base.voltage + np.max(change.bend.supply)
        volts = volts - change.resistance * drawn - change.drain * (run.measured_at - run.began[0])
        predicted[parts["angle"]] = angle.ravel()
        predicted[parts["current"]] = held.ravel()
        predicted[parts["force"]] = force
        predicted[parts["voltage"]] = np.repeat(volts, n)
        predicted[parts["answer"]] = change.asked
        return predicted / self.readings.scale


def disagreement(value: Array, predicted: Array, stretch: float = 1.0) -> float:
    """Return how unlikely readings are under a prediction (negative log-likelihood, 0 where they agree).

    Args:
        value: Whitened readings, shape (K,).
        predicted: Whitened predictions, shape (K,).
        stretch: Times the scale that they were whitened with.
    """
    residual = (value - predicted) / stretch
    residual = residual[np.isfinite(residual)]
    return float((NU + 1) / 2 * np.log1p(residual**2 / NU).sum() + residual.size * np.log(stretch))


def stretch(run: Run) -> NDArray[np.int64]:
    """Return the ticks that are looked at: from standing still to a few seconds into the run, shape (N,)."""
    running = np.flatnonzero(run.phase == "run")
    first = float(run.began[running[0]]) if running.size else float(run.began[0])
    rows = (run.began >= first - BEFORE) & (run.began <= first + AFTER)
    if running.size:
        rows &= run.phase != "landing"
    if found := pauses(run):  # what the lamp did without its servos no twin replays
        rows &= (np.arange(run.index.size) <= found[0].last) & ~silent(run)
    return np.flatnonzero(rows)


def _before(time: Array, moment: Array) -> NDArray[np.int64]:
    """Return the last step at or before each moment; a log's time stamps are exact to a microsecond."""
    return np.clip(np.searchsorted(time, moment + 1e-6, side="right") - 1, 0, time.size - 1)


def _moving(change: Change) -> Change:
    """Return the part of a change that makes the lamp move differently."""
    return replace(change, asked=0.0, foot_gain=1.0, foot_offset=0.0, foot_drift=0.0)


def _readings(run: Run, rows: NDArray[np.int64]) -> Readings:
    # How far the supply sags follows from all currents: where one of them is missing, the voltage tells nothing.
    known = np.isfinite(run.current)
    whole = np.asarray(known.all(axis=1)) if known.any() else np.ones(run.index.size, np.bool_)
    values = {
        "angle": run.angle[rows].ravel(),
        "current": run.current[rows].ravel(),
        "force": run.foot_force[rows],
        # Of the whole log: a supply that drains takes its time.
        "voltage": np.where(whole[:, None], run.voltage, np.nan).ravel(),
        "answer": (run.read_done - run.began)[rows] - run.answer_wire,
    }
    parts, begin = {}, 0
    for name, value in values.items():
        parts[name] = slice(begin, begin + value.size)
        begin += value.size
    scale = np.concatenate([np.full(value.size, SCALES[name]) for name, value in values.items()])
    return Readings(np.concatenate(list(values.values())) / scale, scale, parts)


def _score(run: Run, rows: NDArray[np.int64], lamp: Lamp, timestep: float) -> GoalSchedule:
    first = int(rows[0])
    before = run.goal[max(first - 1, 0)]
    known = run.angle[first]
    return GoalSchedule(
        begin=math.floor(run.began[first] / timestep) * timestep,  # on an emulator's own grid
        end=float(max(run.read_done[rows[-1]], run.measured_at[rows[-1]])) + 0.01,
        powered=float(run.began[0]),
        pose=np.where(np.isfinite(known), known, before),
        hold=before,
        sent=np.maximum.accumulate(run.write_done[rows]) + wire_time("goals", len(run.joints), lamp.bus_baud),
        goal=np.round(run.goal[rows] / RAD_PER_COUNT) * RAD_PER_COUNT,  # registers hold whole counts
    )
