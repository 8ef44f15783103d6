"""Simple solids of the parts that are bought, for masses, clearances and pictures."""

from __future__ import annotations

from build123d import Align, Box, Cylinder, Part, Plane, Pos, Rot, Sphere

from measures import (
    CASE_DEPTH,
    CASE_FAR,
    CASE_MIDDLE,
    CASE_NEAR,
    CASE_WIDTH,
    DRIVER_RADIUS,
    FSR_HEIGHT,
    FSR_RADIUS,
    HORN_FACE,
    HORN_RADIUS,
    PICO,
    SCREW_HEAD,
    SCREW_HEAD_RADIUS,
    SCREW_PILOT,
)  # fmt: skip


def servo() -> Part:
    """Return an XL330's case, without its horn."""
    return Pos(0, 0, CASE_MIDDLE) * Box(CASE_WIDTH, CASE_DEPTH, CASE_FAR + CASE_NEAR)


def along_y(radius: float, low: float, high: float, x: float = 0.0, z: float = 0.0) -> Part:
    """Return a cylinder along y.

    Args:
        radius: Its radius [mm].
        low: Where it begins, along y.
        high: Where it ends.
        x: Its axis.
        z: Its axis.
    """
    return Pos(x, (low + high) / 2, z) * Rot(90, 0, 0) * Cylinder(radius, high - low)


def horn(side: float) -> Part:
    """Return a horn (or the rear idler, which has its size), a fifth of a millimetre off the case it turns on.

    Args:
        side: +1: at +y; -1: at -y.
    """
    low, high = sorted((side * (CASE_DEPTH / 2 + 0.2), side * HORN_FACE))
    return along_y(HORN_RADIUS, low, high)


def tube(outer: float, bore: float, low: float, high: float, x: float) -> Part:
    """Return a tube along z.

    Args:
        outer: Its diameter [mm].
        bore: Its bore.
        low: Where it begins, along z.
        high: Where it ends.
        x: Its axis.
    """
    solid = Cylinder(outer / 2, high - low)
    return Pos(x, 0, (low + high) / 2) * (solid - Cylinder(bore / 2, high - low) if bore else solid)


def screw(at: tuple[float, float, float], outwards: tuple[float, float, float], length: float) -> Part:
    """Return a pan-head screw.

    Args:
        at: Where the underside of its head is.
        outwards: From the thread to the head; the driver comes from there.
        length: Of the thread [mm].
    """
    shank = Cylinder(SCREW_PILOT, length, align=(Align.CENTER, Align.CENTER, Align.MAX))
    return screw_head(at, outwards) + Plane(origin=at, z_dir=outwards) * shank


def screw_head(at: tuple[float, float, float], outwards: tuple[float, float, float]) -> Part:
    """Return a screw's head.

    Args:
        at: Where its underside is.
        outwards: Away from the thread.
    """
    head = Cylinder(SCREW_HEAD_RADIUS, SCREW_HEAD, align=(Align.CENTER, Align.CENTER, Align.MIN))
    return Plane(origin=at, z_dir=outwards) * head


def driver(at: tuple[float, float, float], outwards: tuple[float, float, float], reach: float = 80.0) -> Part:
    """Return the room that a screwdriver takes: a cylinder from the top of a screw's head outwards.

    Args:
        at: Where the underside of the head is.
        outwards: The driver comes from there.
        reach: Length of the room [mm].
    """
    centred = (Align.CENTER, Align.CENTER, Align.MIN)
    top = SCREW_HEAD + 0.05
    return Plane(origin=at, z_dir=outwards) * Pos(0, 0, top) * Cylinder(DRIVER_RADIUS, reach, align=centred)


def pico() -> Part:
    """Return a Raspberry Pi Pico, its board's underside at z = 0, its USB socket towards +y."""
    board = Pos(0, 0, PICO[2] / 2) * Box(*PICO)
    socket = Pos(0, PICO[1] / 2 - 1.6, PICO[2] + 1.4) * Box(7.5, 5.6, 2.8)
    return board + socket


def force_sensor() -> Part:
    """Return an FSR 402 without its tail, its underside at z = 0."""
    return Pos(0, 0, FSR_HEIGHT / 2) * Cylinder(FSR_RADIUS, FSR_HEIGHT)


def ball(radius: float, z: float) -> Part:
    """Return the bulb.

    Args:
        radius: Its radius [mm].
        z: Its middle.
    """
    return Pos(0, 0, z) * Sphere(radius)
