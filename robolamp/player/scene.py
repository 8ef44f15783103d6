"""The twin as triangles, as the player draws it, and the pose of each part at each moment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from robolamp.twin.lamp_model import TwinModel

Vertices = NDArray[np.float32]
Shape = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]  # points, normals, triangles

_AROUND, _ARC = 24, 5  # corners of a circle; steps of a quarter of one
_CREASE = np.cos(np.radians(35.0))  # faces that meet at a flatter angle are shaded as one surface
_HIDDEN_GROUP = 3  # geoms from this group on are for collisions, not for the eye


@dataclass(frozen=True)
class Part:
    """One shape of the lamp, in the frame of its body.

    Attributes:
        body: Index into the scene's bodies.
        first: Of its indices.
        count: Number of its indices.
        color: Red, green and blue, 0 to 1.
        emission: How much of its colour it gives off by itself, 0 to 1.
        shine: How much it reflects the light as a spot, 0 to 1.
    """

    body: int
    first: int
    count: int
    color: tuple[float, float, float]
    emission: float
    shine: float


@dataclass(frozen=True)
class Scene:
    """A lamp as triangles.

    Attributes:
        vertices: Point [m] and normal of each corner, shape (k, 6).
        indices: Corners of the triangles.
        parts: What is drawn of them, and how.
        bodies: MuJoCo ids of the bodies that have parts.
        base: Which of them is the lamp's base, that the eye follows.
    """

    vertices: Vertices
    indices: NDArray[np.uint32]
    parts: tuple[Part, ...]
    bodies: tuple[int, ...]
    base: int


def scene_of(twin: TwinModel) -> Scene:
    """Return the visible parts of a lamp (and of a limbo pole); the player draws the floor itself.

    Args:
        twin: The lamp.
    """
    model = twin.seen
    vertices: list[NDArray[np.float64]] = []
    indices: list[NDArray[np.int64]] = []
    parts: list[Part] = []
    bodies: list[int] = []
    corners = triangles = 0
    for geom in range(model.ngeom):
        color = _color(model, geom)
        if model.geom_group[geom] >= _HIDDEN_GROUP or color[3] == 0.0:
            continue
        shape = _shape(model, geom)
        if shape is None:
            continue
        points, normals, faces = shape
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        turn = turn.reshape(3, 3)
        vertices.append(np.hstack([points @ turn.T + model.geom_pos[geom], normals @ turn.T]))
        indices.append(faces.ravel() + corners)
        body = int(model.geom_bodyid[geom])
        if body not in bodies:
            bodies.append(body)
        material = int(model.geom_matid[geom])
        emission, shine = (model.mat_emission[material], model.mat_specular[material]) if material >= 0 else (0.0, 0.5)
        parts.append(
            Part(bodies.index(body), triangles, faces.size, color[:3], min(float(emission), 1.0), float(shine))
        )
        corners += len(points)
        triangles += faces.size
    return Scene(
        np.concatenate(vertices).astype(np.float32), np.concatenate(indices).astype(np.uint32), tuple(parts),
        tuple(bodies), bodies.index(int(model.jnt_bodyid[0])),
    )  # fmt: skip


def poses_of(twin: TwinModel, scene: Scene, qpos: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return where the scene's bodies are: position [m] and quaternion (w, x, y, z), shape (k, bodies, 7).

    Args:
        twin: The lamp.
        scene: Its scene.
        qpos: MuJoCo positions at k moments, shape (k, nq).
    """
    data = mujoco.MjData(twin.model)
    poses = np.empty((len(qpos), len(scene.bodies), 7), np.float32)
    bodies = list(scene.bodies)
    for index, positions in enumerate(qpos):
        data.qpos[:] = positions
        mujoco.mj_kinematics(twin.model, data)
        poses[index, :, :3] = data.xpos[bodies]
        poses[index, :, 3:] = data.xquat[bodies]
    # q and -q are the same turn; between two frames the player takes the short way.
    flips = np.sign(np.sum(poses[1:, :, 3:] * poses[:-1, :, 3:], axis=2))
    signs = np.cumprod(np.where(flips == 0.0, 1.0, flips), axis=0)
    poses[1:, :, 3:] *= signs[:, :, None].astype(np.float32)
    return poses


def _color(model: mujoco.MjModel, geom: int) -> tuple[float, float, float, float]:
    material = model.geom_matid[geom]
    red, green, blue, alpha = (model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]).tolist()
    return red, green, blue, alpha


