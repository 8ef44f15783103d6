from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.dynamixel.registers import Name
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.reality.file import Reality, load_reality
from robolamp.emulator.servo.drive import Drive
from robolamp.errors import FileError, RobolampError
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.lamp_body import Body

from .parts import Status, instruction, read, u16, write

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)
NONE = Reality.none(LAMP)
RAD_PER_COUNT = 2 * math.pi / 4096


class Client:
    """Talks to an emulated lamp in simulated time."""

    def __init__(self, reality: Reality = NONE) -> None:
        self.lamp = EmulatedLamp(LAMP, CALIBRATION, ASSETS, reality)
        self.time = 0.0

    def send(self, data: bytes) -> list[Status]:
        return [Status.of(reply.data) for reply in self.lamp.receive(data, self.time)]

    def write(self, id: int, address: int, value: int, size: int) -> None:
        (answer,) = self.send(write(id, address, value, size))
        assert answer.error == 0

    def value(self, id: int, address: int, size: int) -> int:
        (answer,) = self.send(read(id, address, size))
        return int.from_bytes(answer.data, "little", signed=True)

    def angles(self) -> list[float]:
        return [
            joint.sign * (self.value(joint.id, 132, 4) * RAD_PER_COUNT - joint.zero) for joint in self.lamp.lamp.joints
        ]

    def go(self, goal: list[float]) -> None:
        blocks = b""
        for joint, angle in zip(LAMP.joints, goal, strict=True):
            counts = round((joint.zero + joint.sign * angle) / RAD_PER_COUNT)
            blocks += bytes([joint.id]) + counts.to_bytes(4, "little")
        assert self.send(instruction(0xFE, 0x83, u16(116) + u16(4) + blocks)) == []

    def start(self, p_gain: int = 800) -> None:
        for joint in LAMP.joints:
            self.write(joint.id, 84, p_gain, 2)
            self.write(joint.id, 64, 1, 1)

    def wait(self, seconds: float) -> None:
        self.time += seconds
        self.lamp.advance_to(self.time)


def test_it_stands_in_the_neutral_pose_as_if_held_by_hand() -> None:
    client = Client()
    client.wait(20.0)
    assert client.angles() == pytest.approx([0, 0, 0], abs=RAD_PER_COUNT)
    truth = client.lamp.plant.truth()
    assert not truth.fallen
    assert truth.lean == pytest.approx(0, abs=1e-3)
    assert truth.base_x == pytest.approx(0, abs=1e-3)
    assert truth.clearance == pytest.approx(0, abs=1e-3)


def test_the_foot_carries_the_lamps_weight() -> None:
    client = Client()
    client.wait(1.0)
    weight = 9.81 * build(LAMP, CALIBRATION, ASSETS).model.body_mass.sum()
    frames = client.lamp.frames(client.time)
    assert len(frames) == 16 * 501
    assert int.from_bytes(frames[-7:-3], "little") / 1000 == pytest.approx(weight, rel=0.01)


def test_the_hand_lets_go_of_each_joint_when_its_torque_is_first_on() -> None:
    client = Client()
    client.write(2, 64, 1, 1)
    client.wait(0.01)
    assert client.lamp.plant.held == (True, False, True)
    client.write(2, 64, 0, 1)
    client.wait(0.01)
    assert client.lamp.plant.held == (True, False, True)


def test_without_torque_it_sinks() -> None:
    client = Client()
    client.start()
    client.wait(1.0)
    assert client.lamp.plant.truth().fallen is False
    for joint in LAMP.joints:
        client.write(joint.id, 64, 0, 1)
    client.wait(3.0)
    assert client.lamp.plant.truth().fallen is True
    assert abs(client.angles()[1]) > 0.3


def test_unbent_it_moves_as_the_twin_does() -> None:
    client = Client()
    twin = Body(build(LAMP, CALIBRATION, ASSETS))
    client.start()
    client.wait(1.0)
    twin.step(500)
    difference = []
    for tick in range(100):
        goal = [0.1 * math.sin(tick * 0.1), 0.3 * math.sin(tick * 0.12), -0.2 * math.sin(tick * 0.18)]
        client.go(goal)
        twin.set_goal(np.array(goal))
        client.wait(0.02)
        twin.step(10)
        difference.append(np.abs(client.lamp.plant.angle - twin.angle))
    assert np.mean(difference) < 0.5e-3


