"""Realities drawn by chance."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.emulator.reality.draw import KINDS, random_knob, random_reality
from robolamp.emulator.reality.file import NONE, Reality, load_reality
from robolamp.errors import FileError
from robolamp.twin.bend import Bend
from robolamp.twin.variation.random_lamps import LampLaw

from .test_emulated_lamp import LAMP, Client

FIELDS = [field.name for field in dataclasses.fields(Reality) if field.name not in ("name", "seed")]


def differing(reality: Reality) -> set[str]:
    none = Reality.none(LAMP)
    return {name for name in FIELDS if not same(getattr(reality, name), getattr(none, name))}


def same(one: object, two: object) -> bool:
    return bool(np.all(np.isclose(np.asarray(one, float), np.asarray(two, float), rtol=0, atol=0, equal_nan=True)))


def test_a_random_reality_bends_everything() -> None:
    assert differing(random_reality(LAMP, 3)) == {*FIELDS}


def test_controllers_are_scored_on_the_lamps_that_the_emulator_has() -> None:
    """The same seed draws the same lamp for the twin's lanes and for the emulator."""
    law = LampLaw(LAMP, load_calibration(Assets()), Assets())
    _, bend = law.draw(np.random.default_rng(5))
    reality = random_reality(LAMP, bend.seed)
    for field in dataclasses.fields(Bend):
        np.testing.assert_array_equal(getattr(bend, field.name), getattr(reality, field.name), err_msg=field.name)


def test_the_same_seed_draws_the_same() -> None:
    one, two, three = random_reality(LAMP, 3), random_reality(LAMP, 3), random_reality(LAMP, 4)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert not np.array_equal(one.backlash, three.backlash)


def test_scale_shrinks_every_deviation_to_nothing() -> None:
    whole, half = random_reality(LAMP, 5), random_reality(LAMP, 5, 0.5)
    np.testing.assert_allclose(half.delay, 0.5 * whole.delay)
    np.testing.assert_allclose(np.log(half.strength), 0.5 * np.log(whole.strength))
    assert half.stiffness == pytest.approx(math.sqrt(23.0 * whole.stiffness))
    none = random_reality(LAMP, 5, 0.0)  # play and stiffness are the spread's own medians, which are no lamp's own
    assert differing(none) <= {"encoder_phase", "stiffness", "backlash"}  # the phase is of a wave without height
    assert none.stiffness == pytest.approx(23.0)
    np.testing.assert_allclose(none.backlash, 0.005)


@pytest.mark.parametrize("kind", KINDS)
def test_a_knob_bends_one_thing_at_one_place(kind: str) -> None:
    knob = random_knob(kind, LAMP, 11)
    assert differing(knob.reality) == {KINDS[kind].attribute}
    bent = np.asarray(getattr(knob.reality, KINDS[kind].attribute))
    if knob.joint is None:
        assert bent == knob.value
    else:
        off = getattr(Reality.none(LAMP), KINDS[kind].attribute)
        differs = ~np.isclose(bent, np.broadcast_to(off, 3), rtol=0, atol=0, equal_nan=True)
        assert np.flatnonzero(differs).tolist() == [LAMP.names.index(knob.joint)]
        assert bent[LAMP.names.index(knob.joint)] == knob.value
    assert math.isfinite(knob.value)


def test_seeds_reach_every_joint() -> None:
    assert {random_knob("backlash", LAMP, seed).joint for seed in range(20)} == {*LAMP.names}


@pytest.mark.parametrize("seed", range(24))
def test_no_reality_diverges_even_at_its_largest(seed: int) -> None:
    client = Client(random_reality(LAMP, seed, 3.0 if seed % 2 else 1.0))
    client.start()
    rng = np.random.default_rng(seed)
    for _ in range(8):
        client.go(list(rng.uniform([-0.6, -1.0, -1.0], [0.6, 0.75, 0.35])))
        client.wait(0.1)  # raises where it diverges
    assert np.isfinite(client.lamp.plant.angle).all()
    assert np.abs(client.lamp.plant.velocity).max() < 60.0


@pytest.mark.parametrize("kind", ["backlash", "compliance", "supply_sag", "tilt"])
def test_extremes_of_what_could_be_unstable(kind: str) -> None:
    for values in ({"backlash": 0.1, "stiffness": 60.0}, {"backlash": 0.1, "armature": 0.2}, {"stiffness": 5.0}):
        client = Client(dataclasses.replace(random_knob(kind, LAMP, 0).reality, **values))
        client.start(4000)
        client.go([0.5, 0.7, 0.3])
        client.wait(0.4)
        assert np.abs(client.lamp.plant.velocity).max() < 60.0


def test_names_are_read() -> None:
    assets = Assets()
    assert load_reality("random:7", LAMP, assets).name == "random:7"
    assert load_reality("random:7:0.5", LAMP, assets).name == "random:7:0.5"
    assert differing(load_reality("knob:tilt:7", LAMP, assets)) == {"floor_tilt"}
    assert load_reality(NONE, LAMP, assets).name == NONE


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("random:", "no such reality"),
        ("random:x", "seed: 'x' is not a whole number from 0 to 4294967295"),
        ("random:-1", "seed: '-1' is not a whole number"),
        ("random:1:x", "scale: 'x' is not a number from 0 to 3"),
        ("random:1:9", "scale: 9.0 is not a number from 0 to 3"),
        ("random:1:nan", "scale: nan is not a number from 0 to 3"),
        ("random:1:1:1", "expected random:SEED or random:SEED:SCALE"),
        ("knob:nose:1", "kind: 'nose' is not one of delay, strength"),
        ("knob:tilt", "expected knob:KIND:SEED"),
    ],
)
def test_a_wrong_name_is_refused_in_one_line(name: str, says: str) -> None:
    with pytest.raises(FileError) as failure:
        load_reality(name, LAMP, Assets())
    assert says in str(failure.value)
    assert "\n" not in str(failure.value)
