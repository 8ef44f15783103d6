"""The whole lamp: every part where it sits in its link, with its mass; links' masses, centres and inertias."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from build123d import Box, CenterOf, Location, Part, Pos, Rot
from numpy.typing import NDArray

import base
import bought
import gauges
import head
import joint
import measures
from description import Shape


@dataclass(frozen=True)
class Printed:
    """A part to print.

    Attributes:
        name: Its name, and its files'.
        count: How many a lamp needs.
        solid: It, as it is printed: on the bed at z = 0.
        material: "PLA" or "rubber".
        use: What it is, in a few words.
    """

    name: str
    count: int
    solid: Part
    material: str
    use: str


@dataclass(frozen=True)
class Placed:
    """A part in its link.

    Attributes:
        name: What it is; unlike every other's.
        part: The printed part it is, or the name of the bought one.
        body: Its link.
        solid: It, in the link's frame.
        mass: Its mass [g].
        color: Its material in pictures: enamel, steel, servo, rubber, board or bulb.
        step: The step of assembly that it comes in.
        explode: Where it goes in exploded views, times the view's factor [mm].
        ghost: Has a mass but no shape worth checking (cables).
    """

    name: str
    part: str
    body: str
    solid: Part
    mass: float
    color: str
    step: int
    explode: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ghost: bool = False


@dataclass(frozen=True)
class Screw:
    """A screw, and what is there when it is driven.

    Attributes:
        body: The link whose frame it is given in.
        at: Where the underside of its head is.
        outwards: From the thread to the head.
        length: Of its thread [mm].
        step: The step of assembly that drives it.
        name: What it holds.
    """

    body: str
    at: tuple[float, float, float]
    outwards: tuple[float, float, float]
    length: float
    step: int
    name: str


# Assembly steps, in the order of the build guide. A screw is driven with everything of its own and earlier steps there.
STEPS = ("sensors and plate", "dome", "lower arm", "upper arm", "head", "ankle", "knee", "neck", "bulb")


def _servo_places(shape: Shape) -> dict[str, tuple[str, Location]]:
    """Return link and place of each servo's frame."""
    return {
        "ankle": ("lower_arm", Location((0, 0, 0), (0, 0, 180))),
        "knee": ("lower_arm", Location((0, 0, shape.arms["lower"]), (180, 0, 0))),
        "neck": ("upper_arm", Location((0, 0, shape.arms["upper"]), (0, 180, 0))),
    }


def printed(shape: Shape) -> list[Printed]:
    """Return every part to print.

    Args:
        shape: The lamp's measures.
    """
    side = Rot(0, -90, 0)  # lies on the side that faces -x

    def on_bed(solid: Part, turn: Location | None = None) -> Part:
        turned = (turn or Location()) * solid
        return Pos(0, 0, -turned.bounding_box().min.Z) * turned

    arms = shape.arms
    cradle = joint.cradle(arms["tube"], arms["spacing"])
    elbow = joint.elbow(shape.fork_reach("knee"), arms["tube"], arms["spacing"], -shape.neutral["knee"])
    upside_down = Rot(180, 0, 0)
    parts = [
        Printed(
            "sole", 1, on_bed(base.sole(shape)), "rubber", "rubber ring under the plate; print it in TPU, or cut it"
        ),
        Printed("plate", 1, on_bed(base.plate(shape)), "PLA", "lower disc, with the wells of the force sensors"),
        Printed("pad", 3, on_bed(base.pad()), "PLA", "presses on a force sensor; glued under the frame"),
        Printed("frame", 1, on_bed(base.frame(shape)), "PLA", "disc, ribs and ankle fork"),
        Printed("dome", 1, on_bed(base.dome(shape), upside_down), "PLA", "cover of the base"),
        Printed("cradle", 3, on_bed(cradle, side), "PLA", "holds a servo at the end of an arm"),
        Printed("elbow", 1, on_bed(elbow, side), "PLA", "fork at the lower end of the upper arm"),
        Printed("neck", 1, on_bed(head.neck(shape), side), "PLA", "fork that carries the shade"),
        Printed("shade", 1, on_bed(head.shade(shape)), "PLA", "shade"),
        Printed("stem", 1, on_bed(head.stem(shape)), "PLA", "carries the bulb"),
    ]
    for name, gauge in gauges.gauges(shape).items():
        parts.append(
            Printed(name, 1, on_bed(gauge, Rot(90, 0, 0)), "PLA", "sets the neutral pose; not part of the lamp")
        )
    return parts


