"""Every register of the servos that a client may write: its right value for a run, and how the driver treats it.

One table. The preflight checks by it, what the driver writes at torque-on is held to it, docs/registers.md is made of
it, and a test sets each register wrong on emulated servos of each model. E-manual: the pages in `Model.url`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from robolamp.dynamixel.health_block import FIELDS
from robolamp.dynamixel.registers import COUNTS_PER_TURN, FULL_PWM, RAD_PER_COUNT, Model, Name, OperatingMode
from robolamp.dynamixel.servos import AT_TORQUE_ON

LIMIT_MARGIN = 10
"""How far beyond the joint's range Position Limits are set [counts], as hardware/README.md says."""

REVERSE = 0x01
"""Bit of Drive Mode(10) that turns the servo's sense of rotation about."""

NO_SHADOW = 253
"""Secondary(Shadow) ID(12) from which on there is none (e-manual)."""


class Seen(StrEnum):
    """How the driver treats a register."""

    WRITTEN = "written"
    CHECKED = "checked"
    FREE = "free"


@dataclass(frozen=True)
class Rule:
    """How the driver treats one register, and why.

    Attributes:
        seen: WRITTEN: the driver writes it before torque goes on; CHECKED: the preflight names it where it is wrong;
            FREE: a run does not depend on it.
        right: What it is then, or must be, in words.
        why: Why so; for FREE, what shows it.
        mend: Whether `--fix` writes the right value.
        value: The right value; None: the factory's.
        upset: What writing it makes wrong in lamp.toml: "zero", "sign".
    """

    seen: Seen
    right: str
    why: str
    mend: bool = False
    value: int | None = None
    upset: tuple[str, ...] = ()


def _written(right: str, why: str) -> Rule:
    return Rule(Seen.WRITTEN, right, why)


def _checked(why: str, value: int | None = None, right: str = "", upset: tuple[str, ...] = ()) -> Rule:
    words = right or ("the factory's" if value is None else str(value))
    return Rule(Seen.CHECKED, words, why, True, value, upset)


def _by_hand(right: str, why: str) -> Rule:
    return Rule(Seen.CHECKED, right, why)


def _free(why: str) -> Rule:
    return Rule(Seen.FREE, "anything", why)


_ZERO = dict.fromkeys(AT_TORQUE_ON, "the twin's servo is its P gain alone") | {
    Name.PROFILE_ACCELERATION: "goals are followed at once; a profile of another client would lag",
    Name.PROFILE_VELOCITY: "goals are followed at once; a profile of another client would lag",
}

RULES: Mapping[Name, Rule] = MappingProxyType(
    {
        Name.STATUS_RETURN_LEVEL: _checked("at 0 it answers pings alone, at 1 no writes", 2),
        Name.SHADOW_ID: _checked("it would obey what is written to another servo", 255, "none (253 to 255)"),
        Name.ID: _by_hand("as in lamp.toml", "`robolamp setup assign` writes it"),
        Name.BAUD_RATE: _by_hand("that of bus.baud", "`robolamp setup assign` writes it"),
        Name.PROTOCOL_TYPE: _by_hand("2", "otherwise it understands no packet of ours; DYNAMIXEL Wizard 2.0 writes it"),
        Name.TORQUE_ENABLE: _by_hand("0", "another program may drive it, and EEPROM is locked; `robolamp stop`"),
        Name.OPERATING_MODE: _checked("position", OperatingMode.POSITION),
        Name.DRIVE_MODE: _checked("normal, velocity profile", 0, upset=("zero", "sign")),
        Name.HOMING_OFFSET: _checked("zeros are lamp.toml's affair", 0, upset=("zero",)),
        Name.RETURN_DELAY_TIME: _checked("each 1 is 2 us lost for each servo and read", 0),
        Name.PWM_LIMIT: _checked("full duty", FULL_PWM),
        Name.SHUTDOWN: _checked("voltage, heat, shock and overload turn torque off"),
        Name.TEMPERATURE_LIMIT: _checked("lower, it shuts down in a run; higher, it cooks"),
        Name.MAX_VOLTAGE_LIMIT: _checked("narrower, it shuts down in a run; wider, it runs on what harms it"),
        Name.MIN_VOLTAGE_LIMIT: _checked("narrower, it shuts down in a run; wider, it runs on too little"),
        Name.VELOCITY_LIMIT: _checked("the e-manual does not say that it leaves goals without a profile alone"),
        Name.MAX_POSITION_LIMIT: _checked("the joint's range must be inside", right="above the joint's range"),
        Name.MIN_POSITION_LIMIT: _checked("the joint's range must be inside", right="below the joint's range"),
        Name.STARTUP_CONFIGURATION: _checked("torque on, or another client's RAM, whenever power comes back", 0),
        Name.PWM_SLOPE: _checked("its ramp is part of the twin's delay"),
        **{name: _written(str(AT_TORQUE_ON[name]), why) for name, why in _ZERO.items()},
        Name.BUS_WATCHDOG: _written("10, which is 0.2 s", "cleared first: while it is tripped, goals are refused"),
        Name.POSITION_P_GAIN: _written("position_p_gain of lamp.toml", "the twin's too"),
        Name.GOAL_PWM: _written("885, in a gentle run less", "full duty"),
        Name.GOAL_POSITION: _written("Present Position(132)", "it must not jump"),
        Name.MOVING_THRESHOLD: _free("acts on Moving(122) alone, which nobody reads (e-manual, Moving Threshold(24))"),
        Name.CURRENT_LIMIT: _free("acts in current and current-based position control (e-manual, Current Limit(38))"),
        Name.LED: _free("light alone (e-manual, LED(65))"),
        Name.VELOCITY_I_GAIN: _free("acts in velocity control (e-manual, Velocity PI Gain(76, 78))"),
        Name.VELOCITY_P_GAIN: _free("acts in velocity control (e-manual, Velocity PI Gain(76, 78))"),
        Name.GOAL_CURRENT: _free("acts in current and current-based position control (e-manual, Goal Current(102))"),
        Name.GOAL_VELOCITY: _free("acts in velocity control (e-manual, Goal Velocity(104))"),
    }
)
"""By register, in the order in which wrong ones are named and mended."""

