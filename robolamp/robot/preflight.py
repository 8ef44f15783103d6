"""What must be right before torque goes on: each finding names what is wrong and how to mend it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robolamp.dynamixel.bus import Bus, Identity
from robolamp.dynamixel.registers import MODELS, HardwareError, Model, model_by_number
from robolamp.dynamixel.servos import Servos
from robolamp.errors import BusError, FileError, SafetyError
from robolamp.files import read_text
from robolamp.foot.sensor import FootSensor
from robolamp.lamp import Joint, Lamp
from robolamp.robot.frame import JointFrame
from robolamp.robot.settings import limits_of, wrong_settings
from robolamp.signals import Clock

FOOT_WAIT = 0.5
"""How long a foot sensor has for its first frame, and for a force that a standing lamp can have [s]."""

FOOT_MOST = 10.0
"""Largest force that a foot sensor may show while the lamp stands [N]: five times what the lamp of hardware/ weighs."""

WARM = 55.0
"""Temperature above which a servo is not started [degC]: 10 below the loop's limit, some minutes of hopping."""

LOOKS = 5
"""How often all servos are read at most until each has told its state: a noisy line loses an answer now and then."""

SYSFS = Path("/sys/bus/usb-serial/devices")
"""Where Linux keeps the latency timers of USB serial adapters."""

_POLL = 0.002  # s: between two looks at the foot sensor


@dataclass(frozen=True)
class Finding:
    """Something that must be mended before torque goes on.

    Attributes:
        text: What is wrong, and how to mend it.
        fix: Mends it by software; None where hands are needed.
    """

    text: str
    fix: Callable[[], None] | None = None


def check_servos(lamp: Lamp, bus: Bus) -> tuple[list[Model], list[Identity]]:
    """Ping every servo of the lamp.

    Returns:
        Their models and what they answered, in the order of the joints.

    Raises:
        BusError: One does not answer.
        SafetyError: One is another model than the lamp's description says.
    """
    models: list[Model] = []
    identities: list[Identity] = []
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
        identities.append(identity)
    return models, identities


def check_state(lamp: Lamp, bus: Bus, servos: Servos, *, fix: bool = False) -> list[str]:
    """Check the servos' settings and state, and the port, against the lamp's description.

    Args:
        lamp: Its description.
        bus: The open bus.
        servos: The lamp's servos on it.
        fix: Mend what software may mend (settings in EEPROM, the latency timer); otherwise nothing is written.

    Returns:
        What was mended, one text each.

    Raises:
        SafetyError: Something is wrong; the message names everything that is, each with its remedy.
        BusError: A servo does not answer.
    """
    found = findings(lamp, bus, servos)
    mended: list[str] = []
    if fix:
        for finding in found:
            if finding.fix is not None:
                finding.fix()
                mended.append(finding.text)
        found = findings(lamp, bus, servos) if mended else found
    if found:
        texts = "; ".join(finding.text for finding in found)
        hint = " (--fix mends what software may)" if not fix and any(finding.fix for finding in found) else ""
        raise SafetyError(f"not ready: {texts}{hint}", bus.name)
    return mended


def findings(lamp: Lamp, bus: Bus, servos: Servos) -> list[Finding]:
    """Return everything that is wrong with servos and port; nothing is written.

    Raises:
        BusError: A servo does not answer.
    """
    frame = JointFrame(lamp)
    with bus.patient():
        state = servos.read()
        for _ in range(LOOKS - 1):
            if np.isfinite(state.position).all() and np.isfinite(state.voltage).all() and (state.torque >= 0).all():
                break
            state = servos.read()
    angle = frame.joint_angle(state.position)
    ends = np.sort(np.stack([frame.servo_angle(lamp.lower), frame.servo_angle(lamp.upper)]), axis=0)
    found = list(_latency(bus))
    for index, joint in enumerate(lamp.joints):
        label = bus.label(joint.id)
        for setting in wrong_settings(servos, index, MODELS[joint.servo], ends[0, index], ends[1, index]):
            found.append(Finding(f"{label}: {setting.text}", setting.write if setting.registers else None))
        error, voltage, heat = (int(state.hardware_error[index]), state.voltage[index], state.temperature[index])
        if error < 0 or math.isnan(voltage) or math.isnan(angle[index]):
            raise BusError(f"{label} answers to a ping, but not to a sync read", bus.name)
        low, high = limits_of(servos, index)
        found += [Finding(f"{label}: {text}") for text in _state(error, voltage, heat, low, high)]
        found += _angle(lamp, joint, label, float(angle[index]))
    return found


