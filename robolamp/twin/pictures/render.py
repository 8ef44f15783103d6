"""Pictures of the lamp: by OpenGL where there is any (headless too), else as a side view of the links."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from robolamp.palette import rgb
from robolamp.twin.figure_model import FigureTwin
from robolamp.twin.lamp_model import TwinModel

Picture = NDArray[np.uint8]
"""An RGB picture, shape (height, width, 3)."""

_INK, _PAPER, _DESK = (40, 42, 46), (244, 245, 247), (214, 204, 190)
_POLE, _POST = rgb("bad"), (89, 92, 97)
_GOAL = rgb("goal")
_FONT = 17  # pixels: a strip of seven is shown at half its size in a report
_WIDER = 1.2  # than the scene's camera for strips sees, so that a lamp stretched to take off is in the picture whole
_SUPERSAMPLE = 3  # the side view is drawn larger and shrunk, which smooths its edges


class RenderUnavailableError(Exception):
    """There is no OpenGL here."""


def qpos_of(twin: TwinModel, base: Sequence[float], angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return MuJoCo positions of a lamp from what is known of it.

    Args:
        twin: The lamp.
        base: Base centre's x and z [m] and pitch [rad].
        angle: Joint angles, shape (n,) [rad].

    Returns:
        Shape (nq,).
    """
    x, z, pitch = base
    qpos = np.zeros(twin.model.nq)
    qpos[:7] = [x, 0.0, z, np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0]
    qpos[twin.qpos] = angle
    return qpos


def _gl_context(width: int, height: int):
    try:
        if sys.platform == "linux" and os.environ.get("MUJOCO_GL", "") in ("", "0"):
            from mujoco.egl import GLContext  # noqa: PLC0415 (needs no display)
        else:
            from mujoco.rendering.classic.gl_context import GLContext  # noqa: PLC0415
        return GLContext(width, height)
    except Exception as error:  # each platform's libraries fail in their own way
        raise RenderUnavailableError(str(error)) from None