def placed(shape: Shape) -> list[Placed]:
    """Return every part in its link, screws included.

    Args:
        shape: The lamp's measures.
    """
    density = {"PLA": shape.printing["density"], "rubber": shape.printing["sole_density"]}
    arms = shape.arms
    found: list[Placed] = []

    def add_printed(
        name: str,
        part: str,
        body: str,
        solid: Part,
        step: int,
        explode: tuple[float, float, float],
        material: str = "PLA",
    ) -> None:
        mass = solid.volume * density[material] / 1000.0
        found.append(
            Placed(name, part, body, solid, mass, "rubber" if material == "rubber" else "enamel", step, explode)
        )

    def add_bought(
        name: str, part: str, body: str, solid: Part, mass: float, color: str, step: int,
        explode: tuple[float, float, float] = (0.0, 0.0, 0.0), ghost: bool = False,
    ) -> None:  # fmt: skip
        found.append(Placed(name, part, body, solid, mass, color, step, explode, ghost))

    add_printed("sole", "sole", "base", base.sole(shape), 0, (0, 0, -50), "rubber")
    add_printed("plate", "plate", "base", base.plate(shape), 0, (0, 0, -32))
    for number, place in enumerate(base.sensor_places(shape)):
        sensor = Pos(*place) * bought.force_sensor()
        add_bought(f"sensor_{number}", "FSR 402", "base", sensor, measures.FSR_MASS, "board", 0, (0, 0, -18))
    for number, (x, y, z) in enumerate(base.sensor_places(shape)):
        add_printed(f"pad_{number}", "pad", "base", Pos(x, y, z + measures.FSR_HEIGHT) * base.pad(), 0, (0, 0, -8))
    add_printed("frame", "frame", "base", base.frame(shape), 0, (0, 0, 0))
    add_bought(
        "pico", "Pico", "base", Pos(*base.pico_place(shape)) * bought.pico(), measures.PICO_MASS, "board", 0, (0, 0, 22)
    )
    add_printed("dome", "dome", "base", base.dome(shape), 1, (0, 0, 62))

    cradle = joint.cradle(arms["tube"], arms["spacing"])
    reach = shape.fork_reach("knee")
    held = measures.CASE_FAR + measures.CRADLE_GAP
    spans = {
        "lower_arm": (joint.socket_floor(held), arms["lower"] - joint.socket_floor(held)),
        "upper_arm": (joint.socket_floor(reach), arms["upper"] - joint.socket_floor(held)),
    }
    for name, (body, place) in _servo_places(shape).items():
        step = 2 if body == "lower_arm" else 3
        away = 1.0 if name != "ankle" else -1.0
        add_printed(f"{name}_cradle", "cradle", body, place * cradle, step, (0, 0, 12 * away))
        add_bought(
            f"{name}_servo", "XL330-M288-T", body, place * bought.servo(), measures.SERVO_MASS - measures.HORN_MASS,
            "servo", step, (0, 0, 62 * away),
        )  # fmt: skip
    area = math.pi * (arms["tube"] ** 2 - arms["bore"] ** 2) / 4
    for body, (low, high) in spans.items():
        step = 2 if body == "lower_arm" else 3
        for number, (x, y) in enumerate(joint.tube_places(arms["spacing"])):
            tube = Pos(0, y, 0) * bought.tube(arms["tube"], arms["bore"], low, high, x)
            mass = area * (high - low) * measures.ALUMINIUM / 1000.0
            add_bought(f"{body}_tube_{number}", "tube", body, tube, mass, "steel", step)
        cable = Pos(0, 0, arms[body.removesuffix("_arm")] / 2) * Box(2.0, 9.0, (high - low) / 2)
        add_bought(f"{body}_cable", "X3P cable", body, cable, measures.CABLE_MASS, "servo", step, ghost=True)
    elbow = joint.elbow(reach, arms["tube"], arms["spacing"], -shape.neutral["knee"])
    add_printed("elbow", "elbow", "upper_arm", elbow, 3, (0, 0, -12))

    add_printed("neck", "neck", "head", head.neck(shape), 4, (0, 0, 0))
    add_printed("shade", "shade", "head", head.shade(shape), 4, (0, 0, 25))
    add_printed("stem", "stem", "head", head.stem(shape), 4, (0, 0, 75))
    keys = shape.shade
    bulb = bought.ball(keys["bulb_radius"], keys["bulb_middle"])
    add_bought("bulb", "LED ball", "head", bulb, keys["bulb_mass"], "bulb", 8, (0, 0, 110))

    for number, (body, z, side) in enumerate(_horn_places(shape)):
        name, step = ("ankle", "knee", "neck")[number], 5 + number
        for sign, what, mass in ((side, "horn", measures.HORN_MASS), (-side, "idler", measures.IDLER_MASS)):
            solid = Pos(0, 0, z) * bought.horn(sign)
            add_bought(f"{name}_{what}", what, body, solid, mass, "servo" if what == "horn" else "board", step)
    for number, each in enumerate(screws(shape)):
        solid = bought.screw(each.at, each.outwards, each.length)
        out = tuple(14.0 * value for value in each.outwards)
        add_bought(
            f"screw_{number}", f"screw M2 x {each.length:g}", each.body, solid, solid.volume * measures.STEEL / 1000.0,
            "steel", each.step, (out[0], out[1], out[2]),
        )  # fmt: skip
    return found


