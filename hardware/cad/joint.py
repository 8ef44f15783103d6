"""What joins two links: the cradle that holds a servo in one, and the fork that holds its horn and idler in the other.

Both lie on their side to be printed (x upwards): layers then run along the walls that bend in the plane of motion.
"""

from __future__ import annotations

import math

from build123d import Box, Part, Plane, Polygon, Pos, extrude

import bought
import measures
from bought import along_y

WIDTH = measures.CRADLE_HALF_WIDTH  # half, of cradles and forks
PLATE_IN, PLATE_OUT = measures.CASE_DEPTH / 2 + 0.1, 14.2  # of the cradle's plates, along y
LAND = 1.4  # mm of plate under a frame screw's head; the head is all but flush with the rest
FORK_BOSS = measures.HORN_FACE + 0.1  # where the fork meets horn and idler
_BOSS_RADIUS = measures.HORN_RADIUS + 0.25
FORK_IN, FORK_OUT = 15.1, 18.1
TUBE_Y = 14.0  # of the tubes: within the walls of cradles and forks alike
_BRIDGE = 2.8  # thickness, of a cross-piece between its sockets
_SOCKET_WALL = 1.4
_GLUE = 0.1  # round a tube, for the glue


def prism_y(points: list[tuple[float, float]], low: float, high: float) -> Part:
    """Return a prism along y.

    Args:
        points: Its outline, x and z.
        low: Where it begins, along y.
        high: Where it ends.
    """
    return extrude(Plane.XZ.offset(-low) * Polygon(*points, align=None), amount=low - high)


def block(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Part:
    """Return a box between two corners.

    Args:
        x: Where it begins and ends, along x.
        y: The same along y.
        z: The same along z.
    """
    ends = (x, y, z)
    return Pos(*(sum(pair) / 2 for pair in ends)) * Box(*(pair[1] - pair[0] for pair in ends))


def end_piece(begin: float, tube: float, spacing: float) -> Part:
    """Return a cross-piece with four blind sockets for tubes: two in line with either wall, one before the other.

    A pitching moment passes from a wall to its pair of tubes as push and pull; the bridge between only ties the sides.

    Args:
        begin: Its side towards the servo, along z; the sockets open on the other.
        tube: Diameter of the tubes.
        spacing: Between the two of a pair, along x.
    """
    half = tube / 2 + _GLUE + _SOCKET_WALL
    top = begin + measures.SOCKET
    piece = block((-WIDTH, WIDTH), (-TUBE_Y, TUBE_Y), (begin, begin + _BRIDGE))
    for side in (-1.0, 1.0):
        piece += block((-WIDTH, WIDTH), (side * TUBE_Y - half, side * TUBE_Y + half), (begin, top))
    for x, y in tube_places(spacing):
        piece -= Pos(0, y, 0) * bought.tube(tube + 2 * _GLUE, 0.0, socket_floor(begin), top, x)
    return piece


def tube_places(spacing: float) -> list[tuple[float, float]]:
    """Return x and y of an arm's four tubes.

    Args:
        spacing: Between the two of a pair, along x.
    """
    return [(x, y) for y in (-TUBE_Y, TUBE_Y) for x in (-spacing / 2, spacing / 2)]


def socket_floor(begin: float) -> float:
    """Return where a tube ends in an end piece, along z.

    Args:
        begin: As of `end_piece`.
    """
    return begin + 1.2


def cradle(tube: float, spacing: float) -> Part:
    """Return a servo's cradle, in the servo's frame.

    Args:
        tube: Diameter of the tubes.
        spacing: Between their middles.
    """
    far = measures.CASE_FAR + measures.CRADLE_GAP
    near = -9.9
    part = end_piece(far, tube, spacing)
    for side in (-1.0, 1.0):
        low, high = sorted((side * PLATE_IN, side * PLATE_OUT))
        begin = 0.0 if side > 0 else near  # the horn slides in where its plate ends; the idler is put on afterwards
        plate = block((-WIDTH, WIDTH), (low, high), (begin, far + 1.0))
        plate -= along_y(measures.HORN_RADIUS + 0.6, low, high)
        plate -= block((-5.0, 5.0), (low, high), (near, 0.0))
        plate -= block((-6.0, 6.0), (low, high), (11.4, 18.6))  # a window: light, and for the cable
        rim = sorted((side * (PLATE_IN + LAND), side * PLATE_OUT))
        for x, z in frame_holes(side):
            inner, outer = (5.0, WIDTH) if x > 0 else (-WIDTH, -5.0)
            span = (near, -4.9) if z < 0 else (19.9, far + 0.6)
            plate -= block((inner, outer), (rim[0], rim[1]), span)
            plate -= along_y(measures.SCREW_HOLE, low, high, x, z)
        part += plate
    return part


def frame_holes(side: float) -> list[tuple[float, float]]:
    """Return x and z of the frame holes that a cradle uses on one side of the servo.

    Args:
        side: +1: the horn's, the two far ones; -1: the back, all four.
    """
    return [(x, z) for x, z in measures.FRAME_HOLES if side < 0 or z > 0]


def fork_walls(root: float, root_half: float, holes: float, end: float = WIDTH) -> Part:
    """Return a fork's two walls: from the axis along z, with holes for the screws of horn and idler.

    Args:
        root: Where they end, along z.
        root_half: Half their width there.
        holes: By how much the pattern of holes is turned about y, from z towards x [rad].
        end: Half their width at the axis, and the radius they are rounded with.
    """
    walls = Part()
    for side in (-1.0, 1.0):
        low, high = sorted((side * FORK_IN, side * FORK_OUT))
        wall = along_y(end, low, high) + prism_y(
            [(-end, 0), (end, 0), (root_half, root), (-root_half, root)], low, high
        )
        face, out = sorted((side * FORK_BOSS, side * FORK_OUT))
        wall += along_y(_BOSS_RADIUS, *sorted((side * FORK_BOSS, side * FORK_IN)))
        wall -= along_y(3.0, face, out)
        for x, z in hole_places(holes):
            wall -= along_y(measures.SCREW_HOLE, face, out, x, z)
        walls += wall
    return walls


def hole_places(turn: float) -> list[tuple[float, float]]:
    """Return x and z of the four holes of horn and idler, from the axis.

    Args:
        turn: By how much they are turned about y, from z towards x [rad].
    """
    angles = [turn + quarter * math.pi / 2 for quarter in range(4)]
    return [(measures.HORN_CIRCLE * math.sin(angle), measures.HORN_CIRCLE * math.cos(angle)) for angle in angles]


def elbow(reach: float, tube: float, spacing: float, holes: float) -> Part:
    """Return the upper arm's lower end: a fork with the sockets of its tubes.

    Args:
        reach: Where its cross-piece begins, from the axis.
        tube: Diameter of the tubes.
        spacing: Between their middles.
        holes: As of `fork_walls`.
    """
    return fork_walls(reach + 1.0, WIDTH, holes) + end_piece(reach, tube, spacing)