class Camera:
    """Renders one model off screen.

    Args:
        twin: The lamp, or a figure.
        width: Of the picture [px].
        height: Of the picture [px].
        point: A point of the floor to mark, x and y [m].

    Raises:
        RenderUnavailableError: There is no OpenGL here.
    """

    def __init__(
        self, twin: TwinModel | FigureTwin, width: int, height: int, point: tuple[float, float] | None = None
    ) -> None:
        self._point = point
        self._plane = isinstance(twin, FigureTwin)  # goes anywhere in the plane, and is followed there
        self._model, self._data = twin.seen, mujoco.MjData(twin.seen)
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._gl = _gl_context(width, height)
        try:
            self._gl.make_current()
            self._model.vis.global_.offwidth = max(width, self._model.vis.global_.offwidth)
            self._model.vis.global_.offheight = max(height, self._model.vis.global_.offheight)
            self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        except Exception as error:
            self._gl.free()
            raise RenderUnavailableError(str(error)) from None
        self._scene = mujoco.MjvScene(self._model, maxgeom=500)

    def shoot(self, qpos: NDArray[np.float64], camera: str, follow: bool = True) -> Picture:
        """Return a picture of one pose.

        Args:
            qpos: Shape (nq,).
            camera: Name of a camera in the scene.
            follow: Move the camera along with the base.
        """
        self._data.qpos[:] = qpos
        mujoco.mj_forward(self._model, self._data)
        view = mujoco.MjvCamera()
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        view.fixedcamid = self._model.camera(camera).id
        if follow:
            axes = slice(0, 2 if self._plane else 1)
            self._data.cam_xpos[view.fixedcamid, axes] += qpos[axes]
        options = mujoco.MjvOption()
        mujoco.mjv_updateScene(self._model, self._data, options, None, view, mujoco.mjtCatBit.mjCAT_ALL, self._scene)
        for eye in self._scene.camera if camera == "strip" else ():
            eye.frustum_bottom, eye.frustum_top = _WIDER * eye.frustum_bottom, _WIDER * eye.frustum_top
        if self._point is not None:
            self._mark(*self._point)
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        picture = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_readPixels(picture, None, self._rect, self._context)
        return np.flipud(picture)

    def _mark(self, x: float, y: float) -> None:
        """Add a flat disc to the scene; for a lamp, whose foot would hide that, a line across its way."""
        geom = self._scene.geoms[self._scene.ngeom]
        kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, np.array([0.05, 0.05, 0.0015])
        if not self._plane:
            kind, size = mujoco.mjtGeom.mjGEOM_BOX, np.array([0.003, 0.15, 0.0015])
        colour = np.array([*(part / 255 for part in _GOAL), 1.0], np.float32)
        mujoco.mjv_initGeom(geom, kind, size, np.array([x, y, 0.0015]), np.eye(3).ravel(), colour)
        self._scene.ngeom += 1

    def close(self) -> None:
        """Free the OpenGL context."""
        self._context.free()
        self._gl.free()

    def __enter__(self) -> Camera:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def side_view(
    twin: TwinModel, qpos: NDArray[np.float64], width: int, height: int, point: tuple[float, float] | None = None
) -> Picture:
    """Return a drawing of one pose from the side, without OpenGL.

    Args:
        twin: The lamp.
        qpos: Shape (nq,).
        width: Of the picture [px].
        height: Of the picture [px].
        point: A point of the floor to mark, x and y [m].
    """
    model, data = twin.model, mujoco.MjData(twin.model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    scale = height * _SUPERSAMPLE / 0.40  # the lamp is 0.26 m tall, 0.34 m as it takes off
    size = (width * _SUPERSAMPLE, height * _SUPERSAMPLE)
    floor = size[1] * 0.86

    def pixel(point: NDArray[np.float64]) -> tuple[float, float]:
        return size[0] * 0.45 + (point[0] - qpos[0]) * scale, floor - point[2] * scale

    picture = Image.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(picture)
    draw.rectangle((0, floor, *size), fill=_DESK)
    for mark in range(-4, 5):  # a mark each 5 cm of desk shows how far the lamp has come
        at = (np.floor(qpos[0] / 0.05) + mark) * 0.05
        x, y = pixel(np.array([at, 0.0, 0.0]))
        draw.line((x, y, x, y + 0.012 * scale), fill=(150, 138, 122), width=_SUPERSAMPLE)
    if point is not None:
        x, y = pixel(np.array([*point, 0.0]))
        draw.line((x, y, x, y + 0.03 * scale), fill=_GOAL, width=2 * _SUPERSAMPLE)
    joints = [data.xanchor[model.joint(name).id] for name in twin.lamp.names]
    if twin.pole_sensor is not None:
        bar = data.geom("pole")
        top, radius = pixel(bar.xpos), model.geom("pole").size[0] * scale
        draw.line([top, pixel(bar.xpos * [1.0, 1.0, 0.0])], fill=_POST, width=_SUPERSAMPLE)
        draw.ellipse((top[0] - radius, top[1] - radius, top[0] + radius, top[1] + radius), fill=_POLE)
    draw.line([pixel(point) for point in joints], fill=_INK, width=round(0.010 * scale), joint="curve")
    foot = model.geom("foot")
    axes = data.geom_xmat[foot.id].reshape(3, 3)
    rim = foot.size[0] * axes[:, 0]
    low = data.geom_xpos[foot.id] - foot.size[1] * axes[:, 2]
    high = low + 3 * foot.size[1] * axes[:, 2]
    draw.polygon([pixel(p) for p in (low - rim, low + rim, high + 0.75 * rim, high - 0.75 * rim)], fill=_INK)
    head = model.geom("head")
    axes = data.geom_xmat[head.id].reshape(3, 3)
    along, across = head.size[1] * axes[:, 2], head.size[0] * axes[:, 0]
    center = data.geom_xpos[head.id]
    shade = (
        center - along - 0.36 * across,
        center - along + 0.36 * across,
        center + along + across,
        center + along - across,
    )
    draw.line([pixel(joints[-1]), pixel(center - along)], fill=_INK, width=round(0.010 * scale))
    draw.polygon([pixel(point) for point in shade], fill=(233, 220, 190), outline=_INK)
    for joint in joints:
        x, y = pixel(joint)
        radius = 0.009 * scale
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=(120, 124, 130))
    return np.asarray(picture.resize((width, height), Image.Resampling.LANCZOS))


