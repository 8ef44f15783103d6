"""Realities: how an emulated lamp differs from its twin, so that a comparison of the two has something to find.

A TOML file of sim/lamp/realities/; every value is optional, and off unless it is given:

    name = "worn"
    seed = 1                     # of all noise

    [joint.knee]                 # a joint of hardware/lamp.toml
    strength = 0.92              # torque constant, times this
    friction = 1.3               # all friction of its servo, times this, on top of each kind's own factor:
    coulomb = 1.0                #   dry friction, times this
    viscous = 1.0                #   friction by speed, times this
    stribeck = 1.0               #   what dry friction is more at standstill, times this
    stribeck_velocity = 1.0      #   the speed at which that is gone, times this
    load_friction = 1.0          #   friction by the load on the gears, times this
    armature = 1.0               # the rotor's inertia, times this
    mass = 1.0                   # of the link that the joint turns, times this
    backlash = 0.006             # rad, play between gear train and output, from end to end; else the calibration's
    encoder_noise = 0.001        # rad, standard deviation of each reading
    encoder_offset = 0.0         # rad, added to each reading
    encoder_nonlinearity = 0.004 # rad, amplitude of an error that repeats with each turn of the encoder
    encoder_phase = 0.0          # rad, of that error

    [servo]
    delay = 0.0                  # s, added to the servos' delay
    temperature = 30.0           # degC, of the air around them
    resistance_per_kelvin = 0.0  # 1/K, by which their windings' resistance grows above 30 degC; copper: 0.0039

    [line]
    latency = 0.0                # s, how late every instruction reaches the servos
    jitter = 0.0003              # s, mean of how much later still (exponential)

    [supply]
    voltage = 0.0                # V, added to the calibration's
    resistance = 0.0             # Ohm, of cable and battery: the supply sags under load
    drain = 0.0                  # V/s, by which it falls as time goes

    [foot]
    gain = 1.0                   # sensor reading, times this
    offset = 0.0                 # N, added to each reading
    drift = 0.0                  # N/s, by which the offset grows
    noise = 0.03                 # N, standard deviation of each reading
    dead_time = 0.0              # s, how old the force of each reading is

    [lamp]
    floor_friction = 1.0         # sliding friction of foot on floor, times this
    floor_tilt = 0.0             # rad, positive: the floor rises ahead
    floor_softness = 1.0         # time constant of contacts, times this
    mass = 1.0                   # all masses, times this
    sideways = 0.0               # m, how far to the left of the plane of motion all centres of mass are
    stiffness = 15.0             # Nm/rad, behind each servo (1e4: as if rigid); else the calibration's

In place of a file, "random:7" is the reality that `robolamp.emulator.reality.draw.random_reality` draws with seed 7
("random:7:0.5" with half of everything), and "knob:backlash:7" the one with a single knob bent, by `random_knob`.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.emulator.reality.draw import drawn
from robolamp.emulator.reality.reality import AIR, NONE, Reality
from robolamp.files import Table, read_toml
from robolamp.lamp import Lamp

FOLDER = "sim/lamp/realities"
"""Where realities are found by name."""

# Every key: smallest and largest legal value, value that is off, unit.
_JOINT: dict[str, tuple[float, float, float, str]] = {
    "strength": (0.1, 2.0, 1.0, ""),
    "friction": (0.0, 10.0, 1.0, ""),
    "coulomb": (0.0, 10.0, 1.0, ""),
    "viscous": (0.0, 10.0, 1.0, ""),
    "stribeck": (0.0, 10.0, 1.0, ""),
    "stribeck_velocity": (0.1, 10.0, 1.0, ""),
    "load_friction": (0.0, 3.0, 1.0, ""),
    "armature": (0.2, 5.0, 1.0, ""),
    "mass": (0.2, 5.0, 1.0, ""),
    "backlash": (0.0, 0.1, math.nan, "rad"),
    "encoder_noise": (0.0, 0.1, 0.0, "rad"),
    "encoder_offset": (-0.5, 0.5, 0.0, "rad"),
    "encoder_nonlinearity": (0.0, 0.1, 0.0, "rad"),
    "encoder_phase": (-math.tau, math.tau, 0.0, "rad"),
}
_WHOLE: dict[str, dict[str, tuple[str, float, float, float, str]]] = {
    "servo": {
        "delay": ("delay", -0.02, 0.02, 0.0, "s"),
        "temperature": ("temperature", -5.0, 70.0, AIR, "degC"),
        "resistance_per_kelvin": ("resistance_per_kelvin", 0.0, 0.01, 0.0, "1/K"),
    },
    "line": {
        "latency": ("latency", 0.0, 0.05, 0.0, "s"),
        "jitter": ("jitter", 0.0, 0.05, 0.0, "s"),
    },
    "supply": {
        "voltage": ("supply", -2.0, 2.0, 0.0, "V"),
        "resistance": ("resistance", 0.0, 1.0, 0.0, "Ohm"),
        "drain": ("drain", 0.0, 0.1, 0.0, "V/s"),
    },
    "foot": {
        "gain": ("foot_gain", 0.0, 10.0, 1.0, ""),
        "offset": ("foot_offset", -10.0, 10.0, 0.0, "N"),
        "drift": ("foot_drift", -1.0, 1.0, 0.0, "N/s"),
        "noise": ("foot_noise", 0.0, 10.0, 0.0, "N"),
        "dead_time": ("foot_dead_time", 0.0, 0.1, 0.0, "s"),
    },
    "lamp": {
        "floor_friction": ("floor_friction", 0.05, 5.0, 1.0, ""),
        "floor_tilt": ("floor_tilt", -0.3, 0.3, 0.0, "rad"),
        "floor_softness": ("floor_softness", 1.0, 5.0, 1.0, ""),
        "mass": ("mass", 0.2, 5.0, 1.0, ""),
        "sideways": ("sideways", -0.02, 0.02, 0.0, "m"),
        "stiffness": ("stiffness", 5.0, math.inf, math.nan, "Nm/rad"),
    },
}
"""Of each table: key to attribute of `Reality`, smallest and largest legal value, value that is off, unit."""


def load_reality(name: str | Path, lamp: Lamp, assets: Assets) -> Reality:
    """Read a reality, or draw one.

    Args:
        name: "none", a file, the name of one in sim/lamp/realities/, "random:SEED[:SCALE]" or "knob:KIND:SEED".
        lamp: Names the joints a reality may bend.
        assets: Where to look.

    Raises:
        FileError: No such file or name, an unknown key or joint, or a value outside its range.
    """
    if str(name) == NONE:
        return Reality.none(lamp)
    reality = drawn(str(name), lamp, assets)
    if reality is not None:
        return reality
    path = assets.named(name, FOLDER, "reality")
    root = Table(read_toml(path), str(path))
    title, seed = root.text("name"), root.integer("seed", 0, 2**32 - 1, default=0)
    joints = root.table("joint", default={})
    for joint in joints.names():
        if joint not in lamp.names:
            raise joints.fail(
                joint,
                f"no such joint; expected one of {', '.join(lamp.names)}"
                + "; for this lamp: none, random:SEED, knob:KIND:SEED or a file of its own" * (path != Path(name)),
            )
    own = [joints.table(joint, default={}) for joint in lamp.names]
    values: dict[str, NDArray[np.float64]] = {}
    for key, (low, high, off, unit) in _JOINT.items():
        column = [table.number(key, low, high, unit, default=off) for table in own]
        values["link_mass" if key == "mass" else key] = np.array(column)
    wholes: dict[str, float] = {}
    tables = {key: root.table(key, default={}) for key in _WHOLE}
    for section, keys in _WHOLE.items():
        for key, (attribute, low, high, off, unit) in keys.items():
            wholes[attribute] = tables[section].number(key, low, high, unit, default=off)
    for table in (root, *own, *tables.values()):
        table.done()
    return Reality(name=title, **values, **wholes, seed=seed)
