"""`robolamp stop`: releases a lamp that nobody drives any more."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.cli.output import print_json
from robolamp.errors import RobolampError
from robolamp.lamp import load_lamp


def stop(
    *,
    port: str | None = None,
    reboot: bool = False,
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Turn every servo's torque off and clear its watchdog. Hold the lamp: it sinks.

    After kill -9 or a pulled plug the servos' watchdogs freeze the lamp with
    torque on; this releases it. Each servo is told on its own, whatever the
    others answer. Exit code 0: all confirmed; 1: some did not, switch the
    supply off.

    Args:
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        reboot: Restart servos that shut down for a hardware error, which clears it. Find the cause first.
        lamp: A folder of your own lamp, laid out like robolamp's.
        as_json: Print one JSON object.
    """
    from robolamp.dynamixel.bus import SETTING_PATIENCE, Bus
    from robolamp.dynamixel.registers import MODELS, HardwareError
    from robolamp.dynamixel.servos import Servos
    from robolamp.runtime.clock import MonotonicClock

    description = load_lamp(Assets.of(lamp))
    names = {joint.id: joint.name for joint in description.joints}
    bus = Bus(
        port or description.bus_port, description.bus_baud, MonotonicClock(), labels=names, patience=SETTING_PATIENCE
    )
    bus.open()
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
            }
        )
    else:
        print(f"torque off: {', '.join(released)}")
        for index, (name, text) in enumerate(words.items()):
            done = "rebooted" if index < len(rebooted) else "only a reboot (--reboot) or its supply clears it"
            print(f"{name}: hardware error ({text}); {done}")
        if left:
            print(f"not confirmed: {', '.join(left)}; switch the supply off")
    return 1 if left else 0
