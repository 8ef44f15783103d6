from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.errors import FileError
from robolamp.lamp import Lamp, load_lamp, same_lamp
from robolamp.signals import Health, Interventions

TEXT = """
name = "lamp"
model = "sim/lamp/scene.xml"
[bus]
port = "/dev/ttyUSB0"
baud = 1_000_000
[foot]
port = "/dev/ttyACM0"
baud = 115_200
contact_on = 0.40
contact_off = 0.20
[safety]
preflight_angle = 0.17
[[joint]]
name = "ankle"
servo = "XL330-M288-T"
id = 1
sign = 1
zero = 3.141593
lower = -0.60
upper = 0.60
rest = 0.0
slew = 14.0
position_p_gain = 800
[[joint]]
name = "knee"
servo = "XL330-M288-T"
id = 2
sign = -1
zero = 3.141593
lower = -1.00
upper = 0.78
slew = 14.0
position_p_gain = 800
"""


def changed(folder: Path, old: str, new: str) -> Lamp:
    assert old in TEXT
    (folder / "hardware").mkdir(exist_ok=True)
    (folder / "hardware" / "lamp.toml").write_text(TEXT.replace(old, new, 1))
    return load_lamp(Assets.of(folder))


def test_the_shipped_lamp() -> None:
    lamp = load_lamp(Assets())
    assert lamp.names == ("ankle", "knee", "neck")
    assert lamp.source == Assets().path("hardware/lamp.toml").read_text()
    assert (lamp.lower < 0).all()
    assert (lamp.upper > 0).all()
    assert ((lamp.lower <= lamp.rest) & (lamp.rest <= lamp.upper)).all()
    assert lamp.slew.shape == (3,)
    assert lamp.contact_off < lamp.contact_on


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("baud = 1_000_000", "baud = 100", "bus.baud: 100 is not a whole number from 9600 to 4500000"),
        ("sign = -1", "sign = 0", "joint[1].sign: 0 is not one of -1, 1"),
        ("sign = -1", "sign = 2", "joint[1].sign: 2 is not a whole number from -1 to 1"),
        ("id = 2", "id = 1", "joint: two joints have the same id (1, 1)"),
        ("id = 2", "id = 253", "joint[1].id: 253 is not a whole number from 0 to 252"),
        ('name = "knee"', 'name = "ankle"', "joint: two joints have the same name (ankle, ankle)"),
        ('servo = "XL330-M288-T"', 'servo = "AX-12"', "joint[0].servo: 'AX-12' is not one of XL330-M288-T,"),
        ("lower = -1.00", "lower = 1.00", "joint[1].upper: 0.78 is not above lower = 1 rad"),
        ("rest = 0.0", "rest = 2.0", "joint[0].rest: 2.0 is not a number from -0.6 to 0.6 rad"),
        (
            "lower = -0.60",
            "lower = 0.10",
            "joint[0].lower: 0.1 is above 0 rad; the soft start goes to the neutral pose",
        ),
        (
            "upper = 0.78",
            "upper = -0.10",
            "joint[1].upper: -0.1 is below 0 rad; the soft start goes to the neutral pose",
        ),
        (
            "preflight_angle = 0.17",
            "preflight_angle = 0.6",
            "safety.preflight_angle: 0.6 is not a number from 0 to 0.5",
        ),
        ("slew = 14.0", "slew = nan", "joint[0].slew: nan is not a number from 0.1 to 100 rad/s"),
        ("zero = 3.141593", "zero = 180", "joint[0].zero: 180 is not a number from 0 to 6.28319 rad"),
        ("contact_off = 0.20", "contact_off = 0.5", "foot.contact_off: 0.5 is not a number from 0 to 0.4 N"),
        ("[safety]", "flight_time = 0\n[safety]", "foot.flight_time: 0 is not a number from 0.001 to 10 s"),
        ("[safety]", "flight_time = 80.0\n[safety]", "foot.flight_time: 80.0 is not a number from 0.001 to 10 s"),
        ("[safety]", "[safetey]", "safety: missing; expected a table"),
        ('name = "lamp"', 'name = "lamp"\ncolour = "red"', "colour: unknown; expected one of"),
        ("slew = 14.0", "slew = 14.0\nspeed = 1", "joint[0].speed: unknown; expected one of"),
    ],
)
def test_a_bad_description_is_refused_by_file_key_and_legal_values(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    with pytest.raises(FileError) as caught:
        changed(tmp_path, old, new)
    assert str(caught.value).startswith(f"{tmp_path / 'hardware' / 'lamp.toml'}: {words}")


def test_a_description_read_back(tmp_path: Path) -> None:
    lamp = changed(tmp_path, "rest = 0.0", "rest = 0.5")
    assert lamp.names == ("ankle", "knee")
    assert lamp.rest.tolist() == [0.5, 0.0]
    assert lamp.lower.tolist() == [-0.6, -1.0]
    assert lamp.joints[1].sign == -1
    assert (lamp.bus_baud, lamp.foot_port, lamp.contact_off) == (1_000_000, "/dev/ttyACM0", 0.2)


def test_the_shortest_flight_is_80_ms_unless_the_file_says_otherwise(tmp_path: Path) -> None:
    assert changed(tmp_path, "[safety]", "[safety]").flight_time == 0.08  # a file of 0.1.0
    assert changed(tmp_path, "[safety]", "flight_time = 0.05\n[safety]").flight_time == 0.05


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("id = 2", "id = 2  # the middle one", True),
        ("[safety]", "flight_time = 0.08\n[safety]", True),
        ("[safety]", "flight_time = 0.05\n[safety]", False),
        ("sign = -1", "sign = 1", False),
        ("sign = -1", "sign = ", False),
        ("sign = -1", "", False),
    ],
)
def test_a_lamp_is_the_same_where_its_file_says_the_same(tmp_path: Path, old: str, new: str, same: bool) -> None:
    lamp = changed(tmp_path, "[safety]", "[safety]")
    assert same_lamp(lamp, TEXT.replace(old, new, 1)) == same


def test_what_is_not_known_of_servos_is_not_a_number() -> None:
    health = Health.unknown(3)
    assert np.isnan([health.voltage, health.temperature, health.pwm]).all()
    assert health.torque.tolist() == health.hardware_error.tolist() == [-1] * 3
    health.voltage[0] = 5.0
    assert np.isnan(health.temperature[0])
    assert Interventions(1, 2, 4).total == 7
