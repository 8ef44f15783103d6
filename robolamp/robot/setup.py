"""Setting up a lamp: finding servos, numbering them, signs and zeros, taring the foot. It asks no questions."""

from __future__ import annotations

import math
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
from robolamp.robot.frame import wrapped
from robolamp.signals import Clock

SCAN_RATES = (1_000_000, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000, 9600)
"""Baud rates that `scan` tries, in this order [1/s]: the lamp's, then the factory's."""

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
    """

    baud: int
    id: int
    model: Model | None
    model_number: int
    firmware: int


def scan(port: str | Port, clock: Clock, rates: Sequence[int] = SCAN_RATES, last: int = 20) -> list[Found]:
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
                identity = bus.ping(servo, attempts=1)
                if identity is not None:
                    model = model_by_number(identity.model_number)
                    found.append(Found(rate, servo, model, identity.model_number, identity.firmware))
        finally:
            bus.close()
    return found


def assign(port: str | Port, clock: Clock, found: Found, id: int, baud: int) -> None:
    """Give a servo, alone on the line, its id and baud rate, and return delay 0; then see that it answers there.

    Args:
        port: The servo port.
        clock: Measures timeouts.
        found: The servo as it is now.
        id: Its new id.
        baud: Its new baud rate [1/s].

    Raises:
        BusError: It does not answer or refuses.
        SafetyError: Its torque is on, or it is a model that robolamp does not know.
    """
    model = found.model
    if model is None:
        raise SafetyError(f"servo {found.id} has model number {found.model_number}; known are {', '.join(MODELS)}")
    bus = Bus(port, found.baud, clock, patience=SETTING_PATIENCE)
    bus.open()
    try:
        if bus.read(found.id, model[Name.TORQUE_ENABLE]):
            raise SafetyError(f"servo {found.id} has its torque on; `robolamp stop`, or power it off and on", bus.name)
        bus.write(found.id, model[Name.RETURN_DELAY_TIME], 0)
        bus.write(found.id, model[Name.ID], id)
        bus.write(id, model[Name.BAUD_RATE], BAUD_CODES[baud])
    finally:
        bus.close()
    clock.sleep_until(clock.now() + _TAKEN)
    bus = Bus(port, baud, clock, patience=SETTING_PATIENCE)
    bus.open()
    try:
        if bus.ping(id) is None:
            raise BusError(f"the servo took id {id} and {baud} baud, and does not answer there", bus.name)
    finally:
        bus.close()


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


def set_joint(document: Any, index: int, **values: float) -> None:
    """Set keys of a joint in a parsed lamp.toml, each where it stands.

    Args:
        document: The document, as `edit_lamp` hands it out.
        index: Which joint, from the foot up.
        values: The keys and their values.
    """
    for key, value in values.items():
        document["joint"][index][key] = value


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
