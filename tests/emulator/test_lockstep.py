"""Lockstep: the SDK's own handlers, and robolamp's driver and loop, on emulated servos in virtual time."""

from __future__ import annotations

import time

import numpy as np
import pytest
from contract.backends import LAMP
from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PacketHandler

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import load_controller
from robolamp.controller.pilot import Pilot
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import Event, Faults, Rates
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import Reality, load_reality
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.runtime.loop import run
from robolamp.runtime.result import RunResult
from robolamp.signals import Tick

from .parts import read

BYTE = 10 / 1_000_000


def rig(faults: Faults | None = None, reality: str = "none") -> tuple[EmulatedLamp, Lockstep]:
    assets = Assets()
    bent = Reality.none(LAMP) if reality == "none" else load_reality(reality, LAMP, assets)
    world = EmulatedLamp(LAMP, load_calibration(assets), assets, bent, faults=faults)
    lockstep = Lockstep(world, LAMP.bus_baud)
    assert lockstep.servo_port.openPort()
    return world, lockstep


def test_the_sdk_reads_and_writes() -> None:
    _, lockstep = rig()
    port, packets = lockstep.servo_port, PacketHandler(2.0)
    found, result = packets.broadcastPing(port)
    assert result == COMM_SUCCESS
    assert found
    assert sorted(found) == [1, 2, 3]
    assert packets.ping(port, 2)[0] == 1200
    assert packets.write2ByteTxRx(port, 1, 84, 800) == (COMM_SUCCESS, 0)
    assert packets.read2ByteTxRx(port, 1, 84) == (800, COMM_SUCCESS, 0)


def test_the_sdk_moves_the_lamp_in_no_time() -> None:
    _, lockstep = rig()
    port, packets = lockstep.servo_port, PacketHandler(2.0)
    reader, writer = GroupSyncRead(port, packets, 132, 4), GroupSyncWrite(port, packets, 116, 4)
    goals = {1: 2048, 2: 2048, 3: 2348}
    for id, goal in goals.items():
        packets.write2ByteTxRx(port, id, 84, 800)
        packets.write1ByteTxRx(port, id, 64, 1)
        reader.addParam(id)
        writer.addParam(id, goal.to_bytes(4, "little"))
    assert writer.txPacket() == COMM_SUCCESS
    lockstep.clock.sleep_until(lockstep.clock.now() + 0.8)
    assert reader.txRxPacket() == COMM_SUCCESS
    assert reader.getData(3, 132, 4) == pytest.approx(2348, abs=60)


def test_a_transaction_takes_what_the_wire_takes() -> None:
    _, lockstep = rig()
    port, packets = lockstep.servo_port, PacketHandler(2.0)
    begun = lockstep.clock.now()
    assert packets.read4ByteTxRx(port, 1, 132)[1:] == (COMM_SUCCESS, 0)
    assert lockstep.clock.now() - begun == pytest.approx((14 + 15) * BYTE, abs=1e-9)
    packets.write1ByteTxRx(port, 1, 9, 250)  # Return Delay Time
    begun = lockstep.clock.now()
    packets.read4ByteTxRx(port, 1, 132)
    assert lockstep.clock.now() - begun == pytest.approx((14 + 15) * BYTE + 500e-6, abs=1e-9)


def test_a_servo_that_is_not_there_costs_the_timeout() -> None:
    _, lockstep = rig()
    begun = lockstep.clock.now()
    assert PacketHandler(2.0).ping(lockstep.servo_port, 9)[1] == COMM_RX_TIMEOUT
    assert 0.033 < lockstep.clock.now() - begun < 0.036


@pytest.mark.parametrize(("gap", "answered"), [(0.0014, True), (0.0016, False)])
def test_the_gap_inside_a_packet_is_exact(gap: float, answered: bool) -> None:
    _, lockstep = rig()
    port, request = lockstep.servo_port, read(1, 132, 4)
    port.writePort(request[:6])
    lockstep.clock.sleep_until(lockstep.clock.now() + 6 * BYTE + gap)
    port.writePort(request[6:])
    port.setPacketTimeoutMillis(5.0)
    assert len(port.readPort(100)) == (15 if answered else 0)


def test_bytes_arrive_one_after_another() -> None:
    _, lockstep = rig()
    port = lockstep.servo_port
    port.writePort(read(1, 132, 4))
    lockstep.clock.sleep_until((14 + 4.5) * BYTE)
    assert port.getBytesAvailable() == 4
    port.setPacketTimeoutMillis(1.0)
    assert port.readPort(2) == b"\xff\xff"
    assert len(port.readPort(13)) == 13
    assert lockstep.clock.now() == pytest.approx((14 + 15) * BYTE)


