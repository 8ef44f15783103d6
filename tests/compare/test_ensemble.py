"""A lamp that bends against a twin that does: replays that start a hair apart say how far the twin can predict."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robolamp.calibration import load_calibration
from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive, drive
from robolamp.cli.run.lockstep import LockstepLamp
from robolamp.compare.align import JointError, Trace, compare_joint
from robolamp.compare.compare_logs import compare_log
from robolamp.compare.comparison import Comparison
from robolamp.compare.replays.goal_replay import replays
from robolamp.compare.replays.trajectory import of_replay
from robolamp.compare.run_ending import ending_of
from robolamp.compare.travel.sensed_flights import Flight, Hop
from robolamp.compare.verdicts.ensemble import Apart, Spread, starts
from robolamp.compare.verdicts.tolerances import load_tolerances
from robolamp.compare.verdicts.twin_verdict import verdict_of
from robolamp.emulator.faults.script import Faults
from robolamp.emulator.reality.file import Reality
from robolamp.log.reader import read_run
from robolamp.runtime.stop import StopRequest
from robolamp.twin.lamp_model import build

from .lamps import ASSETS, LAMP, write_run

BENDING = Setup.of(None, "bending")
ALLOWED = load_tolerances(ASSETS)


class Never(StopRequest):
    @property
    def requests(self) -> int:
        return 0


def bending_hop(folder: Path, reality: Reality) -> Comparison:
    """Let a lamp that bends hop 20 cm, and judge it by a twin that does."""
    plan = Drive(BENDING, BENDING.controller("hop-bending", on_board=True), 0.20, 3.0, "emulator", folder / "log.mcap")
    with LockstepLamp(BENDING, reality, Faults("none"), folder / "truth.mcap", None) as lamp:
        drive(plan, lamp.ports, Never(), True)
    return compare_log(
        plan.log, truth=folder / "truth.mcap", assets=ASSETS, calibration=BENDING.calibration, out=folder / "r.html"
    )


def test_nothing_is_wrong_with_a_lamp_that_bends_as_its_twin_does(tmp_path: Path) -> None:
    found = bending_hop(tmp_path, Reality.none(LAMP))
    assert (found.verdict, found.judged.why) == ("inside", ())
    assert not any(cause.knob for cause in found.diagnosis)
    assert found.spread.apart.mae.min() > 0.002  # a twin that predicted all alike could be told by any of its replays
    alone = found.parts()
    assert alone["twin_alone_least_m"] <= alone["twin_alone_m"] <= alone["twin_alone_most_m"]
    assert alone["twin_alone_most_m"] - alone["twin_alone_least_m"] > 0.001


@pytest.mark.slow
def test_a_weak_knee_of_a_lamp_that_bends_is_named_first(tmp_path: Path) -> None:
    weak = replace(Reality.none(LAMP), strength=np.array([1.0, 0.85, 1.0]))
    first = next(cause for cause in bending_hop(tmp_path, weak).diagnosis if cause.knob)
    assert first.knob == "strength knee"
    assert -0.2 < first.size < -0.05  # rougher than of a rigid lamp: after a landing nothing tells it


def test_starts_are_the_same_each_time_and_within_what_a_log_cannot_tell() -> None:
    rigid, loose = (build(LAMP, load_calibration(ASSETS, name), ASSETS) for name in ("nominal", "bending"))
    for twin, play in ((rigid, 0.0), (loose, 0.005)):
        one, other = starts(twin), starts(twin)
        np.testing.assert_array_equal(one.nudge, other.nudge)
        np.testing.assert_array_equal(one.late, other.late)
        assert not one.nudge[0].any()
        assert one.late[0] == 0.0
        step = 2 * math.pi / 4096
        assert 0.5 < np.abs(one.nudge).max() / (step / 2 + play / 2) <= 1.0


def test_a_replay_does_the_same_alone_and_beside_others(tmp_path: Path) -> None:
    run = read_run(write_run(tmp_path)[0])
    alone = replays(run, LAMP, BENDING.calibration, ASSETS)[0]
    first, *others = replays(run, LAMP, BENDING.calibration, ASSETS, starts)
    np.testing.assert_array_equal(first.qpos, alone.qpos)
    assert all(np.abs(other.angle - alone.angle).max() > 1e-4 for other in others)


class Differing:
    """A run, and a twin that differs from it as told."""

    def __init__(self, folder: Path) -> None:
        self.run = read_run(write_run(folder)[0])
        self.side = replace(
            of_replay(self.run, replays(self.run, LAMP, load_calibration(ASSETS), ASSETS)[0]), fell=False
        )

    def judged(self, apart: Apart, hops: list[Hop], *, mae: float = 0.0, travel: float = 0.0) -> tuple[str, str]:
        """Return verdict and reasons where each joint is off by `mae` [rad] and the lamp came `travel` further [m]."""
        time = np.arange(150, dtype=np.float64) * 0.02
        swing = 0.3 * np.sin(9.0 * time)
        joints: list[JointError] = [
            compare_joint(name, Trace.of(time, swing), Trace.of(time, swing + mae), 150) for name in LAMP.names
        ]
        lamp = replace(self.side, name="lamp", travel=self.side.travel + travel)
        found = verdict_of(self.run, [ending_of(self.run)], joints, hops, lamp, self.side, ALLOWED, Spread(apart))
        return found.word, "; ".join(found.why)


@pytest.fixture(scope="module")
def differing(tmp_path_factory: pytest.TempPathFactory) -> Differing:
    return Differing(tmp_path_factory.mktemp("differing"))


SOME = Apart(np.full(3, 0.050), 0.08, 0.12, 1)
NONE = Apart(np.zeros(3), 0.0, 0.0, 0)
FLIGHT = Flight(0.5, 0.65)


@pytest.mark.parametrize(
    ("hops", "off", "what", "reach"),
    [
        ([], {"mae": 0.040}, "MAE 40.0 mrad", "50.0 mrad"),
        ([], {"travel": 0.06}, "allowed difference 5.0 cm", "8.0 cm"),
        ([Hop(FLIGHT, None)], {}, "hop 1: only on the lamp", "1 hop"),
        ([Hop(FLIGHT, Flight(0.6, 0.66))], {}, "hop 1: takes off 100 ms early", "120 ms"),
    ],
)
def test_a_difference_as_large_as_that_of_replays_makes_it_cannot_say(differing, hops, off, what, reach) -> None:
    word, why = differing.judged(SOME, hops, **off)
    assert word == "cannot say"
    assert what in why
    assert f"replays that start a hair apart differ by up to {reach}" in why
    word, why = differing.judged(NONE, hops, **off)
    assert word == "outside"
    assert "a hair apart" not in why


@pytest.mark.parametrize(
    ("hops", "off"),
    [
        ([], {"mae": 0.060}),
        ([], {"travel": 0.09}),
        ([Hop(FLIGHT, None), Hop(None, Flight(1.5, 1.65))], {}),
        ([Hop(FLIGHT, Flight(0.63, 0.66))], {}),
    ],
)
def test_a_larger_difference_is_outside(differing, hops, off) -> None:
    assert differing.judged(SOME, hops, **off)[0] == "outside"