def time_to_goal(late: float) -> float:
    """The mean time at which the neck covers its way to a goal that comes so late into a physics step [s]."""
    lamp = EmulatedLamp(LAMP, CALIBRATION, ASSETS, NONE, clamped=True)
    neck = lamp.servos[2]
    for servo in lamp.servos:
        servo.write(64, b"\x01", 0.0)
    lamp.advance_to(0.3)
    goal = neck.register(Name.GOAL_POSITION) + 60
    angles: list[float] = []
    lamp.watch(lambda lamp: angles.append(lamp.plant.angle[2]))
    lamp.advance_to(0.3 + late)
    neck.write(116, goal.to_bytes(4, "little"), 0.3 + late)
    lamp.advance_to(0.7)
    missing = angles[-1] - np.array(angles)
    return float(missing.sum() / missing[0]) * lamp.timestep


def test_a_goal_acts_from_when_it_comes() -> None:
    """Not from a step's boundary: every goal of a run would be early, or late, by the same part of a step."""
    late = [0.0004, 0.001, 0.0016]
    found = [time_to_goal(each) for each in [0.0, *late]]
    assert [each - found[0] for each in found[1:]] == pytest.approx(late, abs=0.0001)


def test_the_p_gain_register_acts() -> None:
    sag = []
    for gain in (400, 1600):
        client = Client()
        client.start(gain)
        client.wait(1.0)
        sag.append(abs(client.angles()[1]))
    assert sag[0] > 2 * sag[1]


def test_goal_pwm_limits_the_motor() -> None:
    client = Client()
    client.start()
    client.write(3, 100, 88, 2)
    client.go([0.0, 0.0, 1.0])
    largest = 0
    for _ in range(20):
        client.wait(0.01)
        largest = max(largest, abs(client.value(3, 124, 2)))
    assert 60 <= largest <= 90


def test_a_motor_switched_on_has_forgotten_old_goals() -> None:
    client = Client()
    client.start()
    client.go([0.0, 0.0, 0.8])
    client.wait(1.0)
    client.write(3, 64, 0, 1)
    client.go([0.0, 0.0, -0.8])
    client.wait(0.05)
    angle = client.angles()[2]
    client.go([0.0, 0.0, angle])
    client.write(3, 64, 1, 1)
    client.wait(0.02)
    assert client.angles()[2] == pytest.approx(angle, abs=0.02)


def test_velocity_lags_by_half_its_window() -> None:
    client = Client()
    client.start()
    client.wait(0.5)
    client.go([0.0, 0.0, 0.3])
    seen, true = [], []
    for _ in range(100):
        client.wait(0.002)
        seen.append(client.value(3, 128, 4) * 0.229 * 2 * math.pi / 60)
        true.append(client.lamp.plant.velocity[2])
    lag = np.argmax(seen) - np.argmax(true)
    assert 5 <= lag <= 20
    assert 0 < max(seen) < max(true)


def test_a_weaker_knee_sags_more_and_a_worn_joint_reads_noise() -> None:
    weak = Client(replace(NONE, strength=np.array([1.0, 0.7, 1.0])))
    plain = Client()
    for client in (weak, plain):
        client.start()
        client.wait(1.0)
    assert abs(weak.angles()[1]) > 1.2 * abs(plain.angles()[1])
    worn = Client(load_reality("worn", LAMP, ASSETS))
    worn.wait(0.1)
    readings = []
    for _ in range(50):
        worn.wait(0.01)
        readings.append(worn.angles())
    assert np.all(np.std(readings, axis=0) > 0.5e-3)
    assert np.all(np.std(readings, axis=0) < 2e-3)


def test_the_same_seed_gives_the_same_lamp() -> None:
    bent = replace(load_reality("worn", LAMP, ASSETS), jitter=0.001)

    def run() -> list[list[float]]:
        client = Client(bent)
        client.start()
        readings = []
        for tick in range(20):
            client.go([0.0, 0.02 * tick, 0.0])
            client.wait(0.02)
            readings.append(client.angles())
        return readings

    assert run() == run()


def test_a_baud_rate_that_no_servo_has() -> None:
    with pytest.raises(FileError, match=r"bus.baud: 12345 is not one of 9600"):
        EmulatedLamp(replace(LAMP, bus_baud=12345), CALIBRATION, ASSETS, NONE)


def test_a_lamp_that_flies_apart_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes MUJOCO_LOG.TXT
    lamp = Client().lamp
    lamp.advance_to(0.1)
    lamp.plant.drive(1, Drive(torque=True, goal=1e9, p_gain=16383, duty_limit=1e12))
    with pytest.raises(RobolampError, match="the physics diverged"):
        lamp.advance_to(1.0)
