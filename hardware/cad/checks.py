"""What a lamp's parts must be: printable, apart from one another in every pose, held by screws that one can reach."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from build123d import Location, Part, Pos
from numpy.typing import NDArray

import bought
from assembly import Placed, placed, printed, screws
from description import BODIES, JOINTS, Shape
from gauges import gauges
from links import link_places

NEAR = 1.5
"""Gaps larger than this are not measured [mm]."""

_TOUCHING = 1.0  # mm3 of two parts of one link in the same place: surfaces that meet

Box = tuple[NDArray[np.float64], NDArray[np.float64]]


class Unbuildable(Exception):
    """The parts cannot be made or put together; the message is one line."""


class LinksMeet(Unbuildable):
    """Two links meet in a pose.

    Attributes:
        far: They are no neighbours: a smaller bend of the knee may keep them apart.
    """

    def __init__(self, message: str, far: bool) -> None:
        super().__init__(message)
        self.far = far


def mesh(solid: Part, fine: float = 0.05, angle: float = 0.3) -> NDArray[np.float64]:
    """Return a solid's surface as triangles, shape (n, 3, 3) [mm].

    Args:
        solid: The solid.
        fine: Largest distance between surface and triangles [mm].
        angle: Largest angle between neighbours on a curved surface [rad].
    """
    vertices, triangles = solid.tessellate(fine, angle)
    points = np.array([tuple(vertex) for vertex in vertices])
    return points[np.array(triangles)]


def check_prints(shape: Shape) -> dict[str, dict[str, float]]:
    """Check every part to print, and return thinnest wall [mm] and steep overhang [mm2] of each.

    Args:
        shape: The lamp's measures.

    Raises:
        Unbuildable: A part is no single solid, is too large for the bed, or has a wall that is too thin.
    """
    found = {}
    bed, least = shape.printing["bed"], shape.printing["wall"]
    for part in printed(shape):
        if not part.solid.is_valid or len(part.solid.solids()) != 1:
            raise Unbuildable(f"{part.name}: {len(part.solid.solids())} solids; expected a single valid one")
        size = part.solid.bounding_box().size
        longest = max(size.X, size.Y, size.Z)
        if longest > bed:
            raise Unbuildable(
                f"{part.name}: {longest:.1f} mm long; expected {bed:g} mm or less, print.bed of {shape.path}"
            )
        triangles = mesh(part.solid, 0.1, 0.4)
        wall = thinnest_wall(triangles)
        if wall < least - 0.01:
            raise Unbuildable(
                f"{part.name}: a wall of {wall:.2f} mm; expected {least:g} mm or more, print.wall of {shape.path}"
            )
        found[part.name] = {"wall": wall, "overhang": _overhang(triangles)}
    return found


def _normals(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)


def _areas(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2


def _overhang(triangles: NDArray[np.float64]) -> float:
    """Area that faces the bed more than 45 degrees down and does not lie on it [mm2]."""
    down = (_normals(triangles)[:, 2] < -0.72) & (triangles[:, :, 2].mean(1) > 0.05)
    return float(_areas(triangles)[down].sum())


def thinnest_wall(triangles: NDArray[np.float64]) -> float:
    """Return the smallest distance through the material between two faces that look away from each other [mm].

    Measured from points on every triangle, straight inwards, where the face met there is within 25 degrees of parallel.

    Args:
        triangles: A closed surface, shape (n, 3, 3) [mm].
    """
    normals = _normals(triangles)
    large = _areas(triangles) > 1e-3
    triangles, normals = triangles[large], normals[large]
    weights = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / np.array([[3], [6], [6], [6]])
    wide = _areas(triangles) > 2.0
    starts = np.concatenate(
        [np.einsum("wk,nkd->nwd", weights, triangles[wide]).reshape(-1, 3), triangles[~wide].mean(1)]
    )
    ways = -np.concatenate([np.repeat(normals[wide], len(weights), 0), normals[~wide]])
    edge1, edge2, corner = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0], triangles[:, 0]
    thinnest = math.inf
    for begin in range(0, len(starts), 400):
        start, way = starts[begin : begin + 400, None], ways[begin : begin + 400, None]
        cross = np.cross(way, edge2)
        determinant = np.einsum("nd,rnd->rn", edge1, cross)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            away = start - corner
            u = np.einsum("rnd,rnd->rn", away, cross) / determinant
            over = np.cross(away, edge1)
            v = np.einsum("rd,rnd->rn", way[:, 0], over) / determinant
            distance = np.einsum("nd,rnd->rn", edge2, over) / determinant
            inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        hit = inside & (distance > 1e-3) & (np.abs(determinant) > 1e-12)
        distance = np.where(hit, distance, np.inf)
        first = distance.argmin(1)
        facing = np.einsum("rd,rd->r", way[:, 0], normals[first])  # 1: the other side of a wall
        wall = distance[np.arange(len(first)), first][facing > 0.9]
        thinnest = min(thinnest, wall.min(initial=math.inf))
    return float(thinnest)


def _box(part: Placed) -> Box:
    bounds = part.solid.bounding_box()
    return np.array(tuple(bounds.min)), np.array(tuple(bounds.max))


def _placed_box(box: Box, place: Location) -> Box:
    """Bounds of a part's bounds, turned and moved with its link."""
    turn = place.wrapped.Transformation()
    matrix = np.array([[turn.Value(row, column) for column in range(1, 5)] for row in range(1, 4)])
    middle, half = (box[0] + box[1]) / 2, (box[1] - box[0]) / 2
    middle = matrix[:, :3] @ middle + matrix[:, 3]
    half = np.abs(matrix[:, :3]) @ half
    return middle - half, middle + half


