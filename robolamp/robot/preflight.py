"""What must be right before torque goes on: each finding names what is wrong and how to mend it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.bus import Bus, Identity
from robolamp.dynamixel.registers import (
    COUNTS_PER_TURN,
    MODELS,
    RAD_PER_COUNT,
    VOLTAGE_UNIT,
    HardwareError,
    Model,
    Name,
)
from robolamp.dynamixel.servo_state import ServoState
from robolamp.dynamixel.servos import Servos
from robolamp.errors import BusError, FileError, RobolampError, SafetyError
from robolamp.files import read_text
from robolamp.foot.sensor import FootSensor
from robolamp.lamp import Joint, Lamp
from robolamp.robot.joint_frame import JointFrame
from robolamp.robot.roll_call import PATIENCE, Roll, call_roll
from robolamp.robot.servo_settings import RULES, Setting, named, wrong_settings
from robolamp.robot.setup import edit_lamp, read_only, set_joint
from robolamp.signals import Clock

TABLE = 147
"""How many bytes of a servo's control table are read: Model Number(0) to Present Temperature(146)."""

FOOT_WAIT = 0.5
"""How long a foot sensor has for its first frame, and for a force that a standing lamp can have [s]."""

FOOT_MOST = 10.0
"""Largest force that a foot sensor may show while the lamp stands [N]: five times what the lamp of hardware/ weighs."""

WARM = 55.0
"""Temperature above which a servo is not started [degC]: 10 below the loop's limit, some minutes of hopping."""

LOOKS = 5
"""How often all servos are read at most until each has sent its state: a noisy line loses an answer now and then."""

SYSFS = Path("/sys/bus/usb-serial/devices")
"""Where Linux keeps the latency timers of USB serial adapters."""

_POLL = 0.002  # s: between two looks at the foot sensor
_ROUNDS = 2  # of mending: what is wrong with a servo that answered no reads is seen only in the second


@dataclass(frozen=True)
class Finding:
    """Something that must be mended before torque goes on.

    Attributes:
        text: What is wrong, and how to mend it.
        fix: Mends it by software; None where hands are needed.
        index: Which joint's servo `marks` is for.
        marks: What `fix` makes wrong in lamp.toml: keys of the joint, written before it.
        answers: Whether the servo answers at all.
    """

    text: str
    fix: Callable[[], None] | None = None
    index: int = 0
    marks: Mapping[str, str] = field(default_factory=dict)
    answers: bool = True


@dataclass(frozen=True)
class Passed:
    """The result of a preflight that found nothing wrong: the lamp may be moved.

    Attributes:
        servos: Its servos.
        firmware: Their firmware versions.
        mended: What was mended, one text each.
        notices: What is not wrong, but could be better.
    """

    servos: Servos
    firmware: Sequence[int]
    mended: Sequence[str]
    notices: Sequence[str]


def preflight(
    lamp: Lamp, bus: Bus, foot: FootSensor | None, clock: Clock, *, fix: bool = False, holding: bool = False
) -> Passed:
    """Check servos, their settings and state, the port and the foot sensor against the lamp's description.

    Args:
        lamp: Its description.
        bus: The open bus.
        foot: The open foot sensor; None: there is none.
        clock: Measures how long to wait for the foot sensor.
        fix: Mend what software may mend; otherwise nothing is written.
        holding: Whether torque may be on: servos hold where they are after their port went away.

    Raises:
        SafetyError: Something is wrong; the message names everything that is, each with its remedy, and what was
            mended before that.
        BusError: A servo or the foot sensor does not answer; the message is the same.
    """
    mended: list[str] = []
    failed: list[str] = []
    with bus.patient(PATIENCE):
        roll, found = _look(lamp, bus, holding)
        for _ in range(_ROUNDS if fix and not roll.doubled else 0):
            lamp, done, failed = _mend(lamp, found)
            mended += done
            if not done:
                break
            roll, found = _look(lamp, bus, holding)
    texts = [finding.text for finding in found] + failed
    absent = not all(finding.answers for finding in found)
    where = bus.name
    if foot is not None:
        try:
            check_foot(foot, clock, lamp.contact_on)
        except (BusError, SafetyError) as error:
            texts.append(error.message)
            where = bus.name if found else error.where
            absent = absent or isinstance(error, BusError)
    if texts:
        hint = " (--fix mends what software may)" if not fix and any(finding.fix for finding in found) else ""
        before = "".join(f"mended: {text}; " for text in mended)
        raise (BusError if absent else SafetyError)(f"{before}not ready: {'; '.join(texts)}{hint}", where)
    identities = [roll.present[index] for index in range(len(lamp.joints))]
    ids, models = [joint.id for joint in lamp.joints], [MODELS[joint.servo] for joint in lamp.joints]
    said = notices(identities, models, [bus.label(servo) for servo in ids])
    return Passed(Servos(bus, ids, models), [identity.firmware for identity in identities], mended, said)


