"""One servo on a pendulum bench, recorded as a lamp of one joint: its description, and the procedure for it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit

from robolamp.assets import Assets
from robolamp.calibrate.excitations import Excitation, Signal, chirp, ramp, sine_of_square, steps, still
from robolamp.calibrate.procedure import HANDS_OFF, Step
from robolamp.emulator.bare_servos_file import BareServo, PendulumLoad, load_servos
from robolamp.errors import FileError
from robolamp.lamp import Joint, Lamp

JOINT = "bench"
"""Name of the one joint; at 0 the arm hangs straight down."""

_MARGIN = 0.05  # joint limits beyond the swing: the arm overshoots [rad]
_SLEW = 14.0  # of goals [rad/s]: the lamp's
_GAIN = 800  # Position P Gain (84), unless a step has its own
_ASIDE = 0.17  # how far from its limits the arm may hang at the start: see `safety.preflight_angle` [rad]
_FASTEST = 4.0  # speed of a chirp: half a servo's at no load [rad/s]
_LIMP = 2.5  # how long a drop is watched [s]

HANG = (
    "Clamp the bracket to the table's edge, let the arm hang straight down and be still, and clear the whole circle "
    "that its weight can reach. The servo alone is on the bus."
)
LET_SWING = "Keep your hands away: the arm is raised, let go, and swings until it rests."


@dataclass(frozen=True)
class ServoBench:
    """A servo with a pendulum.

    Attributes:
        lamp: What the loop takes it for.
        servo: The servo, as an emulated one is described.
        load: Its pendulum.
    """

    lamp: Lamp
    servo: BareServo
    load: PendulumLoad


def load_bench(path: Path, assets: Assets, port: str = "") -> ServoBench:
    """Read a bench: a servos file (see `robolamp.emulator.bare_servos_file`) of one servo with a pendulum.

    Args:
        path: The file.
        assets: Where calibrations are.
        port: Serial port of the servo.

    Raises:
        FileError: It is malformed, or lists several servos or none with a pendulum.
    """
    listed = load_servos(path, assets)
    if len(listed.servos) != 1:
        raise FileError(f"lists {len(listed.servos)} servos; expected one, alone on the bus", str(path))
    return bench_lamp(listed.name, listed.servos[0], path, port)


def bench_lamp(name: str, servo: BareServo, path: Path, port: str = "") -> ServoBench:
    """Return a bench.

    Args:
        name: Its name.
        servo: The servo, with a pendulum.
        path: The file that describes it.
        port: Serial port of the servo.

    Raises:
        FileError: It has no pendulum.
    """
    if servo.pendulum is None:
        raise FileError("its servo has no pendulum; expected a table [servo.pendulum] with mass and length", str(path))
    return ServoBench(_lamp(name, servo, servo.pendulum, path, port), servo, servo.pendulum)


def _lamp(name: str, servo: BareServo, load: PendulumLoad, path: Path, port: str) -> Lamp:
    reach = load.swing + _MARGIN
    joint = Joint(JOINT, servo.model, servo.id, 1, servo.position, -reach, reach, 0.0, _SLEW, _GAIN)
    described = {
        "name": name,
        "bus": {"baud": servo.baud},
        "pendulum": {
            "mass": load.mass, "length": load.length, **({"arm_mass": load.arm_mass} if load.arm_mass else {}),
        },
        "joint": [
            {
                "name": JOINT, "servo": servo.model, "id": servo.id, "sign": 1, "zero": servo.position,
                "lower": -reach, "upper": reach, "position_p_gain": _GAIN,
            }
        ],
    }  # fmt: skip
    return Lamp(
        name=name,
        model="",
        joints=(joint,),
        bus_port=port,
        bus_baud=servo.baud,
        foot_port="",
        foot_baud=0,
        contact_on=math.inf,  # nothing stands on the floor
        contact_off=math.inf,
        preflight_angle=_ASIDE,
        source=tomlkit.dumps(described),
        path=path,
    )


def bench_procedure(bench: ServoBench) -> tuple[Step, ...]:
    """Return the steps of recording a single servo, in the order in which they are recorded.

    Args:
        bench: The servo.
    """
    swing = bench.load.swing
    made: list[Step] = []

    def play(signal: Signal, duration: float, share: float = 1.0) -> Excitation:
        return Excitation((signal,), np.zeros(1), np.array([share * swing]), duration)

    def add(name: str, shows: str, gain: int, excitation: Excitation) -> None:
        made.append(Step(name, HANDS_OFF if made else HANG, shows, True, gain, excitation))

    add("ramps", "friction at low speed and under load, and where the encoder's zero is", 400, play(ramp(5.0), 10.6))
    add("chirp", "speed constant and inertia", 800, play(chirp(0.3, 3.5, 7.0, _FASTEST / swing), 7.6))
    add("squares", "friction and inertia at speeds that grow", 400, play(sine_of_square(0.8), 6.6, 0.8))
    add("steps-soft", "delay, and how the gain turns an error into voltage", 200, play(steps(0.7), 6.6, 0.9))
    add("steps-firm", "the same at a high gain: saturated voltage", 1200, play(steps(0.6, 5), 6.6, 0.9))
    for number, (share, gain) in enumerate(((1.0, 800), (-1.0, 400), (0.6, 1200)), 1):
        made.append(
            Step(
                f"drop-{number}", LET_SWING, "torque constant apart from resistance: only here is the winding open",
                True, gain, play(still(), 1.2), (share * swing,), _LIMP,
            )
        )  # fmt: skip
    return tuple(made)
