"""The lamp's description (hardware/lamp.toml): joints, servos, limits, ports. Twin, emulator and driver read it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.errors import FileError, SafetyError
from robolamp.files import Table, parse_toml, read_text, read_toml
from robolamp.odometer import Odometer, load_odometer

SERVO_MODELS = ("XL330-M288-T", "XL330-M077-T", "XL430-W250-T")
"""Servo models that a lamp may name."""

FLIGHT_TIME = 0.08
"""Shortest time off the floor that is a flight, where lamp.toml does not say [s]: real flights last 0.12 to 0.15 s,
rebounds after a landing 0.044 to 0.056, and crouching unloads the foot for 0.044 (measured on emulated lamps)."""

PREFLIGHT_ANGLE_MAX = 0.5
"""Largest `safety.preflight_angle` [rad]: a joint further outside its limits stands on its stops or is misdescribed."""


_ROUNDING = 1e-9  # rad: a goal on its limit may be this far outside by rounding


@dataclass(frozen=True)
class Joint:
    """One joint and the servo that drives it.

    Attributes:
        name: The joint's name, the same in the model, the log and the controller file.
        servo: Servo model.
        id: The servo's id on the bus, 0-252.
        sign: +1, or -1 where the servo's angle falls as the joint's grows.
        zero: Servo angle at joint angle 0 [rad], 0 to 2 pi.
        lower: Smallest joint angle a goal may have [rad].
        upper: Largest joint angle a goal may have [rad].
        rest: Joint angle that the soft landing ends in [rad].
        slew: Fastest change of a goal [rad/s].
        position_p_gain: Position P Gain register (84) of the servo, as written.
        zero_wanted: Why `zero` must be found again; empty: it need not.
        sign_wanted: Why `sign` must be found again; empty: it need not.
    """

    name: str
    servo: str
    id: int
    sign: int
    zero: float
    lower: float
    upper: float
    rest: float
    slew: float
    position_p_gain: int
    zero_wanted: str = ""
    sign_wanted: str = ""


@dataclass(frozen=True)
class Lamp:
    """The lamp as twin, emulator and driver know it.

    Attributes:
        name: The lamp's name.
        model: The model's path inside the data folders, as "sim/lamp/scene.xml".
        joints: The joints from the foot up.
        bus_port: Serial port of the servo bus.
        bus_baud: Its baud rate [1/s].
        foot_port: Serial port of the foot sensor.
        foot_baud: Its baud rate [1/s].
        contact_on: Foot force above which the foot is on the ground [N].
        contact_off: Foot force below which it no longer is [N].
        preflight_angle: How far outside its limits a joint may be before the start [rad].
        source: The text of the file it was read from, kept in every log.
        path: The file it was read from.
        foot_tare: What the foot sensor shows of its own accord with the foot in the air [N].
        foot_scale: Newtons a newton that the foot sensor shows beyond that.
        flight_time: Shortest time off the floor that is a flight [s]; shorter ones are rebounds.
        odometer: Measures its hops; None: it has none.
    """

    name: str
    model: str
    joints: tuple[Joint, ...]
    bus_port: str
    bus_baud: int
    foot_port: str
    foot_baud: int
    contact_on: float
    contact_off: float
    preflight_angle: float
    source: str
    path: Path
    foot_tare: float = 0.0
    foot_scale: float = 1.0
    flight_time: float = FLIGHT_TIME
    odometer: Odometer | None = None

    @property
    def drive(self) -> str:
        """What goals are: angles."""
        return "position"

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names, from the foot up."""
        return tuple(joint.name for joint in self.joints)

    @property
    def lower(self) -> NDArray[np.float64]:
        """Smallest goals, shape (n,) [rad]."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> NDArray[np.float64]:
        """Largest goals, shape (n,) [rad]."""
        return np.array([joint.upper for joint in self.joints])

    @property
    def slew(self) -> NDArray[np.float64]:
        """Fastest changes of the goals, shape (n,) [rad/s]."""
        return np.array([joint.slew for joint in self.joints])

    def check_goal(self, goal: NDArray[np.float64]) -> None:
        """Refuse goals that the envelope would not have let through.

        Args:
            goal: Shape (n,) [rad].

        Raises:
            SafetyError: One is not finite or outside its joint's limits.
        """
        for joint, value in zip(self.joints, goal, strict=True):
            if not joint.lower - _ROUNDING <= value <= joint.upper + _ROUNDING:  # NaN is outside too
                raise SafetyError(
                    f"goal {value:.9g} rad of {joint.name} is not from {joint.lower:g} to {joint.upper:g} rad",
                    str(self.path),
                )

    @property
    def rest(self) -> NDArray[np.float64]:
        """The pose the soft landing ends in, shape (n,) [rad]."""
        return np.array([joint.rest for joint in self.joints])


def _joint(table: Table) -> Joint:
    lower = table.number("lower", -math.pi, math.pi, "rad")
    upper = table.number("upper", -math.pi, math.pi, "rad")
    if lower >= upper:
        raise table.fail("upper", f"{upper:g} is not above lower = {lower:g} rad")
    if lower > 0.0:
        raise table.fail("lower", f"{lower:g} is above 0 rad; the soft start goes to the neutral pose, 0 rad")
    if upper < 0.0:
        raise table.fail("upper", f"{upper:g} is below 0 rad; the soft start goes to the neutral pose, 0 rad")
    sign = table.integer("sign", -1, 1)
    if sign == 0:
        raise table.fail("sign", "0 is not one of -1, 1")
    joint = Joint(
        name=table.text("name"),
        servo=table.text("servo", SERVO_MODELS),
        id=table.integer("id", 0, 252),
        sign=sign,
        zero=table.number("zero", 0.0, 2 * math.pi, "rad"),
        lower=lower,
        upper=upper,
        rest=table.number("rest", lower, upper, "rad", default=0.0),
        slew=table.number("slew", 0.1, 100.0, "rad/s"),
        position_p_gain=table.integer("position_p_gain", 1, 16383),
        zero_wanted=table.text("zero_wanted", default=""),
        sign_wanted=table.text("sign_wanted", default=""),
    )
    table.done()
    return joint


def load_lamp(assets: Assets) -> Lamp:
    """Read hardware/lamp.toml.

    Args:
        assets: Where to look.

    Raises:
        FileError: The file is missing or malformed; the message names the key and its legal range.
    """
    path = assets.path("hardware/lamp.toml")
    table = Table(read_toml(path), str(path))
    name = table.text("odometer", default="")
    return _lamp(table, path, read_text(path), load_odometer(assets.path(name)) if name else None)


def same_lamp(lamp: Lamp, text: str) -> bool:
    """Return whether a lamp.toml of some time describes this lamp: whatever its comments, and keys that it left out.

    Args:
        lamp: The lamp.
        text: The file's text, as logs keep it.
    """
    if text == lamp.source:
        return True
    try:
        table = Table(parse_toml(text, ""), "")
        table.text("odometer", default="")  # the log holds its text, too
        return _lamp(table, lamp.path, lamp.source, lamp.odometer) == lamp
    except FileError:
        return False


def _lamp(root: Table, path: Path, source: str, odometer: Odometer | None) -> Lamp:
    bus, foot, safety = root.table("bus"), root.table("foot"), root.table("safety")
    joints = tuple(_joint(table) for table in root.tables("joint"))
    for key, values in (("name", [joint.name for joint in joints]), ("id", [joint.id for joint in joints])):
        if len(set(values)) != len(values):
            raise root.fail("joint", f"two joints have the same {key} ({', '.join(map(str, values))})")
    contact_on = foot.number("contact_on", 0.01, 1000.0, "N")
    lamp = Lamp(
        name=root.text("name"),
        model=root.text("model"),
        joints=joints,
        bus_port=bus.text("port"),
        bus_baud=bus.integer("baud", 9600, 4_500_000),
        foot_port=foot.text("port"),
        foot_baud=foot.integer("baud", 9600, 4_000_000),
        foot_tare=foot.number("tare", -1000.0, 1000.0, "N", default=0.0),
        foot_scale=foot.number("scale", 0.001, 1000.0, default=1.0),
        contact_on=contact_on,
        contact_off=foot.number("contact_off", 0.0, contact_on, "N"),
        flight_time=foot.number("flight_time", 0.001, 10.0, "s", default=FLIGHT_TIME),
        preflight_angle=safety.number("preflight_angle", 0.0, PREFLIGHT_ANGLE_MAX, "rad"),
        source=source,
        path=path,
        odometer=odometer,
    )
    if odometer is not None and odometer.joints != len(joints):
        raise root.fail("odometer", f"is of {odometer.joints} joints; the lamp has {len(joints)}")
    for table in (root, bus, foot, safety):
        table.done()
    return lamp
