"""Setting up a lamp: finding servos, numbering them, signs and zeros, taring the foot. It asks no questions."""

from __future__ import annotations

import math
import os
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray

from robolamp.dynamixel.bus import SETTING_PATIENCE, Bus, Port
from robolamp.dynamixel.registers import BAUD_CODES, MODELS, Model, Name, model_by_number
from robolamp.errors import BusError, SafetyError
from robolamp.files import MOST_TOML, parse_toml, read_text, write_atomic
from robolamp.foot.sensor import FootSensor
from robolamp.lamp import Lamp
from robolamp.robot.joint_frame import wrapped
from robolamp.robot.roll_call import BABBLE, NOBODY, PATIENCE, RATES, check_alone, said_of_doubles
from robolamp.signals import Clock

PUSH = 0.1
"""Smallest movement by which a push shows a sign [rad]: six degrees, more than a hand's shaking."""

_POLL = 0.002  # s
_TAKEN = 0.05  # s: how long a servo may take to hear its new id or baud rate


@dataclass(frozen=True)
class Found:
    """A servo that answered.

    Attributes:
        baud: At which rate [1/s].
        id: Its id.
        model: Its model, or None for one that robolamp does not know.
        model_number: Its Model Number(0).
        firmware: Its firmware version.
        doubled: Whether several servos answer to this id.
    """

    baud: int
    id: int
    model: Model | None
    model_number: int
    firmware: int
    doubled: bool = False


def scan(port: str | Port, clock: Clock, rates: Sequence[int] = RATES, last: int = 20) -> list[Found]:
    """Ping every id at every baud rate.

    Args:
        port: The servo port.
        clock: Measures timeouts.
        rates: Baud rates to try [1/s].
        last: Largest id to try; the first is 0.

    Raises:
        BusError: The port cannot be used.
    """
    found: list[Found] = []
    for rate in rates:
        bus = Bus(port, rate, clock, patience=SETTING_PATIENCE)
        bus.open()
        try:
            for servo in range(last + 1):
                if not bus.stirs(servo):
                    continue
                doubled, identity = bus.doubled(servo), bus.ping(servo)
                if doubled and bus.doubled(NOBODY):
                    raise BusError(BABBLE, bus.name)
                if identity is not None or doubled:
                    number, firmware = (identity.model_number, identity.firmware) if identity else (-1, -1)
                    found.append(Found(rate, servo, model_by_number(number), number, firmware, doubled))
        finally:
            bus.close()
    return found


def assign(port: str | Port, clock: Clock, found: Found, id: int, baud: int, others: Sequence[Found] = ()) -> None:
    """Give a servo, alone with its id, its id and baud rate, and return delay 0; then see that it answers there.

    Args:
        port: The servo port.
        clock: Measures timeouts.
        found: The servo as it is now.
        id: Its new id.
        baud: Its new baud rate [1/s].
        others: Who else answers on the line.

    Raises:
        BusError: It does not answer or refuses.
        SafetyError: Its torque is on, it is a model that robolamp does not know, or others would obey too.
    """
    model = found.model
    if model is None and not found.doubled:
        raise SafetyError(f"servo {found.id} has model number {found.model_number}; known are {', '.join(MODELS)}")
    bus = Bus(port, found.baud, clock, patience=PATIENCE)
    bus.open()
    try:
        if model is None or bus.doubled(found.id):
            raise SafetyError(said_of_doubles(bus.label(found.id)), bus.name)
        _answers_all(bus, found.id, model)
        for other in others:
            if other.baud == found.baud and other.model and other.id != found.id:
                shadow = bus.read(other.id, other.model[Name.SHADOW_ID])
                if shadow == found.id:
                    raise SafetyError(
                        f"servo {other.id}: Secondary(Shadow) ID(12) is {shadow}, not 255: it would obey what is "
                        f"written to servo {found.id}; unplug it, or write 255",
                        bus.name,
                    )
        if bus.read(found.id, model[Name.TORQUE_ENABLE]):
            raise SafetyError(f"servo {found.id} has its torque on; `robolamp stop`, or power it off and on", bus.name)
        check_alone(bus, found.id, model)
        bus.write(found.id, model[Name.RETURN_DELAY_TIME], 0)
        bus.write(found.id, model[Name.ID], id)
        bus.write(id, model[Name.BAUD_RATE], BAUD_CODES[baud])
    finally:
        bus.close()
    clock.sleep_until(clock.now() + _TAKEN)
    bus = Bus(port, baud, clock, patience=PATIENCE)
    bus.open()
    try:
        if bus.ping(id) is None:
            raise BusError(f"the servo took id {id} and {baud} baud, and does not answer there", bus.name)
    finally:
        bus.close()


