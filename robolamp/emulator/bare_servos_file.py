"""Servos without a lamp, from a TOML file.

Of a servo, all but the model is optional:

name = "arm"

[[servo]]
model = "XL430-W250-T"       # one of the models robolamp knows
id = 1                       # 0 to 252
baud = 1_000_000             # 1/s
return_delay = 0.0           # s, in steps of 2 us; a new servo has 0.0005
position = 3.1416            # rad, of the shaft at the start, 0 to 2 pi
voltage = 12.0               # V, of its supply; the model's recommended one unless given
load = 0.0                   # kg m2, inertia on the shaft

[servo.pendulum]             # instead of a load: an arm with a weight, hanging straight down at `position`
mass = 0.2                   # kg, of the weight; 0: the arm alone
length = 0.1                 # m, from the shaft to its centre
arm_mass = 0.0               # kg, of the arm from the shaft to there, an even rod
swing = 1.5                  # rad, how far it may be swung to either side; as far as half the stall torque holds it
calibration = "nominal"      # what the motor is calculated with: a file, or the name of one in calibration/
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.dynamixel.registers import BAUD_CODES, MODELS, RETURN_DELAY_UNIT
from robolamp.emulator.servo.bare_motor import DATASHEETS
from robolamp.files import Table, read_toml
from robolamp.twin.pendulum_model import Load

_RECOMMENDED_VOLTAGE: Mapping[str, float] = {"XL330-M288-T": 5.0, "XL330-M077-T": 5.0, "XL430-W250-T": 11.1}
"""[V] (e-manual, "Specifications", "Input Voltage")."""

_MOST_DELAY = 254 * RETURN_DELAY_UNIT
_LEAST_MASS = 0.01  # of a pendulum [kg]: less tells nothing about the servo
_MOST_LOAD = 0.1  # kg m2: a metre of arm with 100 g at its end
_GRAVITY = 9.81  # [m/s^2]
_SWING_SHARE = 0.5  # of the stall torque that holding the arm out may take, where no swing is given
_BENCH = "bench"  # the joint of a calibration that turns a pendulum
_FASTEST_LISTED = 4_500_000  # only servos other than the XL330 have it


@dataclass(frozen=True)
class PendulumLoad:
    """An arm with a weight on a servo's shaft.

    Attributes:
        mass: Of the weight [kg].
        length: From the shaft to it [m].
        swing: How far it may be swung to either side [rad].
        values: Parameters of the servo by name, and `encoder_offset`.
        arm_mass: Of the arm, an even rod [kg].
    """

    mass: float
    length: float
    swing: float
    values: Mapping[str, float]
    arm_mass: float = 0.0

    @property
    def load(self) -> Load:
        """What the shaft turns."""
        return Load(self.mass, self.length, self.arm_mass)


@dataclass(frozen=True)
class BareServo:
    """One servo of a servos file.

    Attributes:
        model: Its model's name.
        id: Its id.
        baud: Its rate [1/s].
        return_delay: Its Return Delay Time [s].
        position: Of its shaft at the start [rad].
        voltage: Of its supply [V].
        load: Inertia on its shaft [kg m2].
        pendulum: What it turns instead, from `position` hanging straight down; None: only that inertia.
    """

    model: str
    id: int
    baud: int
    return_delay: float
    position: float
    voltage: float
    load: float
    pendulum: PendulumLoad | None = None


@dataclass(frozen=True)
class ServosFile:
    """A servos file.

    Attributes:
        name: Its name.
        servos: The servos, at least one.
    """

    name: str
    servos: tuple[BareServo, ...]


def load_servos(path: Path, assets: Assets | None = None) -> ServosFile:
    """Read a servos file.

    Args:
        path: The file.
        assets: Where calibrations are; None: the shipped ones.

    Raises:
        FileError: It cannot be read; a key is missing, unknown or outside its range; two servos would answer at once.
    """
    root = Table(read_toml(path), str(path))
    name = root.text("name")
    servos: list[BareServo] = []
    for table in root.tables("servo"):
        servo = _servo(table, assets or Assets())
        for other in servos:
            if (other.id, other.baud) == (servo.id, servo.baud):
                raise table.fail("id", f"{servo.id} at {servo.baud} baud is another servo's too; expected one of each")
        servos.append(servo)
    root.done()
    return ServosFile(name, tuple(servos))


def _servo(table: Table, assets: Assets) -> BareServo:
    model = table.text("model", MODELS)
    baud = table.integer("baud", 9600, _FASTEST_LISTED, default=57_600)
    legal = [rate for rate in BAUD_CODES if rate < _FASTEST_LISTED or model.startswith("XL430")]
    if baud not in legal:
        raise table.fail("baud", f"{baud} is not one of {', '.join(map(str, legal))}")
    voltage = table.number("voltage", 1.0, 20.0, "V", default=_RECOMMENDED_VOLTAGE[model])
    load = table.number("load", 0.0, _MOST_LOAD, "kg m2", default=0.0)
    pendulum = _pendulum(table.table("pendulum"), model, voltage, assets) if "pendulum" in table else None
    if pendulum is not None and load:
        raise table.fail("load", f"{load:g} kg m2 beside a pendulum; expected one of the two")
    servo = BareServo(
        model=model,
        id=table.integer("id", 0, 252, default=1),
        baud=baud,
        return_delay=table.number("return_delay", 0.0, _MOST_DELAY, "s", default=0.0005),
        position=table.number("position", 0.0, 2 * math.pi, "rad", default=math.pi),
        voltage=voltage,
        load=load,
        pendulum=pendulum,
    )
    table.done()
    return servo


def _pendulum(table: Table, model: str, voltage: float, assets: Assets) -> PendulumLoad:
    arm_mass = table.number("arm_mass", 0.0, 5.0, "kg", default=0.0)
    mass = table.number("mass", 0.0 if arm_mass >= _LEAST_MASS else _LEAST_MASS, 5.0, "kg")
    length = table.number("length", 0.02, 1.0, "m")
    sheet = DATASHEETS[model]
    holds = sheet.stall_torque * voltage / sheet.voltage
    share = _SWING_SHARE * holds / (Load(mass, length, arm_mass).moment * _GRAVITY)
    swing = math.asin(share) if share < 1.0 else math.pi / 2
    swing = table.number("swing", 0.1, math.pi / 2, "rad", default=swing)
    calibration = load_calibration(assets, table.text("calibration", default="nominal"))
    offset = calibration.joint(_BENCH, "encoder_offset")
    table.done()
    values = {**calibration.servo(model, _BENCH), "encoder_offset": offset}
    return PendulumLoad(mass, length, swing, values, arm_mass)
