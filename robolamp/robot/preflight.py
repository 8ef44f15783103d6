"""What must be right before torque goes on: each finding names what is wrong and how to mend it."""

from __future__ import annotations

import math

import numpy as np

from robolamp.dynamixel.bus import Bus
from robolamp.dynamixel.registers import MODELS, HardwareError, Model, Name, OperatingMode, model_by_number
from robolamp.dynamixel.servos import Servos
from robolamp.errors import BusError, SafetyError
from robolamp.foot.sensor import FootSensor
from robolamp.lamp import Joint, Lamp
from robolamp.robot.frame import JointFrame
from robolamp.signals import Clock

FOOT_WAIT = 0.5
"""How long a foot sensor has for its first frame [s]; at 500 Hz it needs 2 ms."""

_POLL = 0.002  # s: between two looks at the foot sensor


def check_servos(lamp: Lamp, bus: Bus) -> list[Model]:
    """Ping every servo of the lamp.

    Returns:
        Their models, in the order of the joints.

    Raises:
        BusError: One does not answer.
        SafetyError: One is another model than the lamp's description says.
    """
    models: list[Model] = []
    for joint in lamp.joints:
        identity = bus.ping(joint.id)
        if identity is None:
            raise BusError(
                f"{bus.label(joint.id)} does not answer to a ping at {lamp.bus_baud} baud; check its supply, its cable "
                f"and its id (as in {lamp.path.name})",
                bus.name,
            )
        expected = MODELS[joint.servo]
        if identity.model_number != expected.number:
            found = model_by_number(identity.model_number)
            name = found.name if found else f"model number {identity.model_number}"
            raise SafetyError(f"{bus.label(joint.id)} is {name}; {lamp.path.name} says {joint.servo}", bus.name)
        models.append(expected)
    return models


def check_state(lamp: Lamp, bus: Bus, servos: Servos) -> None:
    """Check the servos' settings and state against the lamp's description; nothing is written.

    Raises:
        SafetyError: Something is wrong; the message names everything that is, each with its remedy.
        BusError: A servo does not answer.
    """
    frame = JointFrame(lamp)
    state = servos.read()
    angle = frame.joint_angle(state.position)
    ends = np.sort(np.stack([frame.servo_angle(lamp.lower), frame.servo_angle(lamp.upper)]), axis=0)
    findings: list[str] = []
    for index, joint in enumerate(lamp.joints):
        label = bus.label(joint.id)
        findings += [f"{label}: {finding}" for finding in _settings(servos, index, ends[0, index], ends[1, index])]
        error, voltage = int(state.hardware_error[index]), float(state.voltage[index])
        if error < 0 or math.isnan(voltage) or math.isnan(angle[index]):
            raise BusError(f"{label} answers to a ping, but not to a sync read", bus.name)
        findings += [f"{label}: {finding}" for finding in _state(servos, index, joint, error, voltage)]
        low, high = joint.lower - lamp.preflight_angle, joint.upper + lamp.preflight_angle
        if not low <= angle[index] <= high:
            findings.append(
                f"{label}: stands at {angle[index]:.2f} rad, outside {low:.2f} to {high:.2f}; put the lamp upright by "
                f"hand, or set sign and zero in {lamp.path.name}"
            )
    if findings:
        raise SafetyError("not ready: " + "; ".join(findings), bus.name)


def _settings(servos: Servos, index: int, first: float, last: float) -> list[str]:
    found: list[str] = []
    mode = int(servos.value(index, Name.OPERATING_MODE))
    if mode != OperatingMode.POSITION:
        found.append(f"Operating Mode(11) is {mode}, not 3 (position); write 3 with torque off")
    drive = int(servos.value(index, Name.DRIVE_MODE))
    if drive != 0:
        found.append(f"Drive Mode(10) is {drive}, not 0 (normal, velocity profile); write 0 with torque off")
    low, high = servos.value(index, Name.MIN_POSITION_LIMIT), servos.value(index, Name.MAX_POSITION_LIMIT)
    if first < low or last > high:
        found.append(
            f"the joint's range is {first:.2f} to {last:.2f} rad of the servo's turn, outside its Position Limits "
            f"(52, 48) of {low:.2f} to {high:.2f}; widen them, or mount the horn so that the range does not cross 0"
        )
    return found


def _state(servos: Servos, index: int, joint: Joint, error: int, voltage: float) -> list[str]:
    found: list[str] = []
    if error:
        words = HardwareError.words(error)
        found.append(f"Hardware Error Status(70) is {error:#04x} ({words}); find the cause, then power it off and on")
    low, high = servos.value(index, Name.MIN_VOLTAGE_LIMIT), servos.value(index, Name.MAX_VOLTAGE_LIMIT)
    if not low <= voltage <= high:
        found.append(f"has {voltage:.1f} V, outside its limits of {low:.1f} to {high:.1f} V; check the supply")
    return found


def check_foot(foot: FootSensor, clock: Clock) -> None:
    """Wait for the foot sensor's first frame.

    Raises:
        BusError: None came within FOOT_WAIT, or the port is gone.
        SafetyError: The microcontroller answers and says that the sensor is not connected.
    """
    deadline = clock.now() + FOOT_WAIT
    while not foot.poll():
        if clock.now() >= deadline:
            heard = foot.decoder.discarded
            said = f"{heard} bytes came, but no frame" if heard else "nothing came"
            raise BusError(
                f"no foot sensor: {said} in {FOOT_WAIT:g} s; is the sensor powered, and is this its port?", foot.name
            )
        clock.sleep_until(clock.now() + _POLL)
    if foot.newest is not None and foot.newest.disconnected:
        raise SafetyError("the foot sensor reports that its load cell is not connected; check its cable", foot.name)
