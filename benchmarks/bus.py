"""A tick of the loop against the time its bytes alone take on the wire, and against other Python clients.

One emulated lamp (three XL330, 1 Mbps, replies held back for their time on the wire) in a process of its own; every
client in turn, round after round, reads the three servos and sends them goals, ticks back to back. First the clients
that read all that robolamp's tick reads (position, velocity, current, duty, voltage, temperature, torque, error), by
whatever calls each has for it; then, apart, those that read positions alone. dynamixel-sdk and rustypot read all of it
in two ways: from where the registers are, and from the health block that robolamp has mapped, which by themselves they
do not map. Medians; ratios are medians of the ratios in each round. "CPU" is the client's own time on the processor.

lerobot asks for torch, which its bus does not need: `pip install --no-deps lerobot "deepdiff<9" orderly-set tqdm`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import statistics
import subprocess
import sys
import time
import types
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from dynamixel_easy_sdk import Connector, DxlRuntimeError

from robolamp.assets import Assets
from robolamp.dynamixel.bus import Bus
from robolamp.dynamixel.health_block import LENGTHS
from robolamp.dynamixel.registers import MODELS, RAD_PER_COUNT
from robolamp.dynamixel.servos import Servos
from robolamp.dynamixel.wire_time import CONDITION, STATE, Transport, wire_time
from robolamp.errors import RobolampError
from robolamp.lamp import load_lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.runtime.clock import MonotonicClock
from robolamp.signals import Command

IDS = [1, 2, 3]
BAUD = 1_000_000
BLOCK = (208, LENGTHS[0])  # where robolamp has mapped its health block, which peers then may read too
SPANS = (STATE, CONDITION)  # where the same registers are in the control table
SIZES = [size for _, size in SPANS]  # bytes
CENTRE = 2048  # counts
OPENINGS = 5  # how often a client may try to open: on a busy machine servos answer late
SYNC_READ, SYNC_WRITE = 10 + 4 + len(IDS), 10 + 4 + 5 * len(IDS)  # bytes of the instructions (e-manual, protocol 2.0)

Tick = Callable[[], bool]
"""Read and write once; return whether every servo answered."""


@dataclass(frozen=True)
class Client:
    """A client: what it reads, and the bytes of its tick on the wire."""

    name: str
    reads: str
    wire: float  # bytes
    opened: Callable[[str, str], contextlib.AbstractContextManager[Tick]]


def sync_bytes(*lengths: float) -> float:
    """Return the bytes of a tick of sync reads of so many bytes a servo, and one sync write."""
    return SYNC_WRITE + sum(SYNC_READ + len(IDS) * (11 + length) for length in lengths)


@contextlib.contextmanager
def robolamp(port: str, foot: str) -> Iterator[Tick]:
    backend = RobotLamp(load_lamp(Assets()), port, foot, MonotonicClock(), patience=0.2)
    backend.open()
    goal = Command(np.zeros(len(IDS)))

    def tick() -> bool:
        seen = backend.observe()
        backend.command(goal)
        return bool(np.isfinite(seen.angle).all())

    yield tick
    backend.close()


@contextlib.contextmanager
def bus_alone(port: str, _: str) -> Iterator[Tick]:
    bus = Bus(port, BAUD, MonotonicClock(), patience=0.2)
    bus.open()
    servos = Servos(bus, IDS, [MODELS["XL330-M288-T"]] * len(IDS))
    servos.prepare([identity.firmware for servo in IDS if (identity := bus.ping(servo)) is not None])
    goal = np.full(len(IDS), CENTRE * RAD_PER_COUNT)

    def tick() -> bool:
        state = servos.read()
        servos.write_goals(goal)
        return bool(np.isfinite(state.position).all())

    yield tick
    bus.close()


@contextlib.contextmanager
def plain_sdk(port: str, *spans: tuple[int, int]) -> Iterator[Tick]:
    from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler

    handler, packets = PortHandler(port), PacketHandler(2.0)
    handler.openPort()
    handler.setBaudRate(BAUD)
    reads = [GroupSyncRead(handler, packets, *span) for span in spans]
    write = GroupSyncWrite(handler, packets, 116, 4)
    for servo in IDS:
        for read in reads:
            read.addParam(servo)

    def tick() -> bool:
        results = [read.txRxPacket() for read in reads]
        write.clearParam()
        for servo in IDS:
            write.addParam(servo, list(CENTRE.to_bytes(4, "little")))
        write.txPacket()
        return all(result == COMM_SUCCESS for result in results)

    yield tick
    handler.closePort()


@contextlib.contextmanager
def easy_sdk(port: str, _: str) -> Iterator[Tick]:
    connector = Connector(port, BAUD)
    motors = [connector.createMotor(servo) for servo in IDS]
    group = connector.createGroupExecutor()

    def tick() -> bool:
        group.clearStagedReadCommands()
        group.clearStagedWriteCommands()
        for motor in motors:
            group.addCmd(motor.stageGetPresentPosition())
        answers = group.executeRead()
        for motor in motors:
            group.addCmd(motor.stageSetGoalPosition(CENTRE))
        group.executeWrite()
        return len(answers) == len(IDS)

    for motor in motors:
        motor.enableTorque()  # it refuses to set goals without
    yield tick
    for motor in motors:
        motor.disableTorque()
    connector.closePort()


@contextlib.contextmanager
def rusty(port: str, *spans: tuple[int, int]) -> Iterator[Tick]:
    import rustypot

    client = rustypot.Xl330PyController(port, BAUD, 0.2)

    def tick() -> bool:
        answers = [client.sync_read_raw_data(IDS, *span) for span in spans]
        client.sync_write_raw_goal_position(IDS, [CENTRE] * len(IDS))
        return all(len(answer) == len(IDS) for answer in answers)

    yield tick  # it closes its port when nothing holds it any more


@contextlib.contextmanager
def python(port: str, _: str) -> Iterator[Tick]:
    from dxl2.v2 import MotorBus, SyncParams

    bus = MotorBus(port, BAUD)
    bus.connect()
    read = SyncParams(132, 4)
    for servo in IDS:
        read.add_motor(servo)

    def tick() -> bool:
        answered = bus.sync_read(read).ok
        write = SyncParams(116, 4)
        for servo in IDS:
            write.add_value(servo, CENTRE)
        bus.sync_write(write)
        return bool(answered)

    yield tick
    bus.disconnect()


@contextlib.contextmanager
def lerobot(port: str, names: tuple[str, ...]) -> Iterator[Tick]:
    if "lerobot.utils.utils" not in sys.modules:  # it imports torch, for nothing that the bus uses
        stub = types.ModuleType("lerobot.utils.utils")
        stub.enter_pressed = stub.move_cursor_up = lambda *_: None  # type: ignore[attr-defined]
        sys.modules["lerobot.utils.utils"] = stub
    from lerobot.motors import Motor, MotorNormMode  # pyright: ignore[reportMissingImports]
    from lerobot.motors.dynamixel import DynamixelMotorsBus  # pyright: ignore[reportMissingImports]

    motors = {f"joint{servo}": Motor(servo, "xl330-m288", MotorNormMode.DEGREES) for servo in IDS}
    bus = DynamixelMotorsBus(port, motors)
    bus.connect()
    goals = dict.fromkeys(motors, CENTRE)

    def tick() -> bool:
        answers = [bus.sync_read(name, normalize=False) for name in names]
        bus.sync_write("Goal_Position", goals, normalize=False)
        return all(len(answer) == len(IDS) for answer in answers)

    yield tick
    bus.disconnect(disable_torque=False)


POSITION, WHOLE = "position", "whole"
TITLES = {WHOLE: "the same reads and writes", POSITION: "positions only, the same writes"}
NAMES = {  # of lerobot's table, each with its bytes
    "Present_PWM": 2, "Present_Current": 2, "Present_Velocity": 4, "Present_Position": 4, "Present_Input_Voltage": 2,
    "Present_Temperature": 1, "Torque_Enable": 1, "Hardware_Error_Status": 1,
}  # fmt: skip
FAST = wire_time("tick", len(IDS), BAUD, Transport.FAST) * BAUD / 10

CLIENTS = (
    Client("robolamp", WHOLE, FAST, robolamp),
    Client("robolamp's bus alone", WHOLE, FAST, bus_alone),
    Client("dynamixel-sdk, group reads", WHOLE, sync_bytes(*SIZES), lambda port, _: plain_sdk(port, *SPANS)),
    Client("dynamixel-sdk, robolamp's block", WHOLE, sync_bytes(BLOCK[1]), lambda port, _: plain_sdk(port, BLOCK)),
    Client("dynamixel-sdk, group reads", POSITION, sync_bytes(4), lambda port, _: plain_sdk(port, (132, 4))),
    Client("rustypot", WHOLE, sync_bytes(*SIZES), lambda port, _: rusty(port, *SPANS)),
    Client("rustypot, robolamp's block", WHOLE, sync_bytes(BLOCK[1]), lambda port, _: rusty(port, BLOCK)),
    Client("rustypot", POSITION, sync_bytes(4), lambda port, _: rusty(port, (132, 4))),
    Client("dynamixel_easy_sdk", POSITION, sync_bytes(4), easy_sdk),
    Client("dynamixel-python", POSITION, sync_bytes(4), python),
    Client("lerobot", WHOLE, sync_bytes(*NAMES.values()), lambda port, _: lerobot(port, tuple(NAMES))),
    Client("lerobot", POSITION, sync_bytes(4), lambda port, _: lerobot(port, ("Present_Position",))),
)


@contextlib.contextmanager
def emulator() -> Iterator[dict[str, str]]:
    """Start an emulated lamp and yield its ports."""
    command = [sys.executable, "-m", "robolamp", "emulate", "--json", "--reality", "none"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()


def timed(tick: Tick, ticks: int) -> tuple[float, float, int]:
    """Return medians of the ticks in which all answered, time and CPU time [s], and the number of the others."""
    times: list[float] = []
    work: list[float] = []
    for index in range(ticks + 5):  # the first few only warm up
        began, worked = time.perf_counter(), time.process_time()
        try:
            answered = tick()
        except Exception:  # each client raises another one for a missing answer
            answered = False
        if index >= 5 and answered:
            times.append(time.perf_counter() - began)
            work.append(time.process_time() - worked)
    if not times:
        return math.nan, math.nan, ticks
    return statistics.median(times), statistics.median(work), ticks - len(times)


def turn(client: Client, ports: dict[str, str], ticks: int) -> tuple[float, float, int]:
    """Let a client have its turn; see `timed`. One that meets no servo tries to open again."""
    for _ in range(OPENINGS):
        with (
            contextlib.suppress(OSError, RuntimeError, RobolampError, DxlRuntimeError),
            client.opened(ports["servo_port"], ports["foot_port"]) as tick,
        ):
            return timed(tick, ticks)
    return math.nan, math.nan, ticks


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, help="how often each client has its turn (9)")
    parser.add_argument("--ticks", type=int, default=300, help="ticks a turn (300)")
    options = parser.parse_args()
    found: dict[Client, list[float]] = {client: [] for client in CLIENTS}
    worked: dict[Client, list[float]] = {client: [] for client in CLIENTS}
    failed: Counter[Client] = Counter()
    absent: dict[Client, str] = {}
    with emulator() as ports:
        for _ in range(options.rounds):
            for client in CLIENTS:
                if client in absent:
                    continue
                try:
                    middle, work, missed = turn(client, ports, options.ticks)
                except ImportError as error:
                    absent[client] = str(error)
                    continue
                found[client].append(middle)
                worked[client].append(work)
                failed[client] += missed
    heads = ("wire ms", "tick ms", "tick / wire", "/ robolamp", "CPU ms", "failed")
    ours = found[CLIENTS[0]]
    titled = ""
    for client in sorted(CLIENTS, key=lambda client: list(TITLES).index(client.reads)):
        if client.reads != titled:
            titled = client.reads
            print(f"{TITLES[titled]:<37}" + "".join(f"{head:>12}" for head in heads))
        wire, times = client.wire * 10 / BAUD, found[client]
        head = f"  {client.name:<35}{wire * 1e3:12.2f}"
        if client in absent:
            print(f"{head}  not measured: {absent[client]}")
            continue
        middle, work = float(np.nanmedian(times)), float(np.nanmedian(worked[client]))
        ratio = float(np.nanmedian(np.array(times) / np.array(ours)))
        print(f"{head}{middle * 1e3:12.2f}{middle / wire:12.2f}{ratio:12.2f}{work * 1e3:12.2f}{failed[client]:12}")


if __name__ == "__main__":
    main()