def _apart(one: Box, other: Box) -> float:
    gap = np.maximum(0.0, np.maximum(one[0] - other[1], other[0] - one[1]))
    return float(np.linalg.norm(gap))


def check_links(shape: Shape) -> None:
    """Check that no two parts of a link are in the same place.

    Args:
        shape: The lamp's measures.

    Raises:
        Unbuildable: Two are.
    """
    parts = [part for part in placed(shape) if not part.ghost and not part.part.startswith("screw")]
    for one, other in itertools.combinations(parts, 2):
        if one.body != other.body or _apart(_box(one), _box(other)) > 0.0:
            continue
        common = one.solid.intersect(other.solid)
        volume = 0.0 if common is None else sum(solid.volume for solid in common.solids())
        if volume > _TOUCHING:
            raise Unbuildable(f"{one.name} and {other.name} share {volume:.1f} mm3; expected none (shape {shape.path})")


def check_poses(shape: Shape, fine: int = 9, coarse: int = 5) -> dict[str, float]:
    """Check that no two links meet in any pose, and return the smallest gap between each two [mm].

    Gaps beyond `NEAR` are given as `NEAR`. Servo and horn of one joint are left out: they are one bought part.

    Args:
        shape: The lamp's measures.
        fine: Angles of a joint for links that it joins.
        coarse: Angles of each joint for links further apart.

    Raises:
        Unbuildable: Two come closer than the description's clearance.
    """
    heads = {f"screw_{number}": bought.screw_head(s.at, s.outwards) for number, s in enumerate(screws(shape))}
    solid = [replace(part, solid=heads.get(part.name, part.solid)) for part in placed(shape) if not part.ghost]
    parts = {body: [part for part in solid if part.body == body] for body in BODIES}  # threads are inside other parts
    boxes = {part.name: _box(part) for each in parts.values() for part in each}
    gaps: dict[str, float] = {}
    for (low, one), (high, other) in itertools.combinations(enumerate(BODIES), 2):
        moving = range(low, high)
        count = fine if len(moving) == 1 else coarse
        grids = [np.linspace(*shape.stops[JOINTS[j]], count) if j in moving else [0.0] for j in range(3)]
        least, worst = NEAR, None
        for angles in itertools.product(*grids):
            places = link_places(shape, angles)
            gap, pair = _gap(parts[one], parts[other], places[one], places[other], boxes)
            if gap < least:
                least, worst = gap, (pair, angles)
        gaps[f"{one} - {other}"] = least
        if least < shape.printing["clearance"] - 1e-3 and worst is not None:
            (first, second), angles = worst
            pose = ", ".join(f"{name} {angle:+.2f}" for name, angle in zip(JOINTS, angles, strict=True))
            raise LinksMeet(
                f"{first} and {second} are {least:.2f} mm apart at {pose} rad; expected "
                f"{shape.printing['clearance']:g} mm or more (stops of {shape.path})",
                len(moving) > 1,
            )
    return gaps


