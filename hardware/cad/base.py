"""The base, from the floor up: rubber sole, plate, force sensors, pads, frame (disc and ankle fork in one), Pico, dome.

The plate is held up against the sensors by elastic cord (the preload) and kept from tilting by three screws.
"""

from __future__ import annotations

import math

from build123d import Box, Cylinder, Part, Plane, Polyline, Pos, Rot, make_face, revolve

import bought
import measures
from description import JOINTS, Shape
from joint import block, fork_walls, prism_y
from links import link_places

PLATE = 1.6
_WELL = 0.4  # depth, for a sensor
_PAD = 1.2  # between a sensor and the disc
_PAD_RADIUS = 7.0
DISC = 1.8
RIB = 6.5  # height, above the disc
_POST_RADIUS = 2.8
DOME = 1.2
SENSOR_ANGLES = (0.0, 120.0, 240.0)
POST_ANGLES = (60.0, 180.0, 300.0)
CORD_ANGLES = (30.0, 150.0, 270.0)
_CORD_HOLE = 1.0


def levels(shape: Shape) -> dict[str, float]:
    """Return heights above the floor: plate, sensor, disc, posts' top, roof.

    Args:
        shape: The lamp's measures.
    """
    plate = shape.foot["sole_height"]
    sensor = plate + PLATE - _WELL
    disc = sensor + measures.FSR_HEIGHT + _PAD
    roof = shape.foot["axis"] - measures.SWEEP - shape.printing["clearance"] - 0.3
    return {"plate": plate, "sensor": sensor, "disc": disc, "post": roof - DOME, "roof": roof}


def _radii(shape: Shape) -> dict[str, float]:
    radius, width = shape.foot["radius"], shape.foot["sole_width"]
    inner = radius - width  # of the sole
    return {"inner": inner, "plate": radius - 0.5, "disc": radius - 2.0, "post": inner - 7.5, "cord": inner - 9.0}


def _at(radius: float, degrees: float) -> tuple[float, float]:
    return radius * math.cos(math.radians(degrees)), radius * math.sin(math.radians(degrees))


def sole(shape: Shape) -> Part:
    """Return the rubber ring."""
    height = shape.foot["sole_height"]
    ring = Cylinder(shape.foot["radius"], height) - Cylinder(_radii(shape)["inner"], height)
    return Pos(0, 0, height / 2) * ring


def plate(shape: Shape) -> Part:
    """Return the lower disc, a wide ring: the sole is glued under it, the sensors lie in its wells."""
    z, radii = levels(shape)["plate"], _radii(shape)
    sensor = shape.foot["sensor_radius"]
    part = Pos(0, 0, z + PLATE / 2) * (Cylinder(radii["plate"], PLATE) - Cylinder(sensor - 11.0, PLATE))
    for angle in SENSOR_ANGLES:
        x, y = _at(sensor, angle)
        well = z + PLATE - _WELL / 2
        part -= Pos(x, y, well) * Cylinder(measures.FSR_RADIUS + 0.15, _WELL)
        tail = Pos(sensor - 9.0, 0, well) * Box(10.0, 7.6, _WELL)  # the sensor's tail runs inwards
        part -= Rot(0, 0, angle) * tail
    for angle in POST_ANGLES:
        x, y = _at(radii["post"], angle)
        part -= Pos(x, y, z + PLATE / 2) * Cylinder(1.3, PLATE)
    for x, y in _cord_holes(shape):
        part -= Pos(x, y, z + PLATE / 2) * Cylinder(_CORD_HOLE, PLATE)
    return part


def _cord_holes(shape: Shape) -> list[tuple[float, float]]:
    places = []
    for angle in CORD_ANGLES:
        x, y = _at(_radii(shape)["cord"], angle)
        for along in (-4.0, 4.0):
            dx, dy = _at(along, angle + 90.0)
            places.append((x + dx, y + dy))
    return places


def frame(shape: Shape) -> Part:
    """Return disc, ribs, posts and ankle fork in one; printed as it stands."""
    level, radii = levels(shape), _radii(shape)
    low, sensor, axis = level["disc"], shape.foot["sensor_radius"], shape.foot["axis"]
    top = low + DISC
    part = Pos(0, 0, low + DISC / 2) * Cylinder(radii["disc"], DISC)
    for angle in (30.0, 90.0, 270.0, 330.0):  # lighter where neither rib nor Pico is
        x, y = _at(radii["cord"] - 10.0, angle)
        part -= Pos(x, y, low + DISC / 2) * Cylinder(7.5, DISC)
    for angle in SENSOR_ANGLES:
        begin = 12.0 if angle == 0.0 else 20.0
        end, foot, ridge = sensor + 3.0, top - 0.1, top + RIB  # lower towards the rim, where the bulb comes down
        rib = prism_y([(begin, foot), (end, foot), (end, top + 1.0), (end - 11.0, ridge), (begin, ridge)], -1.2, 1.2)
        part += Rot(0, 0, angle) * rib
    for angle in POST_ANGLES:
        x, y = _at(radii["post"], angle)
        middle, height = (low + level["post"]) / 2, level["post"] - low
        part += Pos(x, y, middle) * Cylinder(_POST_RADIUS, height)
        part -= Pos(x, y, middle) * Cylinder(measures.SCREW_PILOT, height)
    for x, y in _cord_holes(shape):
        part -= Pos(x, y, low + DISC / 2) * Cylinder(_CORD_HOLE, DISC)
    part -= Pos(-14.6, 0, low + DISC / 2) * Box(4.0, 16.0, DISC)  # for the sensors' wires
    walls = fork_walls(axis - top + 0.1, 13.0, shape.neutral["ankle"] + math.pi, 9.5)
    part += Pos(0, 0, axis) * Rot(180, 0, 0) * walls
    return part