def test_at_the_wrong_rate_there_is_silence() -> None:
    _, lockstep = rig()
    assert lockstep.servo_port.setBaudRate(57_600)
    assert PacketHandler(2.0).ping(lockstep.servo_port, 1)[1] == COMM_RX_TIMEOUT
    assert lockstep.servo_port.setBaudRate(1_000_000)
    assert PacketHandler(2.0).ping(lockstep.servo_port, 1)[1] == COMM_SUCCESS


def test_bytes_that_cross_on_the_line_arrive_in_order_of_time() -> None:
    """Bytes to come stood before some that had arrived, and a read of as many gave none, though no time passed."""
    twice = [Event("duplicated", stream=stream, packet=1, packets=20) for stream in ("instruction", "status")]
    _, lockstep = rig(Faults("x", events=tuple(twice)))
    port = lockstep.servo_port
    for _ in range(10):
        port.writePort(read(1, 132, 4) + read(2, 132, 4))
        port.setPacketTimeoutMillis(1.0)
        before = lockstep.clock.now()
        assert port.readPort(15) or port.isPacketTimeout()
        assert lockstep.clock.now() > before


def test_a_run_on_a_line_that_doubles_packets_ends() -> None:
    rates = {stream: Rates(duplicated=0.2) for stream in ("instruction", "status")}
    result, ticks, _ = hop(Faults("x", rates=rates))
    assert result.reason or result.ended == "finished"
    assert ticks


def test_an_unplugged_port_comes_back() -> None:
    both = (Event("unplugged", at=1.0, lasts=0.5), Event("unplugged", at=1.0, lasts=1.0, port="foot"))
    _, lockstep = rig(Faults("x", events=both))
    port, foot = lockstep.servo_port, lockstep.foot_port
    lockstep.clock.sleep_until(0.9)
    assert PacketHandler(2.0).ping(port, 1)[1] == COMM_SUCCESS
    assert foot.read(100)
    lockstep.clock.sleep_until(1.2)
    for attempt in (lambda: port.readPort(1), lambda: port.writePort(b"x"), port.clearPort, lambda: foot.read(1)):
        with pytest.raises(OSError, match="error"):
            attempt()
    assert not port.openPort()
    lockstep.clock.sleep_until(1.6)
    assert port.openPort()
    assert PacketHandler(2.0).ping(port, 1)[1] == COMM_SUCCESS


def test_a_port_is_unplugged_by_the_clients_clock() -> None:
    """Servos are ahead of the client, at the end of the packet that it is still sending."""
    at = 1.0 + 5 * BYTE
    _, lockstep = rig(Faults("x", events=(Event("unplugged", at=at, lasts=1.0),)))
    lockstep.clock.sleep_until(1.0)
    lockstep.servo_port.writePort(read(1, 132, 4))
    assert lockstep.servo_port.getBytesAvailable() == 0
    lockstep.clock.sleep_until(at)
    with pytest.raises(OSError, match="error"):
        lockstep.servo_port.getBytesAvailable()


def hop(faults: Faults | None = None) -> tuple[RunResult, list[Tick], EmulatedLamp]:
    world, lockstep = rig(faults, "worn")
    controller = load_controller(
        Assets().named("hop-counting", "sim/lamp/controllers", "controller"), LAMP, on_board=True
    )
    pilot = Pilot(controller, LAMP, 0.3, None)
    robot = RobotLamp(LAMP, lockstep.servo_port, lockstep.foot_port, lockstep.clock)
    ticks: list[Tick] = []
    robot.open()
    try:
        result = run(robot, pilot, LAMP, period=pilot.control_period, duration=5.0, on_tick=ticks.append)
    finally:
        robot.close()
    return result, ticks, world


def test_the_loop_runs_faster_than_real_time_and_repeats_bit_for_bit() -> None:
    hop()  # compiles
    begun = time.process_time()
    first, ticks, world = hop()
    assert time.process_time() - begun < 5.0  # of 8 s that passed in the lamp
    second, again, other = hop()
    assert first.ended == second.ended == "finished"
    assert first.hops == second.hops > 0
    assert world.plant.truth() == other.plant.truth()
    assert len(ticks) == len(again)
    for one, two in zip(ticks, again, strict=True):
        assert (one.began, one.write_done) == (two.began, two.write_done)
        np.testing.assert_array_equal(one.observation.angle, two.observation.angle)
        np.testing.assert_array_equal(one.goal, two.goal)
