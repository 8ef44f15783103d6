"""How stiff a joint is about its axis: shaft, screws, fork, case, cradle and tubes in series, from the parts' measures.

README.md of this folder has the formulas and where the numbers come from. Newton metres a radian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import base
import joint
import measures
from description import Shape

PLA = 2.3e9  # Pa, printed, along the layers
ALUMINIUM = 69e9
_SPREAD = {"material": 1.25, "shaft": 2.0, "screw": 2.0, "case": 2.0, "frame": 1.7}  # factors, of the 5 to 95 % range


@dataclass(frozen=True)
class Spring:
    """One of the springs of a joint.

    Attributes:
        name: What gives way.
        stiffness: [Nm/rad].
        factor: The true one lies, nine times in ten, between `stiffness` divided and multiplied by this.
    """

    name: str
    stiffness: float
    factor: float


def springs(shape: Shape, name: str) -> list[Spring]:
    """Return what gives way between the encoder of a joint's servo and the link beyond it.

    Args:
        shape: The lamp's measures.
        name: The joint.
    """
    found = [
        Spring("output shaft", _shaft(), _SPREAD["shaft"]),
        Spring("horn screws", 4 * 1.5e6 * (measures.HORN_CIRCLE / 1e3) ** 2, _SPREAD["screw"]),
        Spring("case", 400.0, _SPREAD["case"]),
        Spring("frame screws", _frame_screws(), _SPREAD["screw"]),
        Spring("cradle", _cradle(), _SPREAD["frame"]),
    ]
    if name == "ankle":
        length = shape.foot["axis"] - base.levels(shape)["disc"] - base.DISC
        found += [
            Spring("fork", _wall(2 * 11.2, length), _SPREAD["material"]),
            Spring("disc and ribs", _disc(shape), _SPREAD["frame"]),
            Spring("tubes", 2 * _tubes(shape, "lower", 2), _SPREAD["material"]),
        ]
    if name == "knee":
        found += [
            Spring("fork", _wall(2 * joint.WIDTH, shape.fork_reach("knee")), _SPREAD["material"]),
            Spring(
                "tubes", 1 / (0.5 / _tubes(shape, "lower", 2) + 0.5 / _tubes(shape, "upper", 1)), _SPREAD["material"]
            ),
        ]
    if name == "neck":
        found += [
            Spring("fork", _wall(2 * joint.WIDTH, shape.fork_reach("neck")), _SPREAD["material"]),
            Spring("shade screws", 4 * 2e6 * 6e-3**2, _SPREAD["screw"]),
            Spring("tubes", 2 * _tubes(shape, "upper", 1), _SPREAD["material"]),
        ]
    return found


def gears() -> Spring:
    """Return the gear teeth between motor and encoder, seen from the horn: the last mesh, an eighth for the others."""
    tooth = 14e9 * 2.7 / 206 * 3.5e-3  # N/m: 14 N/(mm um) of a steel pair, by moduli; 3.5 mm of face
    return Spring("gear teeth", 1.5 * tooth * (6.5e-3) ** 2 * 8 / 9, 1.8)


def total(of: list[Spring]) -> tuple[float, float, float]:
    """Return the stiffness of springs in series, and what it lies between nine times in ten.

    Args:
        of: The springs.
    """
    nominal = 1 / sum(1 / spring.stiffness for spring in of)
    draws = np.random.default_rng(0).standard_normal((4000, len(of)))
    factors = np.array([spring.factor for spring in of]) ** (draws / 1.645)
    drawn = 1 / (1 / (np.array([spring.stiffness for spring in of]) * factors)).sum(1)
    low, high = np.quantile(drawn, [0.05, 0.95])
    return nominal, float(low), float(high)


def _shaft() -> float:
    """A solid shaft of 7 mm and 6 mm free length, of a plastic of 0.9 GPa in shear."""
    return 0.9e9 * np.pi * 7e-3**4 / 32 / 6e-3


def _frame_screws() -> float:
    """About the middle of all of them; 1 N/um each, across a 2 mm screw in plastic."""
    places = np.array([place for side in (-1.0, 1.0) for place in joint.frame_holes(side)]) / 1e3
    return float(1e6 * ((places - places.mean(0)) ** 2).sum())


def _cradle() -> float:
    """Both plates in their plane, beside the window, over the 10 mm from far screws to sockets."""
    thickness = (joint.PLATE_OUT - joint.PLATE_IN) / 1e3
    second = 2 * thickness * ((2 * joint.WIDTH / 1e3) ** 3 - 12e-3**3) / 12
    return PLA * second / 10e-3


def _wall(width: float, length: float) -> float:
    """The fork's wall on the horn's side, bent in its plane; the idler turns freely and carries no torque."""
    thickness = (joint.FORK_OUT - joint.FORK_IN) / 1e3
    return PLA * thickness * (width / 1e3) ** 3 / 12 / (length / 1e3)


def _tubes(shape: Shape, arm: str, sides: int) -> float:
    """Tubes as push and pull: two on each side that carries."""
    arms = shape.arms
    area = np.pi * (arms["tube"] ** 2 - arms["bore"] ** 2) / 4e6
    held = measures.CASE_FAR + measures.CRADLE_GAP
    begin = held if arm == "lower" else shape.fork_reach("knee")
    length = (arms[arm] - held - begin) / 1e3
    return float(sides * 2 * ALUMINIUM * area / length * (arms["spacing"] / 2e3) ** 2)


def _disc(shape: Shape) -> float:
    """Hub on three cantilevers, ribs with 15 mm of disc each, held by the sensors' pads."""
    rib, height, disc, wide = 2.4e-3, base.RIB / 1e3, base.DISC / 1e3, 15e-3
    areas = np.array([wide * disc, rib * height])
    heights = np.array([disc / 2, disc + height / 2])
    neutral = areas @ heights / areas.sum()
    own = np.array([wide * disc**3, rib * height**3]) / 12
    second = float((own + areas * (heights - neutral) ** 2).sum())
    reach = shape.foot["sensor_radius"] / 1e3
    front = 3 * PLA * second / (reach - 13e-3) ** 3 * reach**2
    back = 2 * 3 * PLA * second / (reach - 20e-3) ** 3 * (reach / 2) ** 2
    return front + back
