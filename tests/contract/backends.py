"""The lamp backends that keep the contract, each as a context manager."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import load_reality
from robolamp.lamp import load_lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.signals import LampBackend
from robolamp.twin.lamp_model import build
from robolamp.twin.twin_lamp import TwinLamp

LAMP = load_lamp(Assets())
PATIENCE, OPENING = 0.02, 1.0  # s: in the loop, and before it, where a busy test machine may take its time


@contextlib.contextmanager
def emulator() -> Iterator[tuple[subprocess.Popen[str], str, str]]:
    """An emulated lamp in a process of its own: the process, its servo port and its foot port."""
    command = [sys.executable, "-m", "robolamp", "emulate", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            ports = json.loads(process.stdout.readline())
            yield process, ports["servo_port"], ports["foot_port"]
        finally:
            process.terminate()
            process.communicate(timeout=60)


@contextlib.contextmanager
def robot_on_emulator() -> Iterator[LampBackend]:
    """The driver on the emulator, to the byte, in virtual time; over pseudo-terminals: tests/robot/test_emulated.py."""
    world = EmulatedLamp(LAMP, load_calibration(Assets()), Assets(), load_reality("worn", LAMP, Assets()))
    ports = Lockstep(world, LAMP.bus_baud)
    lamp = RobotLamp(LAMP, ports.servo_port, ports.foot_port, ports.clock)
    try:
        yield lamp
    finally:
        lamp.close()


@contextlib.contextmanager
def twin() -> Iterator[LampBackend]:
    """The twin, in virtual time."""
    lamp = TwinLamp(build(LAMP, load_calibration(Assets()), Assets()))
    try:
        yield lamp
    finally:
        lamp.close()


BACKENDS: dict[str, Callable[[], AbstractContextManager[LampBackend]]] = {
    "robot on the emulator": robot_on_emulator,
    "twin": twin,
}