def read_table(bus: Bus, servo: int, model: Model) -> dict[Name, int]:
    """Return a servo's registers from Model Number(0) to Present Temperature(146), in counts.

    Raises:
        BusError: It does not answer or refuses.
    """
    rows = {name: row for name, row in model.registers.items() if row.address + row.size <= TABLE}
    try:
        data = bus.read_bytes(servo, 0, TABLE)
    except BusError:
        bus.read(servo, model[Name.STATUS_RETURN_LEVEL])  # does it answer any read?
        return {name: bus.read(servo, row) for name, row in rows.items()}
    return {
        name: int.from_bytes(data[row.address : row.address + row.size], "little", signed=row.signed)
        for name, row in rows.items()
    }


def check_meaning(lamp: Lamp, bus: Bus, models: Sequence[Model]) -> None:
    """Check the settings that servo angles depend on, before zeros and signs are found.

    Raises:
        SafetyError: One is wrong: mended later, it would make zeros and signs wrong.
        BusError: A servo does not answer.
    """
    texts: list[str] = []
    for joint, model in zip(lamp.joints, models, strict=True):
        wrong = wrong_settings(model, read_table(bus, joint.id, model), 0.0, 0.0)
        texts += [f"{bus.label(joint.id)}: {setting.text}" for setting in wrong if setting.upset]
    if texts:
        raise SafetyError(f"{'; '.join(texts)}; `robolamp setup check --fix` first, it changes what is found", bus.name)


def _look(lamp: Lamp, bus: Bus, holding: bool) -> tuple[Roll, list[Finding]]:
    """Return everything that is wrong with servos and port; writes nothing."""
    roll = call_roll(lamp, bus)
    found = [Finding(text, answers=False) for text in roll.missing] + [Finding(text) for text in roll.wrong]
    found += _latency(bus)
    frame = JointFrame(lamp)
    ends = np.sort(np.stack([frame.servo_angle(lamp.lower), frame.servo_angle(lamp.upper)]), axis=0)
    tables: dict[int, dict[Name, int]] = {}
    unread: list[Finding] = []
    for index in sorted(roll.present):
        joint = lamp.joints[index]
        try:
            tables[index] = read_table(bus, joint.id, MODELS[joint.servo])
        except BusError:
            if bus.gone:
                raise
            unread.append(_level_zero(bus, joint))
    found += unread
    angle, state = _state_of(lamp, bus, tables)
    for index, joint in enumerate(lamp.joints):
        label = bus.label(joint.id)
        found += _wanted(joint, label)
        if index not in tables:
            continue
        table, model = tables[index], MODELS[joint.servo]
        on = bool(table[Name.TORQUE_ENABLE]) and not holding
        if on:
            found.append(
                Finding(f"{label}: Torque Enable(64) is 1, not 0; `robolamp stop` first, holding the lamp: it sinks")
            )
        for setting in wrong_settings(model, table, ends[0, index], ends[1, index]):
            found.append(_setting(lamp, bus, index, setting, locked=on))
        if math.isnan(angle[index]) or math.isnan(state.voltage[index]) or state.hardware_error[index] < 0:
            found.append(Finding(f"{label} answers to a ping, but not to a sync read", answers=False))
            continue
        low, high = (table[name] * VOLTAGE_UNIT for name in (Name.MIN_VOLTAGE_LIMIT, Name.MAX_VOLTAGE_LIMIT))
        heat, error = state.temperature[index], int(state.hardware_error[index])
        found += [Finding(f"{label}: {text}") for text in _state(model, error, state.voltage[index], heat, low, high)]
        found += _angle(lamp, joint, label, float(angle[index]), table)
    return roll, found


def _state_of(lamp: Lamp, bus: Bus, present: Iterable[int]) -> tuple[NDArray[np.float64], ServoState]:
    """Return joint angles [rad] and what servos say of themselves; NaN and -1 for those that are not present."""
    whole = ServoState.unknown(len(lamp.joints))
    at = sorted(present)
    if at:
        servos = Servos(bus, [lamp.joints[i].id for i in at], [MODELS[lamp.joints[i].servo] for i in at])
        state = servos.read()
        for _ in range(LOOKS - 1):
            if np.isfinite(state.position).all() and np.isfinite(state.voltage).all() and (state.torque >= 0).all():
                break
            state = servos.read()
        for name in ("position", "voltage", "temperature", "hardware_error"):
            getattr(whole, name)[at] = getattr(state, name)
    return JointFrame(lamp).joint_angle(whole.position), whole