def outline(
    twin: FigureTwin, qpos: NDArray[np.float64], width: int, height: int, point: tuple[float, float] | None = None
) -> Picture:
    """Return a drawing of a figure's pose from the side, without OpenGL: its parts as boxes.

    Args:
        twin: The figure.
        qpos: Shape (nq,).
        width: Of the picture [px].
        height: Of the picture [px].
        point: A point of the floor to mark, x and y [m].
    """
    model, data = twin.model, mujoco.MjData(twin.model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    scale = height * _SUPERSAMPLE / (1.2 * model.stat.extent)
    size = (width * _SUPERSAMPLE, height * _SUPERSAMPLE)
    floor = size[1] * 0.86
    picture = Image.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(picture)
    draw.rectangle((0, floor, *size), fill=_DESK)

    def pixels(places: NDArray[np.float64]) -> list[tuple[float, float]]:
        return [(size[0] / 2 + (x - qpos[twin.root]) * scale, floor - z * scale) for x, _, z in places]

    if point is not None:
        (x, y), _ = pixels(np.array([[*point, 0.0]] * 2))
        draw.ellipse((x - 0.02 * scale, y, x + 0.02 * scale, y + 0.02 * scale), fill=_GOAL)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    solid = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] and model.geom_contype[geom]]
    for geom in sorted(solid, key=lambda geom: -data.geom_xpos[geom, 1]):
        box = model.geom_aabb[geom, :3] + corners * model.geom_aabb[geom, 3:]
        placed = data.geom_xpos[geom] + box @ data.geom_xmat[geom].reshape(3, 3).T
        colour = tuple(int(255 * part) for part in model.mat_rgba[model.geom_matid[geom], :3])
        draw.polygon(_hull(pixels(placed)), fill=colour)
    return np.asarray(picture.resize((width, height), Image.Resampling.LANCZOS))


