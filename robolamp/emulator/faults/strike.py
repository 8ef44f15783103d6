"""What one-time faults do to a servo."""

from __future__ import annotations

from robolamp.dynamixel.registers import HardwareError, Name
from robolamp.emulator.faults.script import Event
from robolamp.emulator.servo.servo import Servo


def strike(servo: Servo, event: Event, time: float) -> None:
    """Let a servo reboot, lose its id, or trip its overload protection.

    Args:
        servo: The servo.
        event: What happens.
        time: When [s].
    """
    if event.what == "reboot":
        servo.reboot(time)
    elif event.what == "id_lost":
        servo.put(Name.ID, event.id)
    elif event.what == "overload":
        servo.fail(HardwareError.OVERLOAD)
