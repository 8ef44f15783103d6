"""What is reckoned to be on the line is what the emulator counts there, byte by byte, and all that time it takes."""

from __future__ import annotations

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.dynamixel.bus import Bus
from robolamp.dynamixel.registers import MODELS, Name
from robolamp.dynamixel.servos import Servos
from robolamp.dynamixel.wire_time import Transport, wire_time
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.line.line import BITS, Reply
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import load_reality
from robolamp.lamp import load_lamp

LAMP = load_lamp(Assets())
ROUND = 6  # readings after which the lengths that take turns, two or three, have all had theirs


class Counted(EmulatedLamp):
    """Counts the bytes on its line."""

    count = 0

    def receive(self, data: bytes, time: float) -> list[Reply]:
        replies = super().receive(data, time)
        self.count += len(data) + sum(len(reply.data) for reply in replies)
        return replies


@pytest.mark.parametrize("transport", Transport)
@pytest.mark.parametrize("n", [1, 2, 3])
def test_each_part_of_a_tick_is_so_long_on_the_line(transport: Transport, n: int) -> None:
    assets = Assets()
    world = Counted(LAMP, load_calibration(assets), assets, load_reality("none", LAMP, assets))
    ports = Lockstep(world, LAMP.bus_baud)
    bus = Bus(ports.servo_port, LAMP.bus_baud, ports.clock)
    bus.open()
    joints = LAMP.joints[:n]
    servos = Servos(bus, [joint.id for joint in joints], [MODELS[joint.servo] for joint in joints])
    assert servos.prepare([52] * n) is Transport.FAST
    servos.transport = transport
    byte = BITS / LAMP.bus_baud
    world.count, begun = 0, ports.clock.now()
    for _ in range(ROUND):
        servos.read()
    assert world.count * byte / ROUND == pytest.approx(wire_time("reading", n, LAMP.bus_baud, transport))
    # The driver looks for answers in pieces: it may notice the last byte of a packet a little late.
    assert ports.clock.now() - begun == pytest.approx(world.count * byte, rel=0.1)
    world.count = 0
    servos.write_goals(np.full(n, 3.1))
    assert world.count * byte == pytest.approx(wire_time("goals", n, LAMP.bus_baud))
    tick = wire_time("tick", n, LAMP.bus_baud, transport)
    parts = wire_time("reading", n, LAMP.bus_baud, transport) + wire_time("goals", n, LAMP.bus_baud)
    assert tick == pytest.approx(parts)
    world.count = 0
    servos.set(0, Name.TORQUE_ENABLE, 0)
    answer = 11  # a status packet without data
    assert (world.count - answer) * byte == pytest.approx(wire_time("switch", 1, LAMP.bus_baud))
    bus.close()