def check_strangers(port: str | Port, clock: Clock, lamp: Lamp) -> None:
    """Refuse servos on the line that belong to no joint but would obey writes to a joint's servo.

    Args:
        port: The servo port.
        clock: Measures timeouts.
        lamp: The description.

    Raises:
        SafetyError: There are some; the message names them all.
        BusError: The port cannot be used, or such a servo does not answer.
    """
    joints = {joint.id: joint.name for joint in lamp.joints}
    said: list[str] = []
    bus = Bus(port, lamp.bus_baud, clock, patience=PATIENCE)
    bus.open()
    try:
        for servo in sorted(set(bus.present()) - set(joints)):
            identity = bus.ping(servo)
            model = model_by_number(identity.model_number) if identity else None
            if model and (shadow := bus.read(servo, model[Name.SHADOW_ID])) in joints:
                said.append(
                    f"servo {servo}, which is no joint's: Secondary(Shadow) ID(12) is {shadow}, not 255: it would obey "
                    f"what is written to the {joints[shadow]}; unplug it, or write 255"
                )
    finally:
        bus.close()
    if said:
        raise SafetyError(f"not ready: {'; '.join(said)}", bus.name)


def _answers_all(bus: Bus, servo: int, model: Model) -> None:
    """Refuse a servo that would not confirm what is written to it."""
    level = model[Name.STATUS_RETURN_LEVEL]
    try:
        found = bus.read(servo, level)
    except BusError:
        if bus.gone:
            raise
        found = 0
    if found != level.initial:
        raise SafetyError(
            f"servo {servo}: Status Return Level(68) is {found}, not {level.initial}: it would not confirm what is "
            "written to it; power it off and on",
            bus.name,
        )