def _gap(
    ones: Iterable[Placed], others: Iterable[Placed], here: Location, there: Location, boxes: dict[str, Box]
) -> tuple[float, tuple[str, str]]:
    ours, theirs = [*ones], [*others]
    low, high = _bounds(ours, here, boxes)
    their_low, their_high = _bounds(theirs, there, boxes)
    apart = np.maximum(low[:, None] - their_high, their_low - high[:, None])
    apart = np.linalg.norm(np.maximum(apart, 0.0), axis=2)
    least, pair = NEAR, ("", "")
    for row, column in np.argwhere(apart < NEAR):
        one, other = ours[row], theirs[column]
        if apart[row, column] >= least or _one_servo(one.name, other.name):
            continue
        gap = (here * one.solid).distance_to(there * other.solid)
        if gap < least:
            least, pair = gap, (one.name, other.name)
    return least, pair


def _bounds(parts: list[Placed], place: Location, boxes: dict[str, Box]) -> Box:
    """Bounds of parts where their link is, each of shape (n, 3)."""
    each = [_placed_box(boxes[part.name], place) for part in parts]
    return np.array([box[0] for box in each]), np.array([box[1] for box in each])


def _one_servo(one: str, other: str) -> bool:
    """Whether two parts are case and horn (or idler) of one servo."""
    joint, _, kind = one.partition("_")
    other_joint, _, other_kind = other.partition("_")
    return joint == other_joint and "servo" in (kind, other_kind) and bool({"horn", "idler"} & {kind, other_kind})


def check_masses(shape: Shape) -> None:
    """Check that every part has a mass.

    Args:
        shape: The lamp's measures.

    Raises:
        Unbuildable: A part has none.
    """
    for part in placed(shape):
        if not part.mass > 0.0 or not part.solid.volume > 0.0:
            raise Unbuildable(f"{part.name}: a mass of {part.mass:g} g; expected more than 0 (shape {shape.path})")


def differences(old: Mapping[str, Any], new: Mapping[str, Any], name: str = "") -> list[str]:
    """Return where two sets of properties differ by more than the kernel's versions do, a line each.

    Args:
        old: The one.
        new: The other.
        name: Of the table they are from.
    """
    found = []
    for key in sorted({*old, *new}):
        path, one, other = f"{name}{key}", old.get(key), new.get(key)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            found += differences(one, other, f"{path}.")
        elif isinstance(one, int | float) and isinstance(other, int | float):
            if abs(one - other) > 1e-3 * max(abs(one), abs(other)) + 1e-9:
                found.append(f"{path} = {one:g}; the solids say {other:g}")
        elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
            pairs = ({str(k): v for k, v in enumerate(each)} for each in (one, other))
            found += differences(*pairs, f"{path}.")
        elif one != other:
            found.append(f"{path} = {one!r}; the solids say {other!r}")
    return found


def check_gauges(shape: Shape) -> None:
    """Check that the gauges touch the lamp without cutting into it, in its neutral pose.

    Args:
        shape: The lamp's measures.

    Raises:
        Unbuildable: One does.
    """
    places = link_places(shape, (0.0, 0.0, 0.0))
    for name, gauge in gauges(shape).items():
        for part in placed(shape):
            if part.ghost or part.part.startswith("screw"):
                continue
            common = gauge.intersect(places[part.body] * part.solid)
            volume = 0.0 if common is None else sum(solid.volume for solid in common.solids())
            if volume > _TOUCHING:
                raise Unbuildable(f"{name} and {part.name} share {volume:.1f} mm3; expected none (shape {shape.path})")


