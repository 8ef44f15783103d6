"""Strangers' clients on the emulated servos, unchanged: three of them, of which two frame their packets themselves.

dynamixel_easy_sdk (in dynamixel-sdk's wheel), rustypot (Rust), dynamixel-python (its package is `dxl2`).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import rustypot
from dxl2.v2 import BulkParams, MotorBus, SyncParams
from dynamixel_easy_sdk import Connector
from sleeper import bears, eventually

from .test_process import emulator

pytestmark = pytest.mark.realtime

SERVOS = "".join(
    f'[[servo]]\nmodel = "XL330-M288-T"\nid = {id}\nbaud = 1_000_000\nreturn_delay = 0\n' for id in (1, 2, 3)
)


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    path: Path = tmp_path_factory.mktemp("servos") / "three.toml"
    path.write_text(f'name = "three"\n{SERVOS}')
    with emulator("--servos", str(path)) as (_, ready):
        assert ready["foot_port"] is None
        yield str(ready["servo_port"])


@bears(0.01)
def test_the_easy_sdk(port: str) -> None:
    connector = Connector(port, 1_000_000)
    try:
        motors = connector.createAllMotors(1, 3)
        assert [motor.id for motor in motors] == [1, 2, 3]
        motor = connector.createMotor(2)
        motor.disableTorque()
        motor.setPositionPGain(800)
        motor.enableTorque()
        assert motor.isTorqueOn()
        motor.setGoalPosition(2300)
        assert eventually(lambda: abs(motor.getPresentPosition() - 2300) < 40)
        motor.disableTorque()
        motor.LEDOn()
        assert motor.isLEDOn()
        group = connector.createGroupExecutor()
        for each in motors:
            group.addCmd(each.stageGetPresentPosition())
        assert len(group.executeRead()) == 3
    finally:
        connector.closePort()


@bears(0.01)
def test_rustypot(port: str) -> None:
    client = rustypot.Xl330PyController(port, 1_000_000, 0.2)
    assert client.ping(1)
    assert not client.ping(9)
    ids = [1, 2, 3]
    client.sync_write_torque_enable(ids, [True] * 3)
    client.sync_write_goal_position(ids, [0.2, -0.2, 0.1])
    arrived = pytest.approx([0.2, -0.2, 0.1], abs=0.06)
    assert eventually(lambda client=client: client.sync_read_present_position(ids) == arrived)
    client.sync_write_torque_enable(ids, [False] * 3)
    del client  # closes its port


@bears(0.01)
def test_dynamixel_python(port: str) -> None:
    bus = MotorBus(port, 1_000_000)
    bus.connect()
    try:
        assert bus.ping(3).ok
        assert bus.write(3, 84, 2, 700).ok
        assert bus.read(3, 84, 2).data == 700
        assert bus.reg_write(3, 65, 1, 1).ok
        assert bus.read(3, 65, 1).data == 0
        assert bus.action(3).ok
        assert bus.read(3, 65, 1).data == 1
        fast = SyncParams(132, 4)
        bulk = BulkParams()
        for id in (1, 2, 3):
            fast.add_motor(id)
            bulk.add_address(id, 132, 4)
        for answer in (bus.sync_read(fast), bus.fast_sync_read(fast), bus.bulk_read(bulk)):
            assert answer.ok
            assert answer.data
            assert all(0 <= value < 4096 for value in answer.data)
    finally:
        bus.disconnect()
