"""The head: neck (a fork), shade, and the stem that holds the bulb."""

from __future__ import annotations

import math

from build123d import Cylinder, Part, Plane, Polyline, Pos, Sphere, make_face, revolve

import measures
from description import Shape
from joint import FORK_OUT, WIDTH, block, fork_walls

TOP = 3.6  # thickness of the neck's cross-piece
_FLANGE = 2.0
SCREWS = ((6.0, 11.0), (-6.0, 11.0), (6.0, -11.0), (-6.0, -11.0))


def start(shape: Shape) -> float:
    """Return where the shade begins, from the neck's axis."""
    return shape.fork_reach("neck") + TOP


def neck(shape: Shape) -> Part:
    """Return the fork that holds horn and idler of the neck's servo, and the shade."""
    reach = shape.fork_reach("neck")
    part = fork_walls(reach + 1.0, WIDTH, -shape.neutral["neck"])
    part += block((-WIDTH, WIDTH), (-FORK_OUT, FORK_OUT), (reach, reach + TOP))
    part -= Pos(0, 0, reach + TOP / 2) * Cylinder(6.0, TOP)
    for x, y in SCREWS:
        part -= Pos(x, y, reach + TOP / 2) * Cylinder(measures.SCREW_PILOT, TOP)
    return part


def _cone(low: tuple[float, float], high: tuple[float, float]) -> Part:
    outline = [(0.0, low[1]), low, high, (0.0, high[1])]
    return revolve(make_face(Plane.XZ * Polyline(*outline, close=True)))


def shade(shape: Shape) -> Part:
    """Return the shade; printed standing on its closed end."""
    keys, begin = shape.shade, start(shape)
    small, large, end, wall = keys["neck_radius"], keys["mouth_radius"], keys["end"], keys["wall"]
    slope = (large - small) / (end - begin)
    across = wall * math.hypot(1.0, slope)  # the wall, measured along a radius
    part = _cone((small, begin), (large, end)) - _cone(
        (small + slope * wall - across, begin + wall), (large - across, end)
    )
    part -= Pos(0, 0, begin + wall / 2) * Cylinder(5.0, wall)
    for x, y in SCREWS:
        part -= Pos(x, y, begin + wall / 2) * Cylinder(measures.SCREW_HOLE, wall)
    return part


def stem(shape: Shape) -> Part:
    """Return what carries the bulb: a tube on a flange that shares the shade's screws; printed as it stands."""
    begin = start(shape) + shape.shade["wall"]
    middle, radius = shape.shade["bulb_middle"], shape.shade["bulb_radius"]
    outer = min(7.0, 0.6 * radius)
    top = middle - math.sqrt(radius**2 - outer**2) + 2.0
    wide = shape.shade["neck_radius"] - 4.0
    part = Pos(0, 0, begin + _FLANGE / 2) * Cylinder(wide, _FLANGE)
    part += Pos(0, 0, (begin + top) / 2) * Cylinder(outer, top - begin)
    part -= Pos(0, 0, (begin + top) / 2) * Cylinder(outer - 1.6, top - begin)
    part -= Pos(0, 0, middle) * Sphere(radius + 0.1)
    for x, y in SCREWS:
        part -= Pos(x, y, begin + _FLANGE / 2) * Cylinder(measures.SCREW_HOLE, _FLANGE)
    return part


def shade_screws(shape: Shape) -> list[tuple[float, float, float]]:
    """Return where the undersides of the heads of the shade's screws are (M2 x 8, from inside the shade)."""
    top = start(shape) + shape.shade["wall"] + _FLANGE
    return [(x, y, top) for x, y in SCREWS]