def _mend(lamp: Lamp, found: Sequence[Finding]) -> tuple[Lamp, list[str], list[str]]:
    """Mend what software may; return the lamp, now with what it wants, what was mended, and what could not be."""
    done: list[str] = []
    failed: list[str] = []
    for finding in found:
        if finding.fix is None:
            continue
        try:
            if finding.marks:  # first: whatever happens, the lamp is not taken for ready
                marks = {
                    key: text for key, text in finding.marks.items() if not getattr(lamp.joints[finding.index], key)
                }
                edit_lamp(lamp.path, lambda document, i=finding.index, m=marks: set_joint(document, i, **m))
                joints = list(lamp.joints)
                joints[finding.index] = replace(joints[finding.index], **marks)
                lamp = replace(lamp, joints=tuple(joints))
            finding.fix()
        except RobolampError as error:
            failed.append(f"not mended: {error}")
        else:
            done.append(finding.text)
    return lamp, done, failed


def _setting(lamp: Lamp, bus: Bus, index: int, setting: Setting, *, locked: bool) -> Finding:
    """Return what is found where a register is wrong."""
    joint = lamp.joints[index]
    model, label = MODELS[joint.servo], bus.label(joint.id)
    text = f"{label}: {setting.text}"
    marks = {f"{what}_wanted": f"{named(model, setting.name)} was {setting.found}" for what in setting.upset}
    if not setting.right or (locked and model[setting.name].eeprom):
        return Finding(text)
    if marks:
        text += f", then `robolamp setup zero`: it changes what {' and '.join(setting.upset)} must be"
        held = read_only(lamp.path)
        if held:
            return Finding(f"{text} (not by --fix: {lamp.path} {held}, and could not keep that)")
    if setting.name is Name.STATUS_RETURN_LEVEL:
        return Finding(text, lambda: _set_level(bus, joint.id, model))

    def write() -> None:
        for name, value in setting.right.items():
            bus.write(joint.id, model[name], value)

    return Finding(text, write, index, marks)


def _level_zero(bus: Bus, joint: Joint) -> Finding:
    model = MODELS[joint.servo]
    right = RULES[Name.STATUS_RETURN_LEVEL].value
    text = f"{named(model, Name.STATUS_RETURN_LEVEL)} is 0, not {right} (it answers pings and no reads); write {right}"
    return Finding(f"{bus.label(joint.id)}: {text}", lambda: _set_level(bus, joint.id, model))


def _set_level(bus: Bus, servo: int, model: Model) -> None:
    """Set a servo to answer everything, and check that it does; it may not answer this write."""
    level, right = model[Name.STATUS_RETURN_LEVEL], RULES[Name.STATUS_RETURN_LEVEL].value or 0
    bus.tell(servo, level, right)
    if bus.read(servo, level) != right:
        bus.write(servo, level, right)


def _wanted(joint: Joint, label: str) -> Iterator[Finding]:
    wanted = {what: why for what, why in (("zero", joint.zero_wanted), ("sign", joint.sign_wanted)) if why}
    if wanted:
        why = " and ".join(dict.fromkeys(wanted.values()))
        yield Finding(
            f"{label}: {' and '.join(wanted)} must be found again, for {why} when found; `robolamp setup zero`"
        )


def notices(identities: Sequence[Identity], models: Sequence[Model], labels: Sequence[str]) -> list[str]:
    """Return what could be better but is not wrong: firmware that makes ticks slower.

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
    frame = None  # what came before does not count: after a replug it may be long ago
    while True:
        frame = next(reversed(foot.poll()), frame)
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


def _angle(lamp: Lamp, joint: Joint, label: str, angle: float, table: Mapping[Name, int]) -> Iterator[Finding]:
    low, high = joint.lower - lamp.preflight_angle, joint.upper + lamp.preflight_angle
    if not low <= angle <= high:
        yield Finding(
            f"{label}: stands at {angle:.2f} rad, outside {low:.2f} to {high:.2f}; put the lamp upright by hand, or "
            f"set sign and zero in {lamp.path.name} (`robolamp setup zero`)"
        )
        return
    count, bottom, top = (
        table[name] for name in (Name.PRESENT_POSITION, Name.MIN_POSITION_LIMIT, Name.MAX_POSITION_LIMIT)
    )
    turned = count % COUNTS_PER_TURN
    if not bottom <= turned <= top:
        yield Finding(
            f"{label}: stands at {turned * RAD_PER_COUNT:.2f} rad of the servo's turn, outside its Position Limits "
            f"(52, 48) of {bottom * RAD_PER_COUNT:.2f} to {top * RAD_PER_COUNT:.2f}, where it refuses goals; "
            "put the lamp upright by hand"
        )


def _state(model: Model, error: int, voltage: float, temperature: float, low: float, high: float) -> Iterator[str]:
    if error:
        words = HardwareError.words(error)
        yield f"Hardware Error Status(70) is {error:#04x} ({words}); find the cause, then power it off and on"
    if not low <= voltage <= high:
        yield f"has {voltage:.1f} V, outside its limits of {low:.1f} to {high:.1f} V; check the supply"
    elif voltage < model.least_voltage - VOLTAGE_UNIT / 2:
        yield f"has {voltage:.1f} V, less than the {model.least_voltage:g} V an {model.name} wants; check the supply"
    if temperature > WARM:
        yield f"has {temperature:.0f} degC, more than {WARM:g}; let it cool"