def check_insertion(shape: Shape) -> None:
    """Check that the parts come together: each servo, with its horn, into its cradle, and each fork over its joint.

    Servo and fork are moved out along straight lines, in steps of 2 mm, and must meet nothing.

    Args:
        shape: The lamp's measures.

    Raises:
        Unbuildable: Something is in the way.
    """
    parts = [part for part in placed(shape) if not part.ghost]
    places = link_places(shape, (0.0, 0.0, 0.0))
    by_name = {part.name: part for part in parts}
    steps = [2.0 * number for number in range(1, 20)]
    forks = {
        "ankle": ("frame", "lower_arm", -1.0),
        "knee": ("elbow", "lower_arm", 1.0),
        "neck": ("neck", "upper_arm", 1.0),
    }
    for joint, (fork, body, way) in forks.items():
        servo, cradle, horn = (by_name[f"{joint}_{name}"] for name in ("servo", "cradle", "horn"))
        out = 1.0 if joint != "ankle" else -1.0  # along the servo's link, past the joint
        disc = places[body].inverse() * places[horn.body] * horn.solid
        around = [part for part in parts if part.body == body and part.step <= 3]
        around = [(part.name, places[body] * part.solid) for part in around]
        around += [
            (by_name[f"{joint}_{kind}"].name, places[horn.body] * by_name[f"{joint}_{kind}"].solid)
            for kind in ("horn", "idler")
        ]
        for step in steps:
            for moved in (servo.solid, disc):
                _apart_while_moved("the servo", Pos(0, 0, out * step) * moved, cradle.name, cradle.solid, joint, shape)
            moved = places[by_name[fork].body] * Pos(0, 0, way * step) * by_name[fork].solid
            for name, solid in around:
                _apart_while_moved(fork, moved, name, solid, joint, shape)


def _apart_while_moved(name: str, moved: Part, other: str, solid: Part, joint: str, shape: Shape) -> None:
    bounds, others = moved.bounding_box(), solid.bounding_box()
    boxes = [(np.array(tuple(box.min)), np.array(tuple(box.max))) for box in (bounds, others)]
    if _apart(*boxes) > 0.0:
        return
    common = moved.intersect(solid)
    volume = 0.0 if common is None else sum(each.volume for each in common.solids())
    if volume > 0.1:
        raise Unbuildable(f"{other} is in the way of {name} on its way to the {joint} (shape {shape.path})")


def check_screws(shape: Shape) -> int:
    """Check that a screwdriver reaches every screw at its step of the assembly, and return how many screws there are.

    Args:
        shape: The lamp's measures.

    Raises:
        Unbuildable: Something is in a driver's way.
    """
    parts = [part for part in placed(shape) if not part.ghost]
    places = link_places(shape, (0.0, 0.0, 0.0))
    boxes = {part.name: _placed_box(_box(part), places[part.body]) for part in parts}
    all_screws = screws(shape)
    for screw in all_screws:
        room = places[screw.body] * bought.driver(screw.at, screw.outwards)
        bounds = room.bounding_box()
        box = np.array(tuple(bounds.min)), np.array(tuple(bounds.max))
        joined = _joined(screw.body, screw.step)
        for part in parts:
            if part.step > screw.step or part.body not in joined or _apart(boxes[part.name], box) > 0.0:
                continue
            common = room.intersect(places[part.body] * part.solid)
            volume = 0.0 if common is None else sum(solid.volume for solid in common.solids())
            if volume > 0.01:
                raise Unbuildable(
                    f"{part.name} is in the way of the driver of a {screw.name} screw (shape {shape.path})"
                )
    return len(all_screws)


def _joined(body: str, step: int) -> set[str]:
    """Return the links that hang together when a screw of that link is driven at that step."""
    number = BODIES.index(body)
    low = high = number
    while low > 0 and step >= 4 + low:
        low -= 1
    while high < 3 and step >= 5 + high:
        high += 1
    return {*BODIES[low : high + 1]}