MAPPED = sum(size for _, size in FIELDS)
"""How many Indirect Address registers, from the first on, are written when the lamp is opened."""

INDIRECT: Mapping[str, Rule] = MappingProxyType(
    {
        f"Indirect Address 1 to {MAPPED}": _written(
            "the health block's", "all that a tick reads side by side; read back and compared with the registers"
        ),
        "other Indirect Address": _free("nobody reads what they map (e-manual, Indirect Address, Indirect Data)"),
        "Indirect Data": _free("a view of the registers that are mapped (e-manual, Indirect Address, Indirect Data)"),
    }
)
"""The indirect registers, which have no row each."""


@dataclass(frozen=True)
class Setting:
    """A register that is wrong.

    Attributes:
        name: Which.
        found: Its value, in counts.
        text: What is wrong, and how to mend it.
        right: What to write, by register; empty where writing would not mend it.
        upset: What writing it makes wrong in lamp.toml.
    """

    name: Name
    found: int
    text: str
    right: Mapping[Name, int]
    upset: tuple[str, ...] = ()


def named(model: Model, name: Name) -> str:
    """Return a register's name with its address, as "Drive Mode(10)"."""
    return f"{name}({model[name].address})"


def wrong_settings(model: Model, table: Mapping[Name, int], first: float, last: float) -> Iterator[Setting]:
    """Yield which of a servo's registers are wrong that writing mends.

    Args:
        model: The servo's model.
        table: Its registers, in counts.
        first: Smallest servo angle that the joint may have [rad].
        last: Largest servo angle that the joint may have [rad].
    """
    limits = (Name.MIN_POSITION_LIMIT, Name.MAX_POSITION_LIMIT)
    for name, rule in RULES.items():
        if not rule.mend or name not in model.registers or name in limits:
            continue
        right = model[name].initial or 0 if rule.value is None else rule.value
        found = table[name]
        if found != right and not (name is Name.SHADOW_ID and found >= NO_SHADOW):
            locked = " with torque off" if model[name].eeprom else ""
            text = f"{named(model, name)} is {found}, not {right} ({rule.why}); write {right}{locked}"
            upset = () if name is Name.DRIVE_MODE and not found & REVERSE else rule.upset
            yield Setting(name, found, text, {name: int(right)}, upset)
    low, high = (table[name] for name in limits)
    bottom, top = math.floor(first / RAD_PER_COUNT) - LIMIT_MARGIN, math.ceil(last / RAD_PER_COUNT) + LIMIT_MARGIN
    inside = bottom >= 0 and top < COUNTS_PER_TURN
    below, above = first < low * RAD_PER_COUNT, last > high * RAD_PER_COUNT
    wrong = [(name, right) for name, right, off in zip(limits, (bottom, top), (below, above), strict=True) if off]
    if wrong:
        words = " and ".join(f"{named(model, name)} is {table[name]}, not {right}" for name, right in wrong)
        remedy = "widen them" if inside else "mount the horn so that the range does not cross 0"
        yield Setting(
            wrong[0][0],
            table[wrong[0][0]],
            f"the joint's range is {first:.2f} to {last:.2f} rad of the servo's turn, outside its Position Limits "
            f"(52, 48) of {low * RAD_PER_COUNT:.2f} to {high * RAD_PER_COUNT:.2f} ({words}); {remedy}",
            {limits[0]: bottom, limits[1]: top} if inside else {},
        )
