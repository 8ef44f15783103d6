"""A recording becomes a gesture: few key frames, and how far they are off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robolamp.cli.options import Setup
from robolamp.cli.run.recorded import recorded
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import load_reality
from robolamp.errors import SafetyError
from robolamp.log.reader import read_run
from robolamp.pose.gesture import Frame, Gesture
from robolamp.pose.hand_pilot import BAND, HandPilot
from robolamp.pose.recording import simplify
from robolamp.robot.connection import Connection
from robolamp.signals import Health, Observation

SETUP = Setup.of(None, "nominal")
LAMP = SETUP.lamp
MOVED = Gesture(
    "moved",
    LAMP.names,
    (
        Frame(0.8, np.array([0.1, 0.3, 0.3]), "minimum jerk"),
        Frame(1.2, np.full(3, np.nan), "linear"),
        Frame(2.0, np.array([-0.1, -0.2, -0.6]), "slow in and out"),
    ),
)


def test_few_frames_and_the_error_that_is_stated() -> None:
    motion = MOVED.motion()
    time = np.arange(0, 3.5, 0.02)
    angle = np.array([motion(at - 0.6) for at in time]) + np.random.default_rng(1).normal(0, 0.002, (len(time), 3))
    angle[40] = np.nan
    made = simplify("made", time, angle, LAMP, 0.05, 20)
    assert len(made.gesture.frames) <= 6
    assert made.mean < made.worst <= 0.055
    assert made.length == pytest.approx(2.0, abs=0.4)
    played, begin = made.gesture.motion(), made.gesture.frames[0].time
    assert played(begin + made.length) == pytest.approx(motion(9.0), abs=0.05)
    rough = simplify("rough", time, angle, LAMP, 0.05, 3)
    assert len(rough.gesture.frames) == 3
    assert rough.worst > made.worst


def test_what_was_not_moved_is_no_gesture() -> None:
    time = np.arange(0, 1, 0.02)
    with pytest.raises(SafetyError, match="no joint was moved"):
        simplify("still", time, np.full((len(time), 3), 0.1), LAMP, 0.05, 20)
    with pytest.raises(SafetyError, match="no joint was moved"):
        simplify("blind", time, np.full((len(time), 3), np.nan), LAMP, 0.05, 20)


@pytest.mark.parametrize("band", [0.0, BAND])
def test_goals_give_way_to_a_hand_and_hold_the_rest(band: float) -> None:
    pilot, nan = HandPilot(LAMP, band), np.full(3, np.nan)
    health = Health.unknown(3)
    for tick in range(60):
        angle = np.array([0.005 * tick, 0.0, 2.0])  # pushed; sagging by less than the band; outside its limits
        goal = pilot.step(Observation(tick * 0.02, angle, nan, nan, np.zeros(3), 2.0, 0.0, health), tick * 0.02).goal
    assert goal == pytest.approx([0.295 - band, 0.0, LAMP.upper[2] - band], abs=1e-9)


def test_a_hand_at_the_emulated_lamp_is_recorded(tmp_path: Path) -> None:
    world = EmulatedLamp(LAMP, SETUP.calibration, SETUP.assets, load_reality("none", LAMP, SETUP.assets))
    ports = Lockstep(world, LAMP.bus_baud)
    motion, sleep = MOVED.motion(), ports.clock.sleep_until

    def sleep_until(time: float) -> None:
        sleep(time)
        world.plant._motors.turn(motion(time - 2.2))  # the hand

    ports.clock.sleep_until = sleep_until
    log = tmp_path / "moved.mcap"
    reached = Connection(ports.servo_port, ports.foot_port, ports.clock, epoch=0)
    made = recorded(SETUP, "moved", reached, log, 2.6, False, 0.05, 20, True)
    run = read_run(log)
    assert (run.torque == 0).all()
    assert run.context["stage"] == "by hand"
    assert 3 <= len(made.gesture.frames) <= 7
    assert made.worst < 0.06
    assert made.gesture.motion().end == pytest.approx([-0.1, -0.2, -0.6], abs=0.06)