def _hull(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the convex hull of points (Andrew's monotone chain)."""
    around: list[tuple[float, float]] = []
    for run in (sorted(points), sorted(points, reverse=True)):
        half: list[tuple[float, float]] = []
        for point in run:
            while len(half) > 1 and _turn(half[-2], half[-1], point) <= 0:
                half.pop()
            half.append(point)
        around += half[:-1]
    return around


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _pictures(
    twin: TwinModel | FigureTwin,
    qpos: NDArray[np.float64],
    width: int,
    height: int,
    opengl: bool,
    point: tuple[float, float] | None,
) -> list[Picture]:
    if opengl:
        try:
            with Camera(twin, width, height, point) as camera:
                return [camera.shoot(pose, "strip") for pose in qpos]
        except RenderUnavailableError:
            pass  # the side view needs no OpenGL
    if isinstance(twin, FigureTwin):
        return [outline(twin, pose, width, height, point) for pose in qpos]
    return [side_view(twin, pose, width, height, point) for pose in qpos]


def animation(
    twin: TwinModel | FigureTwin,
    qpos: NDArray[np.float64],
    *,
    width: int = 360,
    height: int = 360,
    opengl: bool = True,
    point: tuple[float, float] | None = None,
) -> list[Picture]:
    """Return poses as the frames of an animation, the camera travelling with the lamp.

    Args:
        twin: The lamp, or a figure.
        qpos: Poses, shape (k, nq).
        width: Of each picture [px].
        height: Of each picture [px].
        opengl: False: draw side views even where OpenGL is to be had.
        point: A point of the floor to mark, x and y [m].
    """
    return _pictures(twin, qpos, width, height, opengl, point)


def strip(
    twin: TwinModel | FigureTwin,
    qpos: NDArray[np.float64],
    labels: Sequence[str],
    *,
    width: int = 220,
    height: int = 260,
    opengl: bool = True,
    point: tuple[float, float] | None = None,
) -> Picture:
    """Return poses side by side, the desk moving under the lamp as it travels.

    Args:
        twin: The lamp, or a figure.
        qpos: Poses, shape (k, nq).
        labels: A text under each.
        width: Of each picture [px].
        height: Of each picture [px].
        opengl: False: draw side views even where OpenGL is to be had.
        point: A point of the floor to mark, x and y [m].
    """
    return strips(twin, {"": qpos}, labels, width=width, height=height, opengl=opengl, point=point)


def strips(
    twin: TwinModel | FigureTwin,
    motions: Mapping[str, NDArray[np.float64]],
    labels: Sequence[str],
    *,
    width: int = 220,
    height: int = 260,
    opengl: bool = True,
    point: tuple[float, float] | None = None,
    notes: Mapping[str, Sequence[str]] | None = None,
) -> Picture:
    """Return several motions as strips one above the other, for comparison: a column a moment.

    Args:
        twin: The lamp.
        motions: Poses of each motion, shape (k, nq), by the name that is written into its first picture.
        labels: A text under each column, k of them.
        width: Of each picture [px].
        height: Of each picture [px].
        opengl: False: draw side views even where OpenGL is to be had.
        point: A point of the floor to mark, x and y [m].
        notes: By name, what is written into each picture of a motion: what holds of it alone.
    """
    gap, foot = 4, 24
    size = (len(labels) * (width + gap) - gap, len(motions) * (height + gap) - gap + foot)
    sheet = Image.new("RGB", size, (255, 255, 255))
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(_FONT)
    pictures = iter(_pictures(twin, np.concatenate(list(motions.values())), width, height, opengl, point))
    for row, (name, poses) in enumerate(motions.items()):
        top = row * (height + gap)
        for column in range(len(poses)):
            sheet.paste(Image.fromarray(next(pictures)), (column * (width + gap), top))
        draw.text((10, top + 8), name, fill=_INK, font=font)
        for column, said in enumerate((notes or {}).get(name, ())):
            place = (column * (width + gap) + width - 8, top + height - 8)
            draw.text(place, said, fill=_INK, font=font, anchor="rs")
    for column, label in enumerate(labels):
        draw.text((column * (width + gap) + width / 2, size[1] - foot / 2), label, fill=_INK, font=font, anchor="mm")
    return np.asarray(sheet)


def beside(
    twin: TwinModel | FigureTwin,
    motions: Mapping[str, NDArray[np.float64]],
    *,
    width: int = 360,
    height: int = 360,
    opengl: bool = True,
    point: tuple[float, float] | None = None,
) -> list[Picture]:
    """Return the frames of an animation with several motions side by side, each with its name.

    Args:
        twin: The lamp.
        motions: Poses of each motion, shape (k, nq), by name.
        width: Of one motion's picture [px].
        height: Of the picture [px].
        opengl: False: draw side views even where OpenGL is to be had.
        point: A point of the floor to mark, x and y [m].
    """
    poses = np.stack(list(motions.values()), axis=1)
    pictures = _pictures(twin, poses.reshape(-1, poses.shape[2]), width, height, opengl, point)
    font = ImageFont.load_default(_FONT)
    frames = []
    for first in range(0, len(pictures), len(motions)):
        frame = Image.fromarray(np.concatenate(pictures[first : first + len(motions)], axis=1))
        draw = ImageDraw.Draw(frame)
        for column, name in enumerate(motions):
            draw.text((column * width + 10, 8), name, fill=_INK, font=font)
        frames.append(np.asarray(frame))
    return frames


def png(picture: Picture) -> bytes:
    """Return a picture as the bytes of a PNG file.

    Args:
        picture: RGB.
    """
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG", optimize=True)
    return stream.getvalue()