def _horn_places(shape: Shape) -> list[tuple[str, float, float]]:
    """Return link, height of the axis and the horn's side of each joint, from the foot up."""
    return [("base", shape.foot["axis"], -1.0), ("upper_arm", 0.0, -1.0), ("head", 0.0, 1.0)]


def screws(shape: Shape) -> list[Screw]:
    """Return every screw of the lamp.

    Args:
        shape: The lamp's measures.
    """
    found = [Screw("base", at, (0, 0, -1), measures.HORN_SCREW, 0, "plate") for at in base.keepers(shape)]
    found += [Screw("base", at, (0, 0, 1), measures.HORN_SCREW, 1, "dome") for at in base.dome_screws(shape)]
    under = joint.PLATE_IN + joint.LAND
    for name, (body, place) in _servo_places(shape).items():
        for side in (-1.0, 1.0):
            for x, z in joint.frame_holes(side):
                at = place * Pos(x, side * under, z)
                way = place * Pos(x, side * (under + 1.0), z)
                outwards = tuple(round(b - a, 9) for a, b in zip(at.position, way.position, strict=True))
                step = 2 if body == "lower_arm" else 3
                found.append(Screw(body, tuple(at.position), outwards, measures.FRAME_SCREW, step, f"{name} servo"))
    turns = (shape.neutral["ankle"], -shape.neutral["knee"], -shape.neutral["neck"])
    for number, ((body, axis, horn_side), turn) in enumerate(zip(_horn_places(shape), turns, strict=True)):
        name = ("ankle", "knee", "neck")[number]
        for side in (-1.0, 1.0):
            places = joint.hole_places(turn)
            for x, z in places if side == horn_side else places[::2]:  # the idler turns freely: two will do
                at = (x, side * joint.FORK_OUT, axis + z)
                found.append(Screw(body, at, (0, side, 0), measures.HORN_SCREW, 5 + number, f"{name} horn"))
    found += [Screw("head", at, (0, 0, 1), measures.FRAME_SCREW, 4, "shade") for at in head.shade_screws(shape)]
    return found


@dataclass(frozen=True)
class Inertia:
    """Mass properties of a link, in its frame.

    Attributes:
        mass: [kg].
        centre: Centre of mass, shape (3,) [m].
        tensor: Inertia about the centre of mass, shape (3, 3) [kg m2].
    """

    mass: float
    centre: NDArray[np.float64]
    tensor: NDArray[np.float64]


def inertia(parts: Iterable[Placed], body: str) -> Inertia:
    """Return the mass properties of a link.

    Args:
        parts: The lamp's parts.
        body: The link.
    """
    mass, moment, tensor = 0.0, np.zeros(3), np.zeros((3, 3))
    for part in parts:
        if part.body != body:
            continue
        own = part.mass / 1000.0
        centre = np.array(tuple(part.solid.center(CenterOf.MASS))) / 1000.0
        spread = np.array(part.solid.matrix_of_inertia) / part.solid.volume * own * 1e-6
        mass += own
        moment += own * centre
        tensor += spread + own * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    middle = moment / mass
    tensor -= mass * (middle @ middle * np.eye(3) - np.outer(middle, middle))
    return Inertia(mass, middle, tensor)
