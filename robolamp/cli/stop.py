"""`robolamp stop`: releases a lamp that no program drives any more, or, by force, one that a program drives."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.cli.screen.output import print_json
from robolamp.errors import RobolampError
from robolamp.lamp import load_lamp
from robolamp.ports import Holder, check_serial, holders, holds

_GRACE = 6.0  # s after SIGTERM: a soft landing takes 1, unconfirmed servos are asked for 2, a deploy starts in 2
_KILLED = 2.0  # s after SIGKILL: what the kernel needs, and a slow driver
_LOOK = 0.05  # s: between two looks whether it is over


def stop(
    *,
    port: str | None = None,
    reboot: bool = False,
    force: Annotated[bool, Parameter(negative="")] = False,
    yes: Annotated[bool, Parameter(name=["--yes", "-y"], negative="")] = False,
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Turn every servo's torque off and clear its watchdog. Hold the lamp: it sinks.

    After kill -9 or a pulled plug the servos' watchdogs freeze the lamp with
    torque on; this releases it. Each servo is switched off on its own,
    whatever the others answer. Exit code 0: all confirmed; 1: some did not, switch the
    supply off.

    Args:
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        reboot: Restart servos that shut down for a hardware error, which clears it. Find the cause first.
        force: First end the program that uses the port, if it is yours: ask it to end (a deploy then lands softly),
            kill it after 6 seconds. If it is not robolamp, stop asks you first.
        yes: With --force, do not ask.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    if yes and not force:
        raise RobolampError("is for --force", "--yes")

    from robolamp.dynamixel.bus import SETTING_PATIENCE, Bus
    from robolamp.dynamixel.registers import MODELS, HardwareError
    from robolamp.dynamixel.servos import Servos
    from robolamp.runtime.clock import MonotonicClock

    description = load_lamp(Assets.of(lamp))
    names = {joint.id: joint.name for joint in description.joints}
    bus = Bus(
        port or description.bus_port, description.bus_baud, MonotonicClock(), labels=names, patience=SETTING_PATIENCE
    )
    ended = _end(bus.name, asks=not (yes or as_json), may_ask=sys.stdin.isatty(), yes=yes) if force else {}
    bus.open()
    sharing = holders(bus.name)  # who did not lock it, as robolamp does
    try:
        joints = description.joints
        servos = Servos(bus, [joint.id for joint in joints], [MODELS[joint.servo] for joint in joints])
        failed = servos.torque_off()
        errors = servos.hardware_errors()
        rebooted = [index for index, error in enumerate(errors) if reboot and error > 0]
        for index in rebooted:
            bus.reboot(joints[index].id)
    finally:
        bus.close()
    for holder in sharing:
        print(f"robolamp: {holder} uses {bus.name}, too, and may move the lamp; --force ends it", file=sys.stderr)
    released = [joint.name for index, joint in enumerate(joints) if index not in failed]
    left = [joint.name for index, joint in enumerate(joints) if index in failed]
    if len(left) == len(joints):
        raise RobolampError(
            f"no servo confirms that its torque is off ({', '.join(left)}); switch the supply off", bus.name
        )
    words = {joint.name: HardwareError.words(error) for joint, error in zip(joints, errors, strict=True) if error > 0}
    if as_json:
        print_json(
            {
                "released": released,
                "not_confirmed": left,
                "hardware_errors": words,
                "rebooted": [joints[index].name for index in rebooted],
                "ended": [{**_row(holder), "killed": killed} for holder, killed in ended.items()],
                "also_open": [_row(holder) for holder in sharing],
            }
        )
    else:
        for holder, killed in ended.items():
            print(f"{'killed' if killed else 'ended'}: {holder}")
        print(f"torque off: {', '.join(released)}")
        for index, (name, text) in enumerate(words.items()):
            done = "rebooted" if index < len(rebooted) else "only a reboot (--reboot) or its supply clears it"
            print(f"{name}: hardware error ({text}); {done}")
        if left:
            print(f"not confirmed: {', '.join(left)}; switch the supply off")
    return 1 if left else 0


def _row(holder: Holder) -> dict[str, Any]:
    return {"pid": holder.pid, "command": holder.command}


def _end(port: str, *, asks: bool, may_ask: bool, yes: bool) -> dict[Holder, bool]:
    """End the processes that have a port open, and return them, each with whether it had to be killed.

    Raises:
        RobolampError: It is no serial port; one is another user's, may not be ended, or does not end.
    """
    check_serial(port, "--port, or bus.port in hardware/lamp.toml")
    found = holders(port)
    for holder in found:
        if holder.user != os.getuid():
            raise RobolampError(f"{holder} is of another user; only yours are ended", port)
    for holder in found:
        if holder.robolamp or yes:
            continue
        if not (asks and may_ask):
            raise RobolampError(f"{holder} is not robolamp, and there is no terminal to ask at; --yes ends it", port)
        if not _agreed(f"{holder} uses {port}, and is not robolamp. End it? [y/N] "):
            raise RobolampError(f"{holder} goes on; nothing was ended", port)
    return {holder: _ended(holder, port) for holder in found}


def _agreed(question: str) -> bool:
    print(question, end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in {"y", "yes"}


def _ended(holder: Holder, port: str) -> bool:
    """End a process; return whether it had to be killed."""
    for number, patience in ((signal.SIGTERM, _GRACE), (signal.SIGKILL, _KILLED)):
        with contextlib.suppress(ProcessLookupError):
            if holds(holder.pid, port):
                os.kill(holder.pid, number)
                os.kill(holder.pid, signal.SIGCONT)  # one that Ctrl-Z suspended hears it only then
        end = time.monotonic() + patience
        while holds(holder.pid, port):
            if time.monotonic() > end:
                break
            time.sleep(_LOOK)
        else:
            return number == signal.SIGKILL
    raise RobolampError(f"{holder} does not end; switch the supply off", port)