def _shape(model: mujoco.MjModel, geom: int) -> Shape | None:
    size = model.geom_size[geom]
    match model.geom_type[geom]:
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return _turned(_arc(size[0], 0.0, -90.0, 90.0))
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return _turned([*_arc(size[0], -size[1], -90.0, 0.0), *_arc(size[0], size[1], 0.0, 90.0)])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            radius, half = size[0], size[1]
            return _joined(
                _turned([(0.0, -half, 0.0, -1.0), (radius, -half, 0.0, -1.0)]),
                _turned([(radius, -half, 1.0, 0.0), (radius, half, 1.0, 0.0)]),
                _turned([(radius, half, 0.0, 1.0), (0.0, half, 0.0, 1.0)]),
            )
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            points, normals, faces = _turned(_arc(1.0, 0.0, -90.0, 90.0))
            normals = normals / size
            return points * size, normals / np.linalg.norm(normals, axis=1, keepdims=True), faces
        case mujoco.mjtGeom.mjGEOM_BOX:
            return _joined(*_box(size))
        case mujoco.mjtGeom.mjGEOM_MESH:
            return _mesh(model, int(model.geom_dataid[geom]))
    return None


def _arc(radius: float, height: float, begin: float, end: float) -> list[tuple[float, float, float, float]]:
    """Return the outline of a ball's part: distance from the axis, height, and the normal's two components."""
    steps = round(abs(end - begin) / 90.0 * _ARC)
    angles = np.radians(np.linspace(begin, end, steps + 1))
    return [(radius * np.cos(a), height + radius * np.sin(a), np.cos(a), np.sin(a)) for a in angles]


def _turned(outline: list[tuple[float, float, float, float]]) -> Shape:
    """Turn an outline about the z axis."""
    around = np.linspace(0.0, 2 * np.pi, _AROUND + 1)
    cos, sin = np.cos(around), np.sin(around)
    rows = np.array(outline)
    points = np.stack(
        [np.outer(rows[:, 0], cos), np.outer(rows[:, 0], sin), np.outer(rows[:, 1], np.ones_like(cos))], 2
    )
    normals = np.stack(
        [np.outer(rows[:, 2], cos), np.outer(rows[:, 2], sin), np.outer(rows[:, 3], np.ones_like(cos))], 2
    )
    row, column = np.meshgrid(np.arange(len(rows) - 1), np.arange(_AROUND), indexing="ij")
    at = row * (_AROUND + 1) + column
    above = at + _AROUND + 1
    faces = np.stack([at, at + 1, above + 1, at, above + 1, above], axis=-1).reshape(-1, 3)
    return points.reshape(-1, 3), normals.reshape(-1, 3), faces


def _box(size: NDArray[np.float64]) -> Iterator[Shape]:
    for axis in range(3):
        for side in (-1.0, 1.0):
            one, two = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3] * side
            normal = np.eye(3)[axis] * side
            points = np.array([normal - one - two, normal + one - two, normal + one + two, normal - one + two]) * size
            yield points, np.tile(normal, (4, 1)), np.array([[0, 1, 2], [0, 2, 3]])


def _mesh(model: mujoco.MjModel, mesh: int) -> Shape:
    """A mesh with normals of its own: smooth over what is nearly flat, sharp at edges, which MuJoCo's smooth over."""
    vertices = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    places, same = np.unique(model.mesh_vert[vertices].round(6), axis=0, return_inverse=True)
    triangles = same.reshape(-1)[model.mesh_face[faces]]
    points = places.astype(np.float64)[triangles]
    across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])  # as long as the face is large
    facing = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    corners = triangles.ravel()  # corner c belongs to face c // 3
    order = np.argsort(corners, kind="stable")
    counts = np.bincount(corners, minlength=len(places))
    starts = np.cumsum(counts) - counts
    sizes = counts[corners]
    corner = np.repeat(np.arange(corners.size), sizes)  # every corner with every face at its point
    along = np.arange(corner.size) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    face = order[starts[corners[corner]] + along] // 3
    smooth = np.einsum("ij,ij->i", facing[face], facing[corner // 3]) > _CREASE
    normals = np.zeros((corners.size, 3))
    np.add.at(normals, corner[smooth], across[face[smooth]])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    both = np.hstack([points.reshape(-1, 3), normals]).astype(np.float32)
    once, place = np.unique(both, axis=0, return_inverse=True)  # corners of one place and normal are one vertex
    return once[:, :3].astype(np.float64), once[:, 3:].astype(np.float64), place.reshape(-1, 3)


def _joined(*shapes: Shape) -> Shape:
    starts = np.cumsum([0, *(len(points) for points, _, _ in shapes)])
    return (
        np.concatenate([points for points, _, _ in shapes]),
        np.concatenate([normals for _, normals, _ in shapes]),
        np.concatenate([faces + start for (_, _, faces), start in zip(shapes, starts, strict=False)]),
    )
