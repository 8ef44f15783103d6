"""A line that loses or damages packets while the lamp is being opened."""

from __future__ import annotations

import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import Faults, Rates
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import Reality
from robolamp.lamp import load_lamp
from robolamp.robot.robot_lamp import RobotLamp

ASSETS = Assets()
LAMP = load_lamp(ASSETS)
CALIBRATION = load_calibration(ASSETS)


@pytest.mark.parametrize("seed", [0, 1, 2, 33])
def test_a_lamp_opens_over_a_line_that_loses_a_packet_in_sixteen(seed: int) -> None:
    faults = Faults("noisy", seed, {"instruction": Rates(dropped=0.06), "status": Rates(dropped=0.06)})
    world = EmulatedLamp(LAMP, CALIBRATION, ASSETS, Reality.none(LAMP), faults=faults)
    ports = Lockstep(world, LAMP.bus_baud)
    robot = RobotLamp(LAMP, ports.servo_port, ports.foot_port, ports.clock)
    try:
        robot.open()
        assert robot.transport
    finally:
        robot.close()
