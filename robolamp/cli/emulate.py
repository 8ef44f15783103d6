"""`robolamp emulate`: the emulated lamp, for any client."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.output import print_json
from robolamp.errors import FileError
from robolamp.lamp import Lamp, load_lamp
from robolamp.runtime.stop import StopRequest


def emulate(
    *,
    lamp: Path | None = None,
    calibration: str = "nominal",
    reality: str = "worn",
    truth: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run an emulated lamp until Ctrl-C: Dynamixel servos and a foot sensor.

    Each is behind a serial port of its own that any client can open; the
    lamp's physics runs behind them in real time. The lamp starts upright, each
    joint held as if by hand until its torque is first turned on. To stand it
    up again, start the emulator again. What it models and what it does not is
    in docs/emulator.md.

    Args:
        lamp: Your own lamp's folder (laid out like robolamp's: hardware/, sim/, calibration/).
        calibration: Calibration file, or the name of one: what the physics is calculated with.
        reality: How this lamp differs from that calibration: a file, the name of one ("worn"), or "none".
        truth: Write what really happens (base, contacts, true angles) to this MCAP log.
        as_json: Print one JSON line when ready, and end with the process that started this one.
    """
    parent = os.getppid()
    with StopRequest() as stop:  # before all that takes seconds to load
        from robolamp.emulator.lamp import EmulatedLamp  # mujoco is loaded after the arguments are checked
        from robolamp.emulator.process import REAL_TIME_GAP, Process
        from robolamp.emulator.reality import load_reality
        from robolamp.emulator.truth import TruthLog
        from robolamp.log.context import versions

        assets = Assets.of(lamp)
        description = load_lamp(assets)
        numbers = load_calibration(assets, calibration)
        bent = load_reality(reality, description, assets)
        emulated = EmulatedLamp(description, numbers, assets, bent, gap=REAL_TIME_GAP)
        start = time.monotonic()
        log = None
        if truth is not None:
            context = {"backend": "emulator", "lamp": description.source, "calibration": numbers.source}
            log = TruthLog(truth, emulated, start, {**context, "reality": bent.name, "versions": versions()})
        process = Process(emulated, start, log.shift if log else None)
        try:
            if as_json:
                print_json(
                    {
                        "servo_port": process.servo_port,
                        "foot_port": process.foot_port,
                        "servos": [
                            {"joint": joint.name, "id": joint.id, "model": joint.servo} for joint in description.joints
                        ],
                        "pid": os.getpid(),
                    }
                )
            else:
                print(
                    _description(process.servo_port, process.foot_port, bent.name, numbers.name, description),
                    flush=True,
                )
            process.run(lambda: bool(stop.requests) or (as_json and os.getppid() != parent))
        finally:
            process.close()
            if log:
                log.close()
    if log and log.error:
        raise FileError(f"the truth log ended early: {log.error}", str(truth))
    return 0


def _description(servo_port: str, foot_port: str, reality: str, calibration: str, lamp: Lamp) -> str:
    servos = ", ".join(f"{joint.name} = {joint.servo} id {joint.id}" for joint in lamp.joints)
    return "\n".join(
        [
            f"servo port  {servo_port}   protocol 2.0, {lamp.bus_baud} baud: {servos}",
            f"foot port   {foot_port}   a frame every 2 ms (hardware/firmware/README.md)",
            f"plant       {lamp.name}: calibration {calibration}, reality {reality}, in real time; standing, held",
            "answers     ping, read, write, sync read, sync write, reboot; EEPROM lock, ranges, limits, bus watchdog",
            "models      P gain, PWM goal, back-EMF, friction, delay, encoder steps, wire time, return delay",
            "not yet     fast sync and bulk, reg write, indirect addresses, modes other than position, profiles,",
            "            D and I gain, temperature, voltage sag, hardware errors (docs/emulator.md)",
            "Ctrl-C ends it.",
        ]
    )