def mean_angle(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means of servo angles, in 0 to 2 pi, right across the seam too.

    Args:
        samples: Shape (k, n) [rad]; the n columns each spread over much less than half a turn.

    Returns:
        Shape (n,) [rad].
    """
    middle = np.arctan2(np.sin(samples).mean(axis=0), np.cos(samples).mean(axis=0))
    return np.mod(middle, 2 * math.pi)


def sign_of(neutral: float, pushed: float, name: str) -> int:
    """Return a joint's sign from a push forward: +1 where the servo's angle rose, -1 where it fell.

    Args:
        neutral: Servo angle in the neutral pose [rad].
        pushed: Servo angle with the joint pushed forward by less than half a turn [rad].
        name: The joint, for the message.

    Raises:
        SafetyError: It moved by less than PUSH.
    """
    step = float(wrapped(np.array([pushed - neutral]))[0])
    if abs(step) < PUSH:
        raise SafetyError(f"{name} moved by {step:.3f} rad, less than {PUSH:g}; push it further forward")
    return 1 if step > 0 else -1


def foot_mean(foot: FootSensor, clock: Clock, seconds: float) -> float:
    """Return the mean of what the foot sensor shows, as it sends it [N].

    Args:
        foot: The open sensor.
        clock: Measures the time.
        seconds: How long to look [s].

    Raises:
        BusError: No frame came, or the port is gone.
        SafetyError: It is saturated or not connected.
    """
    forces: list[float] = []
    end = clock.now() + seconds
    foot.poll()  # what came before does not count
    while clock.now() < end:
        clock.sleep_until(clock.now() + _POLL)
        for frame in foot.poll():
            if frame.saturated or frame.disconnected:
                said = "saturated" if frame.saturated else "not connected"
                raise SafetyError(f"the foot sensor is {said}; check its cable and the weight", foot.name)
            forces.append(frame.force)
    if not forces:
        raise BusError(
            f"no foot sensor: no frame in {seconds:g} s; is the sensor powered, is this its port?", foot.name
        )
    return statistics.fmean(forces)


def check_tare(tare: float, lamp: Lamp) -> None:
    """Refuse a tare that includes the weight of the lamp.

    A sensor drifts by less than what counts as ground contact, or no lamp could use it; a standing lamp weighs more.

    Args:
        tare: What the sensor shows [N].
        lamp: Its tare so far, its scale and its contact force.

    Raises:
        SafetyError: It is above the tare so far by a contact.
    """
    more = (tare - lamp.foot_tare) * lamp.foot_scale
    if more >= lamp.contact_on:
        raise SafetyError(
            f"it shows {tare:.2f} N, {more:.2f} N above its tare so far ({lamp.foot_tare:g} N): something stands on it "
            f"({lamp.contact_on:g} N is ground contact); lift the lamp. Where that is a new sensor's own offset, write "
            f"foot.tare = {tare:.2f} into {lamp.path.name} first",
            "the foot sensor",
        )


def check_stands(force: float, tare: float, lamp: Lamp) -> None:
    """Refuse a tare if the standing lamp weighs no more than it.

    Args:
        force: What the sensor shows with the lamp on its foot [N].
        tare: What it showed before, with the lamp lifted [N].
        lamp: Its scale and its contact force.

    Raises:
        SafetyError: The lamp shows less than a contact.
    """
    more = (force - tare) * lamp.foot_scale
    if more < lamp.contact_on:
        raise SafetyError(
            f"the standing lamp shows {more:.2f} N above the lifted one, less than the {lamp.contact_on:g} N of a "
            "ground contact: it was not lifted, or the sensor is broken",
            "the foot sensor",
        )


def read_only(path: Path) -> str:
    """Return why a lamp.toml cannot be changed; empty where it can.

    Args:
        path: The file.
    """
    if path.name != "lamp.toml":
        return "is no lamp.toml"
    if "_assets" in path.parts:
        return "is part of the installed package; give a folder of your own with --lamp"
    return "" if os.access(path.parent, os.W_OK) else "cannot be written; give a folder of your own with --lamp"


def edit_lamp(path: Path, change: Callable[[Any], None]) -> None:
    """Change lamp.toml and keep its comments; a reader sees the old file or the new.

    Args:
        path: The file.
        change: Changes the parsed document in place.

    Raises:
        FileError: The file cannot be read or written.
    """
    text = read_text(path, MOST_TOML)
    parse_toml(text, str(path))
    document = tomlkit.parse(text)
    change(document)
    write_atomic(path, tomlkit.dumps(document))


def set_joint(document: Any, index: int, **values: float | str) -> None:
    """Set keys of a joint in a parsed lamp.toml, each in its place; an empty text removes its key.

    Args:
        document: The document, as `edit_lamp` hands it out.
        index: Which joint, from the foot up.
        values: The keys and their values.
    """
    joint = document["joint"][index]
    for key, value in values.items():
        if value != "":
            joint[key] = value
        elif key in joint:
            del joint[key]


def set_foot(document: Any, tare: float, scale: float | None) -> None:
    """Set tare and scale of the foot in a parsed lamp.toml.

    Args:
        document: The document, as `edit_lamp` hands it out.
        tare: [N].
        scale: Newtons a newton that the sensor shows; None: as it is.
    """
    document["foot"]["tare"] = round(tare, 4)
    if scale is not None:
        document["foot"]["scale"] = round(scale, 5)
