"""The emulated lamp behind real serial ports, driven by the loop that drives a physical one."""

import json
import subprocess
import sys

from robolamp.assets import Assets
from robolamp.controller.controller_file import load_controller
from robolamp.controller.pilot import Pilot
from robolamp.lamp import load_lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.runtime.clock import MonotonicClock
from robolamp.runtime.loop import run
from robolamp.runtime.stop import StopRequest


def main() -> None:
    assets = Assets()
    lamp = load_lamp(assets)
    controller = load_controller(assets.named("hop", "sim/lamp/controllers", "controller"), lamp, on_board=True)
    command = [sys.executable, "-m", "robolamp", "emulate", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator, StopRequest() as stop:
        assert emulator.stdout
        ports = json.loads(emulator.stdout.readline())
        # For the physical lamp: RobotLamp(lamp, "/dev/ttyUSB0", "/dev/ttyACM0", ...), and nothing else changes.
        robot = RobotLamp(lamp, ports["servo_port"], ports["foot_port"], MonotonicClock(), patience=0.006)
        try:
            robot.open()
            result = run(robot, Pilot(controller, lamp, goal=0.10), lamp, duration=2.0, stop=stop)
        finally:
            robot.close()
            emulator.terminate()
    print(f"{result.ended}: {result.hops} hops in {result.ticks} ticks, {result.missed_ticks} missed")


if __name__ == "__main__":
    main()