def notices(identities: Sequence[Identity], models: Sequence[Model], labels: Sequence[str]) -> list[str]:
    """Return what is not wrong, but could be better: firmware that makes ticks slower.

    Args:
        identities: What the servos answered to a ping.
        models: Their models.
        labels: What to call them.
    """
    return [
        f"{label}: firmware {identity.firmware} does not know Fast Sync Read ({model.fast_sync_read} and later do); "
        "update it with DYNAMIXEL Wizard 2.0 for shorter ticks"
        for identity, model, label in zip(identities, models, labels, strict=True)
        if identity.firmware < model.fast_sync_read
    ]


def check_foot(foot: FootSensor, clock: Clock, contact_on: float = 0.0) -> None:
    """Wait for the foot sensor's first frame, and for a force that the standing lamp can have.

    Args:
        foot: The open sensor.
        clock: Measures the wait.
        contact_on: Force above which the foot is on the ground [N].

    Raises:
        BusError: No frame came within FOOT_WAIT, or the port is gone.
        SafetyError: The sensor is not connected, or shows what it cannot show if it is tared.
    """
    deadline = clock.now() + FOOT_WAIT
    while True:
        foot.poll()
        frame = foot.newest
        if frame is not None and not frame.disconnected and contact_on <= foot.force <= FOOT_MOST:
            return
        if clock.now() >= deadline:
            break
        clock.sleep_until(clock.now() + _POLL)
    if frame is None:
        heard = foot.decoder.discarded
        said = f"{heard} bytes came, but no frame" if heard else "nothing came"
        raise BusError(
            f"no foot sensor: {said} in {FOOT_WAIT:g} s; is the sensor powered, and is this its port?", foot.name
        )
    if frame.disconnected:
        raise SafetyError("the foot sensor reports that its load cell is not connected; check its cable", foot.name)
    raise SafetyError(
        f"the foot sensor shows {foot.force:.2f} N, a standing lamp {contact_on:g} to {FOOT_MOST:g} N; stand the lamp "
        "on its foot, or tare the sensor with `robolamp setup foot`",
        foot.name,
    )


def _latency(bus: Bus) -> Iterator[Finding]:
    """An FTDI adapter keeps short answers back for its latency timer (16 ms when new), unless in low latency mode."""
    path = SYSFS / Path(bus.name).resolve().name / "latency_timer"
    if bus.low_latency or not path.is_file():
        return
    try:
        milliseconds = int(read_text(path))
    except (FileError, ValueError):
        return

    def fix() -> None:
        try:
            path.write_text("1\n")
        except OSError as error:
            raise FileError(f"cannot be set to 1: {error.strerror}; `echo 1 | sudo tee {path}`", str(path)) from None

    if milliseconds > 1:
        yield Finding(f"the adapter's latency timer is {milliseconds} ms, not 1; `echo 1 | sudo tee {path}`", fix)


def _angle(lamp: Lamp, joint: Joint, label: str, angle: float) -> Iterator[Finding]:
    low, high = joint.lower - lamp.preflight_angle, joint.upper + lamp.preflight_angle
    if not low <= angle <= high:
        yield Finding(
            f"{label}: stands at {angle:.2f} rad, outside {low:.2f} to {high:.2f}; put the lamp upright by hand, or "
            f"set sign and zero in {lamp.path.name} (`robolamp setup zero`)"
        )


def _state(error: int, voltage: float, temperature: float, low: float, high: float) -> Iterator[str]:
    if error:
        words = HardwareError.words(error)
        yield f"Hardware Error Status(70) is {error:#04x} ({words}); find the cause, then power it off and on"
    if not low <= voltage <= high:
        yield f"has {voltage:.1f} V, outside its limits of {low:.1f} to {high:.1f} V; check the supply"
    if temperature > WARM:
        yield f"has {temperature:.0f} degC, more than {WARM:g}; let it cool"
