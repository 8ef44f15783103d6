"""The control tables of the servos a lamp may have, as data: addresses, sizes, ranges, factory values, units.

Sources: the ROBOTIS e-manual's control tables,
https://emanual.robotis.com/docs/en/dxl/x/xl330-m288/#control-table,
https://emanual.robotis.com/docs/en/dxl/x/xl330-m077/#control-table,
https://emanual.robotis.com/docs/en/dxl/x/xl430-w250/#control-table.
Values are little-endian; signed ones are two's complement. Indirect data of the XL330 is where firmware 52 and later
has it (208); older firmware has it at 224 (dynamixel_easy_sdk, xl330_m288.model against xl330_m288_fw52.model).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum
from types import MappingProxyType

RAM_START = 64
"""Address where the EEPROM area ends and the RAM area begins."""

COUNTS_PER_TURN = 4096
"""Position counts in one turn of the output (12-bit encoder, e-manual "Resolution")."""

RAD_PER_COUNT = 2 * math.pi / COUNTS_PER_TURN
"""Unit of positions [rad]."""

VELOCITY_UNIT = 0.229 * 2 * math.pi / 60
"""Unit of velocities, 0.229 rev/min [rad/s]."""

ACCELERATION_UNIT = 214.577 * 2 * math.pi / 3600
"""Unit of Profile Acceleration, 214.577 rev/min^2 [rad/s^2]."""

CURRENT_UNIT = 0.001
"""Unit of currents, 1 mA [A]."""

VOLTAGE_UNIT = 0.1
"""Unit of voltages [V]."""

FULL_PWM = 885
"""PWM register value that is a duty of 1 (e-manual "PWM Limit(36)": 885 is 100 %)."""

RETURN_DELAY_UNIT = 2e-6
"""Unit of Return Delay Time [s]."""

WATCHDOG_UNIT = 0.020
"""Unit of Bus Watchdog [s]."""

BAUD_CODES: Mapping[int, int] = MappingProxyType(
    {9600: 0, 57600: 1, 115_200: 2, 1_000_000: 3, 2_000_000: 4, 3_000_000: 5, 4_000_000: 6, 4_500_000: 7}
)
"""Baud rate [1/s] to the value of Baud Rate(8); 7 exists on the XL430-W250-T only."""


class OperatingMode(IntEnum):
    """Values of Operating Mode(11)."""

    CURRENT = 0
    VELOCITY = 1
    POSITION = 3
    EXTENDED_POSITION = 4
    CURRENT_BASED_POSITION = 5
    PWM = 16


class HardwareError(IntFlag):
    """Bits of Hardware Error Status(70) and of Shutdown(63)."""

    VOLTAGE = 0x01
    OVERHEATING = 0x04
    ENCODER = 0x08
    ELECTRICAL_SHOCK = 0x10
    OVERLOAD = 0x20

    @classmethod
    def words(cls, bits: int) -> str:
        """Return the set bits in words, as "overload, overheating"; unknown bits in hexadecimal."""
        names = [_ERROR_WORDS[flag] for flag in cls if bits & flag]
        rest = bits & ~sum(cls)
        return ", ".join(names + ([f"bits {rest:#04x}"] if rest else []))


_ERROR_WORDS = {
    HardwareError.VOLTAGE: "input voltage outside its limits",
    HardwareError.OVERHEATING: "overheating",
    HardwareError.ENCODER: "encoder failure",
    HardwareError.ELECTRICAL_SHOCK: "electrical shock or too little power",
    HardwareError.OVERLOAD: "overload",
}


class Name(StrEnum):
    """Names of the registers, as the e-manual writes them."""

    MODEL_NUMBER = "Model Number"
    MODEL_INFORMATION = "Model Information"
    FIRMWARE_VERSION = "Firmware Version"
    ID = "ID"
    BAUD_RATE = "Baud Rate"
    RETURN_DELAY_TIME = "Return Delay Time"
    DRIVE_MODE = "Drive Mode"
    OPERATING_MODE = "Operating Mode"
    SHADOW_ID = "Secondary(Shadow) ID"
    PROTOCOL_TYPE = "Protocol Type"
    HOMING_OFFSET = "Homing Offset"
    MOVING_THRESHOLD = "Moving Threshold"
    TEMPERATURE_LIMIT = "Temperature Limit"
    MAX_VOLTAGE_LIMIT = "Max Voltage Limit"
    MIN_VOLTAGE_LIMIT = "Min Voltage Limit"
    PWM_LIMIT = "PWM Limit"
    CURRENT_LIMIT = "Current Limit"
    VELOCITY_LIMIT = "Velocity Limit"
    MAX_POSITION_LIMIT = "Max Position Limit"
    MIN_POSITION_LIMIT = "Min Position Limit"
    STARTUP_CONFIGURATION = "Startup Configuration"
    PWM_SLOPE = "PWM Slope"
    SHUTDOWN = "Shutdown"
    TORQUE_ENABLE = "Torque Enable"
    LED = "LED"
    STATUS_RETURN_LEVEL = "Status Return Level"
    REGISTERED_INSTRUCTION = "Registered Instruction"
    HARDWARE_ERROR_STATUS = "Hardware Error Status"
    VELOCITY_I_GAIN = "Velocity I Gain"
    VELOCITY_P_GAIN = "Velocity P Gain"
    POSITION_D_GAIN = "Position D Gain"
    POSITION_I_GAIN = "Position I Gain"
    POSITION_P_GAIN = "Position P Gain"
    FEEDFORWARD_2ND_GAIN = "Feedforward 2nd Gain"
    FEEDFORWARD_1ST_GAIN = "Feedforward 1st Gain"
    BUS_WATCHDOG = "Bus Watchdog"
    GOAL_PWM = "Goal PWM"
    GOAL_CURRENT = "Goal Current"
    GOAL_VELOCITY = "Goal Velocity"
    PROFILE_ACCELERATION = "Profile Acceleration"
    PROFILE_VELOCITY = "Profile Velocity"
    GOAL_POSITION = "Goal Position"
    REALTIME_TICK = "Realtime Tick"
    MOVING = "Moving"
    MOVING_STATUS = "Moving Status"
    PRESENT_PWM = "Present PWM"
    PRESENT_CURRENT = "Present Current"
    PRESENT_LOAD = "Present Load"
    PRESENT_VELOCITY = "Present Velocity"
    PRESENT_POSITION = "Present Position"
    VELOCITY_TRAJECTORY = "Velocity Trajectory"
    POSITION_TRAJECTORY = "Position Trajectory"
    PRESENT_INPUT_VOLTAGE = "Present Input Voltage"
    PRESENT_TEMPERATURE = "Present Temperature"
    BACKUP_READY = "Backup Ready"


@dataclass(frozen=True)
class Register:
    """One register of a control table.

    Attributes:
        name: Its name.
        address: Address of its first byte.
        size: Bytes: 1, 2 or 4.
        initial: Factory (EEPROM) or power-on (RAM) value; None where the servo decides it (goals, measurements).
        low: Smallest value that may be written; None: any.
        high: Largest value that may be written; None: any.
        choices: The only values that may be written, where not all from low to high; empty: no such restriction.
        bounds: Registers that bound it instead: one name, plus or minus its value; two names, lower and upper limit.
        writable: Access RW (True) or R.
        signed: Two's complement.
        scale: Unit of one count, in `unit`.
        unit: SI unit (degC for temperatures), "1" for none.
    """

    name: Name
    address: int
    size: int
    initial: int | None = None
    low: int | None = None
    high: int | None = None
    choices: tuple[int, ...] = ()
    bounds: tuple[Name, ...] = ()
    writable: bool = True
    signed: bool = False
    scale: float = 1.0
    unit: str = "1"

    @property
    def eeprom(self) -> bool:
        """Kept without power, and writable only with torque off (addresses below 64); else RAM."""
        return self.address < RAM_START


@dataclass(frozen=True)
class IndirectBlock:
    """A run of indirect registers: each 2-byte address at `address` maps one byte at `data`.

    Attributes:
        address: Address of the first Indirect Address register.
        data: Address of the first Indirect Data byte; the factory value of the first Indirect Address.
        count: How many of them.
        low: Smallest address that may be mapped.
        high: Largest address that may be mapped.
    """

    address: int
    data: int
    count: int
    low: int
    high: int


@dataclass(frozen=True)
class Model:
    """A servo model.

    Attributes:
        name: As sold, "XL330-M288-T".
        number: Model Number(0).
        registers: Its control table by name, in order of address.
        indirect: Its indirect registers.
        fast_sync_read: First firmware version that answers Fast Sync Read (e-manual "Fast Sync Read").
        url: The e-manual's control table.
        least_voltage: Lowest supply that it is made for [V] (e-manual "Specifications", "Input Voltage").
    """

    name: str
    number: int
    registers: Mapping[Name, Register]
    indirect: tuple[IndirectBlock, ...]
    fast_sync_read: int
    url: str
    least_voltage: float

    def __getitem__(self, name: Name) -> Register:
        """Return a register by name."""
        return self.registers[name]


_GAIN = 16_383
_MODES_X330 = (0, 1, 3, 4, 5, 16)
_MODES_X430 = (1, 3, 4, 16)


def _table(
    *,
    number: int,
    baud_codes: int,
    modes: tuple[int, ...],
    protocols: tuple[int, ...],
    temperature: int,
    voltage: tuple[int, int, int],
    velocity: tuple[int, int],
    shutdown: int,
    velocity_gains: tuple[int, int],
    position_gains: tuple[int, int, int],
    current_sensor: bool,
) -> Mapping[Name, Register]:
    """Return a control table; the arguments are what differs between models.

    Args:
        number: Model number.
        baud_codes: Largest Baud Rate(8).
        modes: Legal Operating Modes.
        protocols: Legal Protocol Types.
        temperature: Factory Temperature Limit [degC].
        voltage: Factory Min and Max Voltage Limit, and the smallest legal one [0.1 V]; the factory Max is the largest.
        velocity: Factory and largest Velocity Limit [0.229 rev/min].
        shutdown: Factory Shutdown bits.
        velocity_gains: Velocity I and P Gain at power-on.
        position_gains: Position D, I and P Gain at power-on.
        current_sensor: Whether it measures current (X330), or only estimates load (X430).
    """
    n = Name
    volt_initial_low, volt_high, volt_low = voltage

    def present(
        name: Name, address: int, size: int, *, scale: float = 1.0, unit: str = "1", signed: bool = False
    ) -> Register:
        return Register(name, address, size, writable=False, signed=signed, scale=scale, unit=unit)

    # In modes 4 and 5 it goes to +-1,048,575 instead of the limits.
    span = (n.MIN_POSITION_LIMIT, n.MAX_POSITION_LIMIT)
    goal = Register(n.GOAL_POSITION, 116, 4, signed=True, bounds=span, scale=RAD_PER_COUNT, unit="rad")
    rows = [
        Register(n.MODEL_NUMBER, 0, 2, number, writable=False),
        Register(n.MODEL_INFORMATION, 2, 4, writable=False),
        Register(n.FIRMWARE_VERSION, 6, 1, writable=False),
        Register(n.ID, 7, 1, 1, 0, 252),
        Register(n.BAUD_RATE, 8, 1, 1, 0, baud_codes),
        Register(n.RETURN_DELAY_TIME, 9, 1, 250, 0, 254, scale=RETURN_DELAY_UNIT, unit="s"),
        Register(n.DRIVE_MODE, 10, 1, 0, 0, 13),  # bit 0 reverse, bit 2 time-based profile, bit 3 torque on by goal
        Register(n.OPERATING_MODE, 11, 1, 3, min(modes), max(modes), choices=modes),
        Register(n.SHADOW_ID, 12, 1, 255, 0, 255),  # 253 to 255: none
        Register(n.PROTOCOL_TYPE, 13, 1, 2, min(protocols), max(protocols), choices=protocols),
        Register(n.HOMING_OFFSET, 20, 4, 0, -1_044_479, 1_044_479, signed=True, scale=RAD_PER_COUNT, unit="rad"),
        Register(n.MOVING_THRESHOLD, 24, 4, 10, 0, 1023, scale=VELOCITY_UNIT, unit="rad/s"),
        Register(n.TEMPERATURE_LIMIT, 31, 1, temperature, 0, 100, unit="degC"),
        Register(n.MAX_VOLTAGE_LIMIT, 32, 2, volt_high, volt_low, volt_high, scale=VOLTAGE_UNIT, unit="V"),
        Register(n.MIN_VOLTAGE_LIMIT, 34, 2, volt_initial_low, volt_low, volt_high, scale=VOLTAGE_UNIT, unit="V"),
        Register(n.PWM_LIMIT, 36, 2, FULL_PWM, 0, FULL_PWM, scale=1 / FULL_PWM),
        Register(n.CURRENT_LIMIT, 38, 2, 1750, 0, 1750, scale=CURRENT_UNIT, unit="A"),
        Register(n.VELOCITY_LIMIT, 44, 4, velocity[0], 0, velocity[1], scale=VELOCITY_UNIT, unit="rad/s"),
        Register(n.MAX_POSITION_LIMIT, 48, 4, 4095, 0, 4095, scale=RAD_PER_COUNT, unit="rad"),
        Register(n.MIN_POSITION_LIMIT, 52, 4, 0, 0, 4095, scale=RAD_PER_COUNT, unit="rad"),
        Register(n.STARTUP_CONFIGURATION, 60, 1, 0, 0, 3),
        Register(n.PWM_SLOPE, 62, 1, 140, 1, 255, scale=1.977, unit="V/s"),
        Register(n.SHUTDOWN, 63, 1, shutdown),
        Register(n.TORQUE_ENABLE, 64, 1, 0, 0, 1),
        Register(n.LED, 65, 1, 0, 0, 1),
        Register(n.STATUS_RETURN_LEVEL, 68, 1, 2, 0, 2),
        Register(n.REGISTERED_INSTRUCTION, 69, 1, 0, writable=False),
        Register(n.HARDWARE_ERROR_STATUS, 70, 1, 0, writable=False),
        Register(n.VELOCITY_I_GAIN, 76, 2, velocity_gains[0], 0, _GAIN),
        Register(n.VELOCITY_P_GAIN, 78, 2, velocity_gains[1], 0, _GAIN),
        Register(n.POSITION_D_GAIN, 80, 2, position_gains[0], 0, _GAIN),
        Register(n.POSITION_I_GAIN, 82, 2, position_gains[1], 0, _GAIN),
        Register(n.POSITION_P_GAIN, 84, 2, position_gains[2], 0, _GAIN),
        Register(n.FEEDFORWARD_2ND_GAIN, 88, 2, 0, 0, _GAIN),
        Register(n.FEEDFORWARD_1ST_GAIN, 90, 2, 0, 0, _GAIN),
        Register(n.BUS_WATCHDOG, 98, 1, 0, 0, 127, signed=True, scale=WATCHDOG_UNIT, unit="s"),  # -1: tripped
        Register(n.GOAL_PWM, 100, 2, signed=True, bounds=(n.PWM_LIMIT,), scale=1 / FULL_PWM),
        Register(n.GOAL_CURRENT, 102, 2, signed=True, bounds=(n.CURRENT_LIMIT,), scale=CURRENT_UNIT, unit="A"),
        Register(n.GOAL_VELOCITY, 104, 4, signed=True, bounds=(n.VELOCITY_LIMIT,), scale=VELOCITY_UNIT, unit="rad/s"),
        Register(n.PROFILE_ACCELERATION, 108, 4, 0, 0, 32_767, scale=ACCELERATION_UNIT, unit="rad/s^2"),
        Register(n.PROFILE_VELOCITY, 112, 4, 0, 0, 32_767, scale=VELOCITY_UNIT, unit="rad/s"),
        goal,
        present(n.REALTIME_TICK, 120, 2, scale=0.001, unit="s"),
        present(n.MOVING, 122, 1),
        present(n.MOVING_STATUS, 123, 1),
        present(n.PRESENT_PWM, 124, 2, scale=1 / FULL_PWM, signed=True),
        present(n.PRESENT_CURRENT, 126, 2, scale=CURRENT_UNIT, unit="A", signed=True),
        present(n.PRESENT_VELOCITY, 128, 4, scale=VELOCITY_UNIT, unit="rad/s", signed=True),
        present(n.PRESENT_POSITION, 132, 4, scale=RAD_PER_COUNT, unit="rad", signed=True),
        present(n.VELOCITY_TRAJECTORY, 136, 4, scale=VELOCITY_UNIT, unit="rad/s", signed=True),
        present(n.POSITION_TRAJECTORY, 140, 4, scale=RAD_PER_COUNT, unit="rad", signed=True),
        present(n.PRESENT_INPUT_VOLTAGE, 144, 2, scale=VOLTAGE_UNIT, unit="V"),
        present(n.PRESENT_TEMPERATURE, 146, 1, unit="degC"),
        present(n.BACKUP_READY, 147, 1),
    ]
    if not current_sensor:
        absent = (n.CURRENT_LIMIT, n.PWM_SLOPE, n.GOAL_CURRENT)
        load = present(n.PRESENT_LOAD, 126, 2, scale=0.001, signed=True)
        rows = [load if row.name is n.PRESENT_CURRENT else row for row in rows if row.name not in absent]
    return MappingProxyType({row.name: row for row in rows})


_X330_INDIRECT = (IndirectBlock(168, 208, 20, 64, 227),)
_X430_INDIRECT = (IndirectBlock(168, 224, 28, 64, 661), IndirectBlock(578, 634, 28, 64, 661))
_MANUAL = "https://emanual.robotis.com/docs/en/dxl/x/{}/#control-table"

MODELS: Mapping[str, Model] = MappingProxyType(
    {
        "XL330-M288-T": Model(
            "XL330-M288-T",
            1200,
            _table(
                number=1200,
                baud_codes=6,
                modes=_MODES_X330,
                protocols=(2, 20, 21, 22),
                temperature=70,
                voltage=(35, 70, 31),
                velocity=(445, 2047),
                shutdown=53,
                velocity_gains=(1600, 180),
                position_gains=(0, 0, 400),
                current_sensor=True,
            ),
            _X330_INDIRECT,
            46,
            _MANUAL.format("xl330-m288"),
            3.7,
        ),
        "XL330-M077-T": Model(
            "XL330-M077-T",
            1190,
            _table(
                number=1190,
                baud_codes=6,
                modes=_MODES_X330,
                protocols=(2, 20, 21, 22),
                temperature=70,
                voltage=(35, 70, 31),
                velocity=(1620, 2047),
                shutdown=53,
                velocity_gains=(400, 40),
                position_gains=(0, 400, 400),
                current_sensor=True,
            ),
            _X330_INDIRECT,
            46,
            _MANUAL.format("xl330-m077"),
            3.7,
        ),
        "XL430-W250-T": Model(
            "XL430-W250-T",
            1060,
            _table(
                number=1060,
                baud_codes=7,
                modes=_MODES_X430,
                protocols=(1, 2),
                temperature=72,
                voltage=(60, 140, 60),
                velocity=(265, 1023),
                shutdown=52,
                velocity_gains=(1000, 100),
                position_gains=(4000, 0, 640),
                current_sensor=False,
            ),
            _X430_INDIRECT,
            45,
            _MANUAL.format("xl430-w250"),
            6.5,
        ),
    }
)
"""The known servo models by name."""


def model_by_number(number: int) -> Model | None:
    """Return the model of a Model Number(0), or None if it is not a known one."""
    return next((model for model in MODELS.values() if model.number == number), None)
