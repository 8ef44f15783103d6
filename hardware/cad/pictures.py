"""Pictures of the parts for the build guide, rendered from their solids with MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

COLORS = {
    "enamel": "0.93 0.90 0.82 1",
    "steel": "0.66 0.68 0.71 1",
    "servo": "0.22 0.23 0.26 1",
    "rubber": "0.30 0.30 0.32 1",
    "board": "0.16 0.45 0.30 1",
    "bulb": "1.0 0.90 0.55 1",
    "ghost": "0.55 0.62 0.72 1",
}
_WIDTH, _HEIGHT = 1100, 820
_FINER = 2  # rendered larger, then reduced: smooth edges


@dataclass(frozen=True)
class Shown:
    """A part in a picture.

    Attributes:
        triangles: Its surface, shape (n, 3, 3) [mm].
        color: Key of `COLORS`.
        label: Written beside it; empty: nothing.
    """

    triangles: NDArray[np.float64]
    color: str
    label: str = ""


def render(parts: Sequence[Shown], path: Path, azimuth: float, elevation: float, zoom: float = 1.0) -> None:
    """Draw parts, with labels beside them.

    Args:
        parts: What is to be seen.
        path: The PNG file.
        azimuth: Where the eye looks, about z [degrees].
        elevation: The same, up and down.
        zoom: Larger is closer; 1 fits everything.
    """
    points = np.concatenate([part.triangles.reshape(-1, 3) for part in parts])
    low, high = points.min(0), points.max(0)
    middle = (low + high) / 2
    turn = _view(azimuth, elevation)
    seen = (points - middle) @ turn.T
    extent = np.ptp(seen, axis=0)
    middle = middle + turn.T @ ((seen.max(0) + seen.min(0)) / 2 * [1, 1, 0])
    across = max(extent[1], extent[0] * _HEIGHT / _WIDTH) * 1.12 / zoom / 1000.0
    model = _model(parts, across)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = middle / 1000.0
    camera.distance, camera.azimuth, camera.elevation = 1.0, azimuth, elevation
    camera.orthographic = 1
    with mujoco.Renderer(model, _HEIGHT * _FINER, _WIDTH * _FINER) as renderer:
        renderer.update_scene(data, camera)
        image = Image.fromarray(renderer.render())
    image = image.resize((_WIDTH, _HEIGHT), Image.Resampling.LANCZOS)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(18)
    scale = _HEIGHT / (across * 1000.0)
    taken: list[float] = []
    labelled = []
    for part in parts:
        if part.label:
            points = (part.triangles.mean(1) - middle) @ turn.T
            x, y, _ = points[(points[:, 0] + 0.2 * points[:, 1]).argmax()]  # at its right edge, where it is seen
            labelled.append((_HEIGHT / 2 - y * scale, _WIDTH / 2 + x * scale, part.label))
    right = _WIDTH - 12
    for y, x, label in sorted(labelled):
        at = min(max(y, 20.0), _HEIGHT - 20.0)
        if taken and at < taken[-1] + 24.0:
            at = taken[-1] + 24.0
        taken.append(at)
        width = draw.textlength(label, font)
        draw.line([(x, y), (right - width - 8, at)], fill=(38, 103, 184), width=1)
        draw.ellipse([x - 3, y - 3, x + 3, y + 3], fill=(38, 103, 184))
        draw.rectangle([right - width - 6, at - 12, right + 4, at + 12], fill=(255, 255, 255))
        draw.text((right - width, at), label, fill=(34, 37, 42), font=font, anchor="lm")
    left = np.flatnonzero((np.asarray(image).min(2) < 250).any(0))[0]
    image = image.crop((max(0, left - 40), 0, _WIDTH, _HEIGHT))
    image.quantize(96, dither=Image.Dither.NONE).save(path, optimize=True)


def _view(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Return the matrix from the world to the picture: right, up, towards the eye."""
    a, e = np.radians(azimuth), np.radians(elevation)
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return np.array([right, np.cross(right, forward), -forward])


def _model(parts: Sequence[Shown], across: float) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = _WIDTH * _FINER, _HEIGHT * _FINER
    spec.visual.global_.fovy = across
    spec.visual.quality.shadowsize = 4096
    spec.visual.headlight.ambient[:] = 0.45
    spec.visual.headlight.diffuse[:] = 0.45
    spec.visual.headlight.specular[:] = 0.1
    spec.visual.map.znear = 0.005
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT, rgb1=[1, 1, 1],
        rgb2=[1, 1, 1], width=16, height=96,
    )  # fmt: skip
    spec.worldbody.add_light(pos=[0.3, -0.6, 1.5], dir=[-0.2, 0.4, -1.0], diffuse=[0.35] * 3, castshadow=False)
    for number, part in enumerate(parts):
        points, faces = np.unique(part.triangles.reshape(-1, 3).round(4), axis=0, return_inverse=True)
        name = f"part_{number}"
        spec.add_mesh(
            name=name, uservert=(points / 1000.0).ravel(), userface=faces.astype(np.int32).ravel(), smoothnormal=False,
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )  # fmt: skip
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0,
            rgba=[float(value) for value in COLORS[part.color].split()],
        )  # fmt: skip
    return spec.compile()
