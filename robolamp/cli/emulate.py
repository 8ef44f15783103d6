"""`robolamp emulate`: the emulated lamp, or servos without one, for any client."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.cli.screen.output import counted, print_json
from robolamp.errors import RobolampError
from robolamp.files import alone
from robolamp.runtime.stop import StopRequest


def emulate(
    *,
    lamp: Path | None = None,
    calibration: str | None = None,
    reality: str | None = None,
    truth: Path | None = None,
    servos: Path | None = None,
    factory: Annotated[bool, Parameter(negative="")] = False,
    eeprom: Path | None = None,
    faults: Path | None = None,
    injections: Path | None = None,
    ports: Path | None = None,
    traffic: Annotated[bool, Parameter(negative="")] = False,
    lateness: Annotated[bool, Parameter(negative="")] = False,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Run an emulated lamp, or servos without one, until Ctrl-C.

    Servos and foot sensor answer on one serial port each, which any client can
    open; the lamp's physics runs behind them in real time. The lamp starts
    upright, each joint held as if by hand until its torque is first turned on.
    To stand it up again, start the emulator again. docs/emulator.md says what
    it models and what it does not.

    Args:
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        calibration: Calibration, the numbers of the physics: a file, or a name in calibration/ (nominal).
        reality: Reality, which says how this lamp differs from that calibration: none, a file, or the name of one
            (worn); random:SEED: everything differs; knob:KIND:SEED: one number does, as knob:backlash:7.
        truth: Write a truth log: what really happens (base, contacts, true angles), as MCAP, to this file.
        servos: Instead of a lamp, the servos of this TOML file, each with a motor of its own.
        factory: New servos (id 1, 57600 baud), only the first plugged in; Enter or SIGUSR1 plugs the next one in.
        eeprom: A folder that keeps each servo's EEPROM from one start to the next.
            What it holds overrides the description of the lamp or the servos.
        faults: A TOML script of faults to inject, and when.
        injections: Write one line of JSON to this file for each fault that was injected.
        ports: A folder for links "servo" and "foot" to the ports; they stay when a fault unplugs a port.
            For one emulator at a time.
        traffic: Show each packet on the servo port in words, on stderr.
        lateness: Print at the end how late this busy computer served the ports; with --json also when.
        as_json: Print one JSON line when ready, and end with the process that started this one.
    """
    parent = os.getppid()
    with StopRequest() as stop, contextlib.ExitStack() as closing:  # before all that takes seconds to load
        for_a_lamp = {"--lamp": lamp, "--calibration": calibration, "--reality": reality, "--truth": truth}
        for option, value in for_a_lamp.items():
            if servos is not None and value is not None:
                raise RobolampError("cannot be used with --servos: there is no lamp", option)
        from robolamp.cli.run.emulator_parts import Hand, InjectionLog, bare_rig, check_logs, lamp_rig
        from robolamp.emulator.line.traffic import Traffic
        from robolamp.emulator.ports.real_time import Process

        if servos is not None:
            rig = bare_rig(servos, faults, factory, eeprom)
        else:
            rig = lamp_rig(lamp, calibration or "nominal", reality or "worn", faults, factory, eeprom)
        if rig.faults.unplugs and ports is None:
            raise RobolampError("unplugs a port; give --ports DIR, whose links stay", str(faults))
        if ports is not None:
            closing.enter_context(alone(ports))
        report = InjectionLog(injections)
        closing.callback(report.close)
        rig.world.injector.report = report.write
        start = time.monotonic()
        log = None
        if truth is not None and rig.lamp is not None:
            from robolamp.emulator.emulated_lamp import EmulatedLamp
            from robolamp.emulator.truth_log import TruthLog
            from robolamp.log.run_context import versions

            description, numbers, bent = rig.lamp
            context = {"backend": "emulator", "lamp": description.source, "calibration": numbers.source}
            assert isinstance(rig.world, EmulatedLamp)
            log = TruthLog(truth, rig.world, start, {**context, "reality": bent.name, "versions": versions()})
            closing.callback(log.close)
        process = Process(
            rig.world,
            start,
            log.shift if log else None,
            links=ports.absolute() if ports else None,
            foot=rig.foot,
            traffic=Traffic(rig.models, _tell) if traffic else None,
        )
        closing.callback(process.close)
        hand = closing.enter_context(Hand(rig, enter=factory and not as_json and sys.stdin.isatty(), say=_tell))
        if as_json:
            print_json(
                {
                    "servo_port": process.servo_port,
                    "foot_port": process.foot_port,
                    "servos": [{"joint": servo.name, "id": servo.id, "model": servo.model} for servo in rig.servos],
                    "pid": os.getpid(),
                }
            )
        else:
            print("\n".join(rig.lines(process.servo_port, process.foot_port)), flush=True)
            if factory:
                print(f"plugged in: {rig.servos[0].name}; Enter plugs the next one in", flush=True)

        def ended() -> bool:
            hand.poll()
            return bool(stop.requests) or (as_json and os.getppid() != parent)

        process.run(ended)
    if lateness and as_json:
        print_json({"late": process.late.spans})  # of the monotonic clock: when it was due, when it was done [s]
    elif lateness:
        worst, count = process.late.worst(start, math.inf), counted(len(process.late.spans), "time")
        print(f"served late {count}, by {worst * 1e3:.0f} ms at most", flush=True)
    check_logs(log, report)
    return 0


def _tell(line: str) -> None:
    with contextlib.suppress(OSError):  # nobody reads it any more
        print(line, file=sys.stderr, flush=True)
