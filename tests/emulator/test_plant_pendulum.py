"""An emulated servo that turns a pendulum: gravity, gain, open winding, and what a reality changes of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from dynamixel_sdk import COMM_SUCCESS, PacketHandler

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.emulator.bare_servos import BareServos
from robolamp.emulator.bare_servos_file import BareServo, PendulumLoad, load_servos
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.reality import Reality
from robolamp.errors import FileError
from tests.emulator.test_emulate import emulator, eventually, sdk

MODEL = "XL330-M288-T"
VALUES = {**load_calibration(Assets()).servo(MODEL, ""), "encoder_offset": 0.0}
FRICTIONS = ("viscous", "coulomb", "stribeck", "load_motor", "load_external", "load_external_stribeck")
SMOOTH = {**VALUES, **dict.fromkeys(FRICTIONS, 0.0)}
MASS, LENGTH = 0.2, 0.1
GAIN, TORQUE, GOAL, POSITION = 84, 64, 116, 132
COUNT = 2 * math.pi / 4096


class Client:
    """A client of one servo in lockstep."""

    def __init__(self, values: dict[str, float], reality: Reality | None = None) -> None:
        load = PendulumLoad(MASS, LENGTH, 1.5, values)
        self.world = BareServos([BareServo(MODEL, 1, 1_000_000, 0.0, math.pi, 5.0, 0.0, load)], reality=reality)
        self.ports = Lockstep(self.world, 1_000_000)
        self.port, self.packets = self.ports.servo_port, PacketHandler(2.0)
        self.port.openPort()

    def write(self, address: int, value: int, size: int) -> None:
        write = {1: self.packets.write1ByteTxRx, 2: self.packets.write2ByteTxRx, 4: self.packets.write4ByteTxRx}[size]
        assert write(self.port, 1, address, value) == (COMM_SUCCESS, 0)

    def angle(self) -> float:
        counts, result, error = self.packets.read4ByteTxRx(self.port, 1, POSITION)
        assert (result, error) == (COMM_SUCCESS, 0)
        return counts * COUNT - math.pi

    def wait(self, seconds: float) -> None:
        self.ports.clock.sleep_until(self.ports.clock.now() + seconds)

    def go(self, angle: float, gain: int, seconds: float) -> float:
        self.write(GAIN, gain, 2)
        self.write(TORQUE, 1, 1)
        self.write(GOAL, round((angle + math.pi) / COUNT), 4)
        self.wait(seconds)
        return self.angle()


def test_a_soft_servo_hangs_below_its_goal_by_what_the_weight_takes() -> None:
    client = Client(SMOOTH)
    found = client.go(1.2, 200, 4.0)
    kv = 200 / 256 * 4096 / (2 * math.pi) / 885 * 5.0  # V/rad (calibration/README.md, "Formulas")
    torque = SMOOTH["torque_constant"] * kv * (1.2 - found) / SMOOTH["resistance"]
    assert torque == pytest.approx(MASS * 9.81 * LENGTH * math.sin(found), rel=0.02)
    assert 0.05 < 1.2 - found < 0.6


def test_without_torque_and_friction_it_swings_with_its_own_period() -> None:
    client = Client(SMOOTH)
    client.go(0.2, 1600, 2.0)
    client.write(TORQUE, 0, 1)
    begin, seen = client.ports.clock.now(), []
    while client.ports.clock.now() < begin + 4.0:
        client.wait(0.005)
        seen.append((client.ports.clock.now(), client.angle()))
    time, angle = np.array(seen).T
    rising = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    period = np.diff(time[rising]).mean()
    inertia = SMOOTH["armature"] + MASS * LENGTH**2
    assert period == pytest.approx(2 * math.pi * math.sqrt(inertia / (MASS * 9.81 * LENGTH)), rel=0.02)
    assert angle.max() == pytest.approx(-angle.min(), abs=0.01)  # an open winding does not brake


def test_a_goal_moves_it_after_the_servos_delay_and_the_lines() -> None:
    def first_motion(client: Client) -> float:
        client.go(0.0, 800, 0.5)
        client.write(GOAL, round((1.0 + math.pi) / COUNT), 4)
        begin = client.ports.clock.now()
        while abs(client.angle()) < 3 * COUNT:
            client.wait(0.0005)
        return client.ports.clock.now() - begin

    plain = first_motion(Client({**SMOOTH, "delay": 0.005}))
    assert first_motion(Client({**SMOOTH, "delay": 0.015})) - plain == pytest.approx(0.010, abs=0.0012)
    assert first_motion(Client(SMOOTH | {"delay": 0.005}, Reality(name="late", delay=0.004))) - plain == pytest.approx(
        0.004, abs=0.0012
    )


def test_a_reality_bends_motor_encoder_and_supply() -> None:
    found = Client(SMOOTH).go(1.2, 200, 4.0)
    strong = Client(SMOOTH, Reality(name="strong", strength=np.array([1.3])))
    assert strong.go(1.2, 200, 4.0) > found + 0.03
    off = Client(SMOOTH, Reality(name="off", encoder_offset=np.array([0.05])))
    assert off.angle() == pytest.approx(0.05, abs=COUNT)
    weak = Client(SMOOTH, Reality(name="weak", supply=-0.6, temperature=44.0))
    volts = weak.packets.read2ByteTxRx(weak.port, 1, 144)[0]
    assert (volts, weak.packets.read1ByteTxRx(weak.port, 1, 146)[0]) == (44, 44)
    noisy = Client(SMOOTH, Reality(name="noisy", encoder_noise=np.array([0.01])))
    assert 0.005 < np.std([noisy.angle() for _ in range(100)]) < 0.02


def test_of_a_servos_file_and_a_real_port(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(
        'name = "b"\n[[servo]]\nmodel = "XL330-M288-T"\nbaud = 1_000_000\nreturn_delay = 0.0\n'
        "[servo.pendulum]\nmass = 0.2\nlength = 0.1\n"
    )
    with emulator("--servos", str(file)) as (_, ready), sdk(str(ready["servo_port"])) as (handler, packets):
        assert eventually(lambda: packets.write1ByteTxRx(handler, 1, TORQUE, 1) == (COMM_SUCCESS, 0))

        def arrives() -> bool:
            packets.write4ByteTxRx(handler, 1, GOAL, 2400)
            try:
                return 2200 < packets.read4ByteTxRx(handler, 1, POSITION)[0] < 2410
            except IndexError:  # dynamixel-sdk takes a late answer to the write for one without data
                return False

        assert eventually(arrives)


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ("mass = 0.2", "length"),
        ("mass = 0.0\nlength = 0.1", "mass"),
        ("mass = 0.2\nlength = 0.1\nswing = 3.0", "swing"),
        ("mass = 0.2\nlength = 0.1\ncalibration = 'none-such'", "no such calibration"),
        ("mass = 0.2\nlength = 0.1\nweight = 1", "weight"),
    ],
)
def test_a_malformed_pendulum_is_named(table: str, reason: str, tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(f'name = "b"\n[[servo]]\nmodel = "{MODEL}"\n[servo.pendulum]\n{table}\n')
    with pytest.raises(FileError, match=reason):
        load_servos(file)
    file.write_text(f'name = "b"\n[[servo]]\nmodel = "{MODEL}"\nload = 0.1\n[servo.pendulum]\nmass = 1\nlength = 0.1\n')
    with pytest.raises(FileError, match="beside a pendulum"):
        load_servos(file)
