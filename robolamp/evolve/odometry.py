"""Learning the odometer: steps of many controllers on many lamps, to a network that tells how far they go."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.controller.controller_file import Controller
from robolamp.controller.hop_counter import HopCounter, SignalLimits
from robolamp.controller.odometry import Steps
from robolamp.controller.program import compile_program
from robolamp.controller.terminals import FOOT_WINDOW, TWIN_ONLY, on_board_terminals
from robolamp.errors import RobolampError
from robolamp.evolve.representations.tree import Genome, constants, with_constants
from robolamp.lamp import Lamp
from robolamp.odometer import LEAST_ERROR, Network, Odometer
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.fleet import Fleet, Job
from robolamp.twin.sensor_model import measure_angle
from robolamp.twin.trace import Trace
from robolamp.twin.variation.random_lamps import LampLaw
from robolamp.twin.variation.spread import load_spread

Array = NDArray[np.float64]

DURATION = 8.0
"""Of a run [s]."""

LAMPS = (
    ("spread", 1.0, 0.46),
    ("spread", 0.5, 0.18),
    ("spread", 1.5, 0.12),
    ("spread-narrow", 1.0, 0.18),
    ("spread", 0.0, 0.06),
)
"""What an odometer is learnt on: spreads, factors on them, and shares of the lamps. Factor 0: the lamp that all differ
from, time and again."""

_GOALS = 0.05, 0.60  # [m]
_LANES = 400  # recorded at once: 30 MB
# Chosen by errors on lamps that were left out: all that follow.
_ROUNDS, _BATCH, _SQUARES = 50, 256, 10  # passes over all; steps at once; passes before errors are learnt, too
_RATE, _PENALTY = 4e-3, 100.0  # of Adam (Kingma & Ba 2015); of the squares of weights, beside all steps' losses
_JUDGED = 0.2  # share of the lamps that is left out, to judge by
_RANGE = 5e-4  # share of the steps beyond either end of a feature's range
_MARGIN = 0.25  # of that range, added at either end
_FEWEST = 200  # steps to learn from
_WITHIN = 0.015  # of the way come: as near as a hit is to its goal [m]
_FALL = 15  # ticks before a fall in which a step is none to learn from


def lamps_of(
    lamp: Lamp, calibration: Calibration, assets: Assets, count: int, rng: np.random.Generator
) -> list[LampGroup]:
    """Draw the lamps that an odometer is learnt on, as `LAMPS` has them.

    Args:
        lamp: The lamp's description.
        calibration: The numbers that lamps are drawn around.
        assets: Where model and spreads are.
        count: How many in all.
        rng: Where randomness comes from.
    """
    return [
        drawn(lamp, calibration, assets, spread, scale, max(1, round(share * count)), rng)
        for spread, scale, share in LAMPS
    ]


@dataclass(frozen=True)
class LampGroup:
    """Lamps whose models differ in numbers only.

    Attributes:
        twins: The lamps.
        scale: Factor on the spread that they were drawn from.
        encoder_noise: Standard deviation of each reading, shape (lamps, joints) [rad].
        foot_offset: Added to the foot's force, shape (lamps,) [N].
        foot_delay: How late it comes, shape (lamps,) [s].
    """

    twins: Sequence[TwinModel]
    scale: float
    encoder_noise: Array
    foot_offset: Array
    foot_delay: Array


def drawn(
    lamp: Lamp,
    calibration: Calibration,
    assets: Assets,
    spread: str,
    scale: float,
    count: int,
    rng: np.random.Generator,
) -> LampGroup:
    """Draw lamps from a spread, and from the wide one what their sensors add that a fleet's have not.

    Args:
        lamp: The lamp's description.
        calibration: The numbers that lamps are drawn around.
        assets: Where model and spreads are.
        spread: Its name.
        scale: Factor on it.
        count: How many.
        rng: Where randomness comes from.
    """
    law, wide, joints = LampLaw(lamp, calibration, assets, spread), load_spread(assets), len(lamp.joints)
    bent = [law.draw(rng, scale) for _ in range(count)]
    senses = [wide.draw(int(seed), joints, scale) for seed in rng.integers(2**32, size=count)]
    return LampGroup(
        [build(lamp, numbers, assets, bend) for numbers, bend in bent],
        scale,
        encoder_noise=np.array([each["encoder_noise"] for each in senses]),
        foot_offset=np.array([each["foot_offset"] for each in senses]),
        foot_delay=np.array([each["foot_dead_time"] + each["latency"] for each in senses]),
    )


@dataclass(frozen=True)
class StepTable:
    """Steps, one a row.

    Attributes:
        features: In the order of `robolamp.odometer.feature_names`, shape (k, f).
        length: How far the base truly went, shape (k,) [m].
        controller: Whose step it is, shape (k,).
        lamp: Of which lamp, shape (k,); -1: of the one that others are drawn around.
        run: In which run, shape (k,).
    """

    features: Array
    length: Array
    controller: NDArray[np.int64]
    lamp: NDArray[np.int64]
    run: NDArray[np.int64]

    def take(self, rows: NDArray[np.bool_]) -> StepTable:
        """Return some of them, shape (k,)."""
        return StepTable(self.features[rows], self.length[rows], self.controller[rows], self.lamp[rows], self.run[rows])

    @staticmethod
    def join(tables: Sequence[StepTable]) -> StepTable:
        """Return the rows of all tables, one after the other."""
        columns = ("features", "length", "controller", "lamp", "run")
        return StepTable(*(np.concatenate([getattr(table, name) for table in tables]) for name in columns))


def gather(
    lamp: Lamp,
    groups: Sequence[LampGroup],
    controllers: Sequence[Controller],
    goals: int,
    rng: np.random.Generator,
    *,
    vary: float = 0.0,
    workers: int | None = None,
    done: Callable[[float], None] = lambda _share: None,
) -> StepTable:
    """Let controllers hop on lamps, and measure each step.

    Args:
        lamp: The lamp's description.
        groups: The lamps.
        controllers: What drives them, each of them all.
        goals: How many goals for each controller on each lamp, drawn from 5 to 60 cm.
        rng: Where goals and constants come from.
        vary: Standard deviation by which every other lamp's controller has its constants changed, of each.
        workers: Threads; None: one for each core.
        done: Called with the share that is done, 0 to 1.

    Raises:
        RobolampError: The controllers have different control periods.
    """
    tables, lamps, total = [], 0, sum(len(group.twins) for group in groups)
    for group in groups:

        def here(share: float, before: int = lamps, count: int = len(group.twins)) -> None:
            done((before + share * count) / total)

        table = _collect(lamp, group, controllers, goals, rng, vary, workers, here)
        runs = lamps * len(controllers) * goals
        who = table.lamp + lamps if group.scale else np.full_like(table.lamp, -1)
        tables.append(replace(table, lamp=who, run=table.run + runs))
        lamps += len(group.twins)
    return StepTable.join([table for table in tables if len(table.length)] or tables[:1])


def _collect(
    lamp: Lamp,
    group: LampGroup,
    controllers: Sequence[Controller],
    goals: int,
    rng: np.random.Generator,
    vary: float,
    workers: int | None,
    done: Callable[[float], None],
) -> StepTable:
    """Return the steps of one group; see `gather`."""
    periods = {controller.control_period for controller in controllers}
    if len(periods) > 1:
        said = ", ".join(f"{controller.name} {controller.control_period:g} s" for controller in controllers)
        raise RobolampError(f"have different control periods ({said}); an odometer is of one", "controllers")
    own = on_board_terminals(len(lamp.joints), odometer=lamp.odometer is not None)
    period, names = periods.pop(), (*own, *TWIN_ONLY, *FOOT_WINDOW)
    fleet = Fleet(group.twins, period, workers)
    tables, rounds = [], [(index, lane) for index in range(len(controllers)) for lane in range(len(group.twins))]
    at_once = max(1, _LANES // goals)
    for first in range(0, len(rounds), at_once):
        part, programs, jobs = rounds[first : first + at_once], [], []
        for index, lane in part:
            expressions: Genome = controllers[index].expressions
            if vary and lane % 2:
                expressions = _varied(expressions, vary, rng)
            programs.append(compile_program(expressions, names))
            jobs += [Job(len(programs) - 1, lane, float(goal)) for goal in rng.uniform(*_GOALS, goals)]
        outcome = fleet.run(programs, jobs, DURATION, record=True)
        assert outcome.trace is not None
        who = np.repeat(np.array(part), goals, axis=0)
        run = first * goals + np.arange(len(jobs))
        tables.append(_steps(outcome.trace, names, lamp, period, outcome.fallen, group, who, run, rng))
        done(min(first + at_once, len(rounds)) / len(rounds))
    return StepTable.join([table for table in tables if len(table.length)] or tables[:1])


def _varied(genome: Genome, vary: float, rng: np.random.Generator) -> Genome:
    """Return a controller with changed constants; those that are written alike stay alike."""
    values, tied = np.unique(constants(genome), return_inverse=True)
    return with_constants(genome, (values * (1 + vary * rng.standard_normal(len(values))))[tied].tolist())


def _steps(
    trace: Trace,
    names: Sequence[str],
    lamp: Lamp,
    period: float,
    fallen: NDArray[np.bool_],
    group: LampGroup,
    who: NDArray[np.int64],
    run: NDArray[np.int64],
    rng: np.random.Generator,
) -> StepTable:
    """Return the steps of recorded runs, cut and measured as they are on the lamp, with what its sensors add."""
    lanes, joints = len(run), len(lamp.joints)
    column = {name: trace.inputs[:, :, index] for index, name in enumerate(names)}
    angle = np.stack([column[f"a{joint}"] for joint in range(joints)], axis=2)
    angle = measure_angle(angle + group.encoder_noise[who[:, 1], None] * rng.standard_normal(angle.shape))
    velocity = np.diff(angle, axis=1, prepend=angle[:, :1]) / period
    late, offset = group.foot_delay[who[:, 1], None] / period, group.foot_offset[who[:, 1], None]
    pressed = column["s0"] + offset
    felt, contact = (_delayed(column[name], late) for name in FOOT_WINDOW)
    felt += offset
    counter, steps = HopCounter(lanes, SignalLimits.of(lamp, period)), Steps(lanes, joints, period)
    last = np.where(fallen, trace.ticks - _FALL, trace.ticks)
    start = column["px"][:, 0].copy()
    rows: list[tuple[NDArray[np.int64], Array, Array]] = []
    for tick in range(trace.inputs.shape[1]):
        counter.update(pressed[:, tick])
        lane, features = steps.update(
            angle[:, tick], velocity[:, tick], felt[:, tick], contact[:, tick], counter.contact
        )
        if len(lane):
            here = column["px"][lane, tick]
            told = tick < last[lane]
            rows.append((lane[told], features[told], (here - start[lane])[told]))
            start[lane] = here
    if not rows:
        return StepTable(np.empty((0, 0)), np.empty(0), *(np.empty(0, np.int64) for _ in range(3)))
    lane = np.concatenate([each for each, _, _ in rows])
    return StepTable(
        np.concatenate([each for _, each, _ in rows]),
        np.concatenate([each for _, _, each in rows]),
        who[lane, 0],
        who[lane, 1],
        run[lane],
    )


def _delayed(values: Array, late: Array) -> Array:
    """Return means over ticks, shape (k, ticks), that come late by a share of a tick, shape (k, 1)."""
    before = np.concatenate([values[:, :1], values[:, :-1]], axis=1)
    return (1 - late) * values + late * before


def fit(steps: StepTable, lamp: Lamp, controllers: Sequence[Controller], hidden: int, seed: int) -> Odometer:
    """Learn an odometer, and judge it: by lamps left out, and by each controller left out.

    Args:
        steps: What to learn from.
        lamp: The lamp's description.
        controllers: Whose steps they are.
        hidden: Size of the hidden layer.
        seed: Where randomness comes from.

    Returns:
        The odometer; its `scores` are of a fifth of the lamps, which it was not learnt from.

    Raises:
        RobolampError: The steps are too few.
    """
    if len(steps.length) < _FEWEST:
        raise RobolampError(f"took {len(steps.length)} steps in all; expected {_FEWEST} or more", "controllers")
    period = controllers[0].control_period
    rng = np.random.default_rng(seed)
    lamps = np.unique(steps.lamp[steps.lamp >= 0])
    left_out = np.isin(steps.lamp, rng.permutation(lamps)[: max(1, round(_JUDGED * len(lamps)))])
    known, judged = steps.take(~left_out), steps.take(left_out)
    odometer = _learn(known, judged, lamp, period, hidden, seed)
    scores = judge(odometer, judged, controllers)
    for row, index in zip(scores["by_controller"], np.unique(judged.controller), strict=True):
        if len(controllers) > 1:
            others = _learn(
                known.take(known.controller != index),
                judged.take(judged.controller != index),
                lamp,
                period,
                hidden,
                seed,
            )
            alone = judge(others, judged.take(judged.controller == index), controllers)["by_controller"][0]
            row["step_rms_when_left_out_m"] = alone["step_rms_m"]
    return replace(odometer, scores=scores)


def with_facts(odometer: Odometer, facts: Mapping[str, Any]) -> Odometer:
    """Return an odometer that says what it was learnt from."""
    return replace(odometer, provenance=dict(facts))


def judge(odometer: Odometer, steps: StepTable, controllers: Sequence[Controller]) -> dict[str, Any]:
    """Return how well an odometer measures steps.

    Args:
        odometer: The odometer.
        steps: What it was not learnt from.
        controllers: Whose steps they are.

    Returns:
        Of each controller and of all: `steps`, `step_rms_m` and `step_median_m` (errors of single steps),
        `run_median_m` and `runs_within` (errors at the end of runs: median, and the share within 1.5 cm),
        `run_standardised` and `step_standardised` (root mean square of errors over what was said of them: 1 is
        honest); and `unlike`, the share of steps that it says are unlike those that it was learnt from.
    """

    def row(some: StepTable) -> dict[str, Any]:
        (error, stderr), (total, said) = errors(odometer, some), run_errors(odometer, some)
        return {
            "steps": len(error),
            "step_rms_m": _rms(error),
            "step_median_m": float(np.median(np.abs(error))),
            "step_standardised": _rms(error / stderr),
            "run_median_m": float(np.median(np.abs(total))),
            "runs_within": float(np.mean(np.abs(total) < _WITHIN)),
            "run_standardised": _rms(total / said),
        }

    rows = [
        {"controller": controllers[index].name, **row(steps.take(steps.controller == index))}
        for index in np.unique(steps.controller)
    ]
    unlike = odometer.measure(steps.features)[2]
    return {**row(steps), "unlike": float(np.mean(unlike)), "by_controller": rows}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _learn(known: StepTable, judged: StepTable, lamp: Lamp, period: float, hidden: int, seed: int) -> Odometer:
    """Learn from steps; the scale and the correlation of the errors are of those of other lamps."""
    rng = np.random.default_rng(seed)
    ends = np.quantile(known.features, [_RANGE, 1 - _RANGE], axis=0)
    margin = _MARGIN * (ends[1] - ends[0]) + 1e-9
    unit, mean, scale = float(known.length.std()), known.features.mean(axis=0), known.features.std(axis=0) + 1e-9
    odometer = Odometer(
        joints=len(lamp.joints),
        control_period=period,
        mean=mean,
        scale=scale,
        low=ends[0] - margin,
        high=ends[1] + margin,
        network=_blank(known.features.shape[1], hidden, rng),
        hop=unit,
        correlation=0.0,
    )
    _train(odometer.network, odometer.scaled(known.features), known.length / unit, LEAST_ERROR / unit, rng)
    error, stderr = errors(odometer, judged)
    odometer.network.offset[1] += 2 * math.log(_rms(error / stderr))
    return replace(odometer, correlation=_correlation(odometer, judged))


def errors(odometer: Odometer, steps: StepTable) -> tuple[Array, Array]:
    """Return how far an odometer is off for each step, and what it says of that, shape (k,) [m]."""
    length, stderr, _ = odometer.measure(steps.features)
    return length - steps.length, stderr


def run_errors(odometer: Odometer, steps: StepTable) -> tuple[Array, Array]:
    """Return how far an odometer is off at the end of each run, and what it says of that, shape (runs,) [m]."""
    error, stderr = errors(odometer, steps)
    _, run = np.unique(steps.run, return_inverse=True)
    share = odometer.correlation
    variance = (1 - share) * np.bincount(run, stderr**2) + share * np.bincount(run, stderr) ** 2
    return np.bincount(run, error).astype(np.float64), np.sqrt(variance)


def _correlation(odometer: Odometer, steps: StepTable) -> float:
    """Return by which correlation of steps the errors of whole runs are as large as said."""
    total, _ = run_errors(odometer, steps)
    _, stderr = errors(odometer, steps)
    _, run = np.unique(steps.run, return_inverse=True)
    alone, alike = np.bincount(run, stderr**2), np.bincount(run, stderr) ** 2
    shares = np.linspace(0.0, 1.0, 101)
    spread = [np.mean(total**2 / ((1 - share) * alone + share * alike)) for share in shares]
    return float(shares[np.argmin(np.abs(np.array(spread) - 1.0))])


def _blank(features: int, hidden: int, rng: np.random.Generator) -> Network:
    """Return a network to begin with."""
    return Network(
        weights=rng.standard_normal((features, hidden)) / math.sqrt(features),
        bias=np.zeros(hidden),
        outputs=0.1 * rng.standard_normal((hidden, 2)),
        offset=np.array([0.0, -2.0]),
    )


def _train(network: Network, inputs: Array, wanted: Array, least: float, rng: np.random.Generator) -> None:
    """Teach a network, in place, by Adam (Kingma & Ba 2015): first lengths, then how far off these are, too."""
    network.offset[0] = wanted.mean()
    parameters = (network.weights, network.bias, network.outputs, network.offset)
    means, squares = ([np.zeros_like(each) for each in parameters] for _ in range(2))
    steps, total = 0, _ROUNDS * math.ceil(len(wanted) / _BATCH)
    for turn in range(_ROUNDS):
        order = rng.permutation(len(wanted))
        for first in range(0, len(order), _BATCH):
            rows = order[first : first + _BATCH]
            slopes = _slopes(network, inputs[rows], wanted[rows], least, likelihood=turn >= _SQUARES)
            slopes[0] += _PENALTY / len(wanted) * network.weights
            slopes[2] += _PENALTY / len(wanted) * network.outputs
            steps += 1
            rate = _RATE * 0.5 * (1 + math.cos(math.pi * steps / total))
            for index, slope in enumerate(slopes):
                means[index] += 0.1 * (slope - means[index])
                squares[index] += 0.001 * (slope**2 - squares[index])
                size = np.sqrt(squares[index] / (1 - 0.999**steps)) + 1e-8
                parameters[index][:] -= rate * means[index] / (1 - 0.9**steps) / size


def _slopes(network: Network, inputs: Array, wanted: Array, least: float, *, likelihood: bool) -> list[Array]:
    """Return how the loss changes with each parameter: half the squares, or the negative log likelihood."""
    hidden = np.tanh(inputs @ network.weights + network.bias)
    length, log_variance = (hidden @ network.outputs + network.offset).T
    off = length - wanted
    if likelihood:
        variance = np.exp(log_variance)
        precision = 1 / (least**2 + variance)
        by_variance = 0.5 * variance * precision * (1 - off**2 * precision)
    else:
        precision, by_variance = np.ones_like(off), np.zeros_like(off)
    slope = np.stack([off * precision, by_variance], axis=1) / len(off)
    inner = (slope @ network.outputs.T) * (1 - hidden**2)
    return [inputs.T @ inner, inner.sum(axis=0), hidden.T @ slope, slope.sum(axis=0)]