def pad() -> Part:
    """Return what presses on a sensor's middle, its underside at z = 0; glued under the disc."""
    return Pos(0, 0, _PAD / 2) * Cylinder(_PAD_RADIUS, _PAD)


def dome(shape: Shape) -> Part:
    """Return the cover; printed upside down."""
    level, radii = levels(shape), _radii(shape)
    low, roof = level["disc"] + DISC, level["roof"]
    rim = radii["disc"] - 1.0
    middle = low + 0.45 * (roof - low)
    top = rim - 1.5 - (roof - middle)
    shoulder = rim - 1.5
    part = _bell([(rim, low), (shoulder, middle), (top, roof)]) - _bell(
        [(rim - 1.5, low), (shoulder - 1.15, middle - 0.95), (top - 0.85, roof - DOME)]
    )
    notch = _notch(shape, roof)
    if notch is not None:
        x, y = notch
        part -= block((x, radii["plate"]), (-y, y), (low, roof))
    room = 0.5
    part -= block((-13.0 - room, 13.0 + room), (-18.1 - room, 18.1 + room), (low, roof))
    for angle in POST_ANGLES:
        x, y = _at(radii["post"], angle)
        part -= Pos(x, y, roof - DOME / 2) * Cylinder(measures.SCREW_HOLE, DOME)
    part -= block(_exit(shape), (30.0, radii["plate"]), (low, low + 5.6))
    return part


def _lowest_bulb(shape: Shape, wider: float) -> Part:
    """Return the bulb where it is with every joint at its upper stop, in the base's frame.

    Args:
        shape: The lamp's measures.
        wider: Added to its radius.
    """
    place = link_places(shape, [shape.stops[joint][1] for joint in JOINTS])["head"]
    return place * bought.ball(shape.shade["bulb_radius"] + wider, shape.shade["bulb_middle"])


def _notch(shape: Shape, roof: float) -> tuple[float, float] | None:
    """Return where the dome's notch for the lowest bulb begins, along x, and half its width; None: it needs none."""
    bulb = _lowest_bulb(shape, 1.5)
    centre, radius = bulb.center(), shape.shade["bulb_radius"] + 1.5
    if centre.Z - radius >= roof:
        return None
    across = math.sqrt(max(radius**2 - max(centre.Z - roof, 0.0) ** 2, 0.0))
    begin = centre.X - across
    if begin >= _radii(shape)["disc"]:
        return None
    return begin, across


def _bell(points: list[tuple[float, float]]) -> Part:
    outline = [(0.0, points[0][1]), *points, (0.0, points[-1][1])]
    face = make_face(Plane.XZ * Polyline(*outline, close=True))
    return revolve(face)


def _exit(shape: Shape) -> tuple[float, float]:
    middle = pico_place(shape)[0]
    return middle - 6.5, middle + 6.5


def pico_place(shape: Shape) -> tuple[float, float, float]:
    """Return where the middle of the Pico's underside is: behind the fork, its USB socket to the left.

    Args:
        shape: The lamp's measures.
    """
    return -27.0, 0.0, levels(shape)["disc"] + DISC + 1.0


def dome_screws(shape: Shape) -> list[tuple[float, float, float]]:
    """Return where the undersides of the heads of the dome's screws are (M2 x 6, from above)."""
    return [(*_at(_radii(shape)["post"], angle), levels(shape)["roof"]) for angle in POST_ANGLES]


def keepers(shape: Shape) -> list[tuple[float, float, float]]:
    """Return where the undersides of the heads of the plate's screws are (M2 x 6, from below)."""
    return [(*_at(_radii(shape)["post"], angle), levels(shape)["plate"] - 0.05) for angle in POST_ANGLES]


def sensor_places(shape: Shape) -> list[tuple[float, float, float]]:
    """Return where the middles of the undersides of the sensors are."""
    return [(*_at(shape.foot["sensor_radius"], angle), levels(shape)["sensor"]) for angle in SENSOR_ANGLES]
