from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.reality.file import FOLDER, Reality, load_reality
from robolamp.errors import FileError
from robolamp.foot.protocol import Decoder
from robolamp.lamp import load_lamp

from .parts import write

ASSETS = Assets()
LAMP = load_lamp(ASSETS)


def load(tmp_path: Path, text: str) -> Reality:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return load_reality(path, LAMP, ASSETS)


def test_none_is_the_twin_itself() -> None:
    none = load_reality("none", LAMP, ASSETS)
    assert none.strength.tolist() == none.friction.tolist() == [1.0, 1.0, 1.0]
    assert not none.encoder_noise.any()
    assert (none.jitter, none.foot_gain, none.foot_noise, none.floor_friction, none.mass) == (0.0, 1.0, 0.0, 1.0, 1.0)


def test_every_shipped_reality_loads() -> None:
    shipped = list(ASSETS.all(FOLDER))
    assert "worn" in [path.stem for path in shipped]
    for path in shipped:
        assert load_reality(path.stem, LAMP, ASSETS).name == path.stem


def test_what_is_not_given_is_off(tmp_path: Path) -> None:
    reality = load(tmp_path, 'name = "x"\n[joint.neck]\nstrength = 0.5\n[foot]\nnoise = 0.1\n')
    np.testing.assert_array_equal(reality.strength, [1.0, 1.0, 0.5])
    np.testing.assert_array_equal(reality.friction, np.ones(3))
    assert (reality.foot_noise, reality.jitter) == (0.1, 0.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('name = "x"\n[joint.elbow]\nstrength = 1.0\n', "elbow: no such joint; expected one of ankle, knee, neck"),
        ('name = "x"\n[joint.knee]\nstrength = 0.0\n', "joint.knee.strength: 0.0 is not a number from 0.1 to 2"),
        ('name = "x"\n[joint.knee]\nstrenght = 1.0\n', "joint.knee.strenght: unknown"),
        ('name = "x"\n[line]\njitter = 1.0\n', "line.jitter: 1.0 is not a number from 0 to 0.05 s"),
        ('name = "x"\n[lamp]\nmass = nan\n', "lamp.mass: nan is not"),
        ('name = "x"\nspeed = 1\n', "speed: unknown"),
        ("seed = 1\n", "name: missing"),
        ("name = \n", "not valid TOML"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(FileError, match=r"mine\.toml") as failure:
        load(tmp_path, text)
    assert says in str(failure.value)
    assert "\n" not in str(failure.value)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(FileError, match=r"no such reality.*worn"):
        load_reality("wrong", LAMP, ASSETS)


def test_a_weak_supply_sags_under_load_and_drains(tmp_path: Path) -> None:
    def lowest(text: str) -> float:
        world = EmulatedLamp(LAMP, load_calibration(ASSETS), ASSETS, load(tmp_path, 'name = "x"\n' + text))
        for id in (1, 2, 3):
            world.receive(write(id, 64, 1, 1), 0.0)
        world.receive(write(3, 116, 1700, 4), 0.1)
        volts = []
        world.watch(lambda lamp: volts.append(lamp.plant.voltage))
        world.advance_to(0.6)
        return min(volts)

    full = lowest("")
    assert 0.02 < full - lowest("[supply]\nresistance = 0.3\n") < 1.0
    assert full - lowest("[supply]\ndrain = 0.1\n") == pytest.approx(0.06, abs=0.002)


def test_a_foot_is_off_and_drifts(tmp_path: Path) -> None:
    def newest(text: str) -> float:
        world = EmulatedLamp(LAMP, load_calibration(ASSETS), ASSETS, load(tmp_path, 'name = "x"\n' + text))
        world.advance_to(1.0)
        return Decoder().feed(world.frames(1.0))[-1].force

    assert newest("[foot]\noffset = 0.5\n") == pytest.approx(newest("") + 0.5, abs=0.002)
    assert newest("[foot]\ndrift = -0.2\n") == pytest.approx(newest("") - 0.2, abs=0.002)


def test_a_slow_line_answers_late(tmp_path: Path) -> None:
    bent = load(tmp_path, 'name = "x"\n[line]\nlatency = 0.004\n')
    world = EmulatedLamp(LAMP, load_calibration(ASSETS), ASSETS, bent)
    (reply,) = world.receive(write(1, 65, 1, 1), 1.0)
    assert reply.due == pytest.approx(1.004 + (13 + 11) * 1e-5)
